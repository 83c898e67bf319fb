"""The monitor: alarms when something changes, at no more than the stated rate when nothing does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from directions import unit_vectors
from scipy.signal import lfilter
from scipy.stats import f

import estimators
import scenarios
from estimators.calibration import Calibration
from estimators.live import Calibrator, Options
from estimators.live.alarm import Alarm
from estimators.live.noise_memory import Memory
from estimators.live.residual_blocks import Blocks
from estimators.live.sensor_watch import SensorWatch
from estimators.live.stuck import Stuck
from estimators.live.watch import Watch
from rig.arrays import Array
from rig.errors import RigError
from rig.recording import Recording

CHANGE_S, OVER_S = 800.0, 1000.0


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return estimators.calibrate(scenarios.load("ann-arbor").simulate(seed=1))


def watched(run: Recording, calibration: Calibration | None, alarms: float = 1.0, piece: int = 25) -> list[Alarm]:
    watch = Watch.of(run, calibration, None, alarms)
    found = []
    for first in range(0, len(run), piece):
        found += watch.add(run.select(slice(first, first + piece)))
    return found


def changed(run: Recording, sensor: str, change: Callable[[Array], Array]) -> Recording:
    readings = run.readings(sensor).copy()
    lasting = (run.t >= CHANGE_S) & (run.t < OVER_S)
    readings[lasting] = change(readings[lasting])
    return replace(run, **{sensor: readings})


def test_nothing_is_said_where_nothing_changes(recording: Recording, calibration: Calibration) -> None:
    # 28 minutes at one false alarm a day: one run in 50 would say something; at one in 100 days, one in 5,000
    assert watched(recording, calibration, alarms=0.01) == []


NOISE = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("sensor", "change", "name", "where"),
    [
        ("accelerometer", lambda v: v + np.array([0.06, 0.0, 0.0]), "bias_step", "accel1"),
        ("magnetometer", lambda v: v + np.array([0.06, -0.08, 0.05]), "bias_step", "mag1-3"),
        ("accelerometer", lambda v: 1.02 * v, "supply_ratiometric", "supply"),
        ("accelerometer", lambda v: v + 0.06 * NOISE.standard_normal(v.shape), "noise_excess", "accel1"),
        ("magnetometer", lambda v: np.where([False, True, False], v[0], v), "dropouts", "channel 2"),
    ],
)
def test_a_change_is_noticed_at_once_named_and_its_end_too(
    recording: Recording,
    calibration: Calibration,
    sensor: str,
    change: Callable[[Array], Array],
    name: str,
    where: str,
) -> None:
    """Changes of four sigma and more: eight samples at 4 Hz, two seconds, show them with a chi-square above 100."""
    found = watched(changed(recording, sensor, change), calibration, alarms=0.01)
    first = found[0]
    assert first.begins
    assert first.sensor == sensor
    assert CHANGE_S <= first.t_s <= CHANGE_S + 2.5
    assert abs(first.since_s - CHANGE_S) <= 1.25
    names = first.names or [alarm.names for alarm in found if alarm.kind == "named"][-1]
    assert name in {each.name for each in names}, names
    assert any(where in each.where for each in names)
    assert found[-1].kind == "over"
    assert OVER_S <= found[-1].t_s <= OVER_S + 4.0


def test_a_motion_is_noticed_and_not_named(recording: Recording, calibration: Calibration) -> None:
    """Five seconds of an acceleration that swells and fades, forty sigma at most: no effect leaves noise of it."""
    moving = np.where(
        (recording.t > CHANGE_S) & (recording.t < OVER_S), np.sin(1.3 * recording.t) * np.sin(0.2 * recording.t), 0.0
    )
    readings = recording.readings("accelerometer") + 0.5 * moving[:, None] * np.array([1.0, 0.4, -0.6])
    found = watched(replace(recording, accelerometer=readings), calibration, alarms=0.01)
    assert found[0].begins
    assert [alarm.names for alarm in found if alarm.kind == "named"] == [()] * sum(alarm.begins for alarm in found)
    assert "unknown" in found[1].looks_like


def test_a_magnet_by_hand_is_noticed_without_a_calibration() -> None:
    """The estimate so far is what readings are held against: 5 % of the field is 50 sigma and more."""
    run = scenarios.load("camps2009-magnetometer").simulate(seed=3)
    readings = run.readings("magnetometer").copy()
    lasting = (run.t >= 60.0) & (run.t < 90.0)
    readings[lasting] += 0.05 * np.ptp(readings, axis=0) * np.array([0.5, 0.3, -0.4])
    run = replace(run, magnetometer=readings)
    stream = Calibrator(run, Options())
    watch = Watch.of(run, None, None)
    found = []
    for first in range(0, len(run), 5):
        part = run.select(slice(first, first + 5))
        stream.add(part)
        found += watch.add(part)
        if (estimate := stream.state("magnetometer").estimate) is not None:
            watch.refer({"magnetometer": estimate})
    assert [alarm.kind for alarm in found if alarm.kind != "named"] == ["change", "over"]
    assert 60.0 <= found[0].t_s <= 62.0
    assert 90.0 <= found[-1].t_s <= 92.0


def test_what_changes_on_an_accelerometer_turned_by_hand_is_named_from_its_rests() -> None:
    """Fifty sigma on one axis: the motion between the poses, hundreds of sigma, is not taken for noise."""
    scenario = scenarios.load("camps2009-accelerometer")
    run = scenario.simulate(seed=2)
    readings = run.readings("accelerometer") + 0.05 * (run.t >= 120.0)[:, None] * np.array([0.0, 1.0, 0.0])
    found = watched(replace(run, accelerometer=readings), estimators.calibrate(scenario.simulate(seed=1)), alarms=0.01)
    assert found[0].begins
    assert 120.0 <= found[0].t_s <= 132.0  # three poses: an axis that shows ten sigma is within 78 deg of level in 0.8
    named = next(alarm for alarm in found if alarm.kind == "named")
    assert {each.name for each in named.names} == {"bias_step"}, named.names


@pytest.mark.parametrize("attitude", [True, False])
def test_a_calibration_that_never_held_is_noticed_at_once(
    recording: Recording, calibration: Calibration, attitude: bool
) -> None:
    """Thirty sigma from the first sample on: no memory of the noise makes as much, though none of it is known yet."""
    run = replace(recording, magnetometer=recording.readings("magnetometer") + 0.3 * np.array([0.6, -0.6, 0.5]))
    if not attitude:
        run = replace(run, q=None, metadata=replace(run.metadata, arm="none"))
    found = [alarm for alarm in watched(run.select(slice(0, 400)), calibration, alarms=0.01) if alarm.begins]
    assert found[0].t_s < 20.0  # the tool rolls once in eight seconds: every axis is seen along the field
    assert attitude or found[-1].t_s > 60.0  # what is over while the field is across is noticed again


def test_false_alarms_are_no_more_than_stated(calibration: Calibration) -> None:
    """White noise on a sensor at rest, 8 hours of it at 5 Hz, at a stated 60 a day: 20 expected at most, and no more
    than 40 but in one of 30,000 runs. At least one, so that the test can fail; Poisson of 20 / 4 gives none in 1 of
    150 runs, and the rate is above a half of what is stated."""
    own = calibration["magnetometer"]
    pose = scenarios.load("ann-arbor").simulate(seed=2).select(slice(0, 1))
    assert pose.q is not None
    rng = np.random.default_rng(7)
    count, rate = 8 * 3600 * 5, 5.0
    terms = np.concatenate([pose.rotations(None if pose.q is None else _arm())[0], [1.0]])
    from estimators.goodness.residuals import fitted_parameters

    mean = terms @ fitted_parameters(own).coefficients
    assert own.noise is not None
    run = Recording(
        t=np.arange(count) / rate,
        q=np.tile(pose.q, (count, 1)),
        magnetometer=mean + own.noise * rng.standard_normal((count, 3)),
        metadata=replace(pose.metadata, rate_Hz=rate),
    )
    found = [alarm for alarm in watched(run, calibration, alarms=60.0, piece=20_000) if alarm.begins]
    assert 1 <= len(found) <= 40


@pytest.mark.parametrize("tau_s", [0.5, 10.0])
def test_a_noises_memory_raises_no_more_alarms_than_stated(tau_s: float) -> None:
    """Ten hours with a part of the noise that is remembered for tau_s: the mean of 6.4 s strays 1.4 and 2.3 times as
    far as white noise's. 42 alarms stated; more than 70 in one of 20,000 runs."""
    rng = np.random.default_rng(8)
    watch = SensorWatch("magnetometer", "V", 100.0, 100.0 / 10.0, 60.0, True)
    found, level = 0, np.zeros(3)
    phi = np.exp(-0.1 / tau_s)
    for first in range(0, 360_000, 18_000):
        steps = 0.1 * np.sqrt(1.0 - phi**2) * rng.standard_normal((18_000, 3))
        slow, _ = lfilter([1.0], [1.0, -phi], steps, axis=0, zi=phi * level[None])
        level = slow[-1]
        u = rng.standard_normal((18_000, 3))
        blocks = Blocks(
            0.1 * (first + 1.0 + np.arange(18_000)),
            10.0 * slow + np.sqrt(10.0) * rng.standard_normal((18_000, 3)),
            rng.chisquare(27.0, 18_000),
            np.zeros((18_000, 3)),
            u / np.linalg.norm(u, axis=1)[:, None],
        )
        found += sum(alarm.begins for alarm in watch.judge(blocks))
    assert found <= 70


def turned(seconds: float, fast_from_s: float, seed: int) -> tuple[Array, Array]:
    """Times, and readings [m/s^2] at 100 Hz of an accelerometer 0.2 m off the axis about which it turns, by
    0.05 rad/s and from a moment on by some 1 rad/s, the axis 1 rad off the vertical."""
    t = 0.01 * np.arange(round(100.0 * seconds))
    speed = np.where(t < fast_from_s, 0.05, 1.0 + 0.5 * np.sin(1.7 * t))
    angle = 0.01 * np.cumsum(speed)
    up = np.stack([np.sin(1.0) * np.cos(angle), -np.sin(1.0) * np.sin(angle), np.full(len(t), np.cos(1.0))], axis=1)
    motion = 0.2 * np.stack([-np.square(speed), np.gradient(speed, t), np.zeros(len(t))], axis=1)
    noise = 0.03 * np.random.default_rng(seed).standard_normal((len(t), 3))
    return t, (9.8 * up + motion) @ np.diag([1.01, 0.99, 1.005]) + [0.1, -0.05, 0.2] + noise


def test_an_accelerometer_that_is_turned_all_the_time_raises_no_alarm() -> None:
    """Turned faster for two minutes, twice as long as what a resting block is told by, it rests no more than before: a
    motion's acceleration of 0.1 to 0.5 m/s^2, up to sixteen standard deviations, is no change. One false alarm in 100
    days is stated; these are four minutes."""
    rng = np.random.default_rng(3)
    still = np.repeat(9.8 * unit_vectors(rng, 40) @ np.diag([1.01, 0.99, 1.005]) + [0.1, -0.05, 0.2], 300, axis=0)
    still += 0.03 * rng.standard_normal(still.shape)
    units = {"accelerometer": "m_s2"}
    known = estimators.calibrate(
        Recording(t=0.01 * np.arange(len(still)), accelerometer=still, units=units),
        method="ellipsoid",
        noise="residuals",
    )
    t, readings = turned(240.0, 100.0, seed=4)
    assert watched(Recording(t=t, accelerometer=readings, units=units), known, alarms=0.01) == []


def _arm() -> object:
    from rig.arm import Arm

    return Arm.a465()


def test_a_converters_steps_are_no_stuck_channel() -> None:
    rng = np.random.default_rng(1)
    readings = np.round(0.4 * rng.standard_normal((50_000, 3)))  # 8 of 10 samples repeat themselves
    stuck = Stuck("accelerometer", 1.0 / 86400.0 / 100.0)
    assert all(
        stuck.add(0.01 * np.arange(first, first + 100), readings[first : first + 100]) is None
        for first in range(0, 50_000, 100)
    )
    held = np.tile(readings[-1], (600, 1))
    found = stuck.add(500.0 + 0.01 * np.arange(600), held)
    assert found is not None
    assert "repeat" in found.test


def test_a_calibration_of_something_else_is_refused(recording: Recording, calibration: Calibration) -> None:
    volts = replace(recording, units={"accelerometer": "mV", "magnetometer": "V"})
    with pytest.raises(RigError, match="comes in mV"):
        Watch.of(volts, calibration, None)
    only = replace(calibration, sensors={"magnetometer": calibration["magnetometer"]})
    with pytest.raises(RigError, match="expected a sensor that was calibrated"):
        Watch.of(replace(recording, magnetometer=None, units={"accelerometer": "V"}), only, None)
    with pytest.raises(RigError, match="alarms a day"):
        Watch.of(recording, calibration, None, alarms_a_day=0.0)


def test_a_change_hardly_passes_for_noise_however_early_it_comes() -> None:
    """What a window may add to the memory is Fisher's quantile of what is known: the less, the more was seen."""
    memory = Memory((1, 4), 1e-7, 1)
    assert memory.most(0, 1.0) == np.inf
    most = []
    for windows in (20, 180):
        memory.add(0, float(windows), float(windows), 1.0)
        memory.learn(1.0)
        most.append(memory.most(0, 1.0))
    np.testing.assert_allclose(most, f.isf(1e-3, 1.0, [20.0, 200.0]), rtol=1e-9)  # white so far: a ratio of one
