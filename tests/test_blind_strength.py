"""The maker's own arithmetic: whitening, projection, strengths, equivalents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scenarios
from rig.arrays import Array
from rig.effects import EFFECTS, make_effect
from rig.effects.base import Effect
from rig.signals import Signals
from validation.blind.draws import ABSORBED, BY_BEING_THERE, draw_effect
from validation.blind.floors import Colour, Floor
from validation.blind.forms import FORMS, SecondOrderLag
from validation.blind.laboratories import LABORATORIES
from validation.blind.likeness import in_band, likenesses
from validation.blind.outside import JOINTED, OUTSIDE
from validation.blind.settings import FAST, RATE_HZ, Setting, draw_setting
from validation.blind.strength import signal_to_noise, strength_for

SAMPLES = 800
SIGMA = (0.013, 0.014, 0.015, 0.008, 0.007, 0.012)
COLOURS = {"accelerometer": (Colour(0.5, 1.3),), "magnetometer": (Colour(0.2, 0.4), Colour(0.2, 2.0), Colour(0.2, 9.0))}


@pytest.fixture(scope="module")
def setting() -> Setting:
    return draw_setting(scenarios.load("ann-arbor"), SAMPLES, np.random.default_rng(5))


def covariance(floor: Floor, sensor: str, count: int) -> Array:
    """Of one channel's noise over its variance, from the definition of its parts."""
    colours = floor.colours.get(sensor, ())
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) / RATE_HZ
    total = (1.0 - sum(each.share for each in colours)) * np.eye(count)
    for each in colours:
        total += each.share * np.exp(-lag / each.tau_s)
    return total


@pytest.mark.parametrize(("sensor", "column"), [("accelerometer", 0), ("magnetometer", 4)])
def test_whitening_makes_the_floor_white(sensor: str, column: int) -> None:
    """W C W' = 1: to 1e-9, as the filter's gain is held once it moves by less than 1e-12."""
    count = 200
    floor = Floor(SIGMA, COLOURS)
    unit = np.zeros((count, 6, count))
    unit[:, column] = np.eye(count)
    whitener = floor.whiten(unit, 1.0 / RATE_HZ)[:, column]
    noise = SIGMA[column] ** 2 * covariance(floor, sensor, count)
    np.testing.assert_allclose(whitener @ noise @ whitener.T, np.eye(count), atol=1e-9)


def test_the_remembering_parts_have_the_stated_covariance() -> None:
    """400 realisations of 300 samples: a mean square over 120,000 values is good to 4 standard deviations of 1 %."""
    floor = Floor((1.0,) * 6, {"accelerometer": (Colour(1.0 - 1e-12, 1.0),)})
    (part,) = floor.effects
    rng = np.random.default_rng(1)
    t = np.arange(300) / RATE_HZ
    runs = np.stack([part.apply(Signals(t=t, volts=np.zeros((300, 6))), rng).volts[:, :3] for _ in range(400)])
    decay = np.exp(-1.0 / RATE_HZ)
    assert np.mean(runs**2) == pytest.approx(1.0, abs=0.04)
    assert np.mean(runs[:, 4:] * runs[:, :-4]) == pytest.approx(decay**4, abs=0.04)


def test_signal_to_noise_is_that_of_generalised_least_squares(setting: Setting) -> None:
    """Against dense algebra: d'C^-1 d less what the tangent by finite differences of all 28 parameters takes up."""
    floor = Floor(SIGMA, COLOURS)
    coloured = replace(setting, floor=floor)
    change = coloured.change((make_effect("backlash", {"where": "joint5", "width_rad": 0.01}),))
    expected = 0.0
    for sensor, columns in (("accelerometer", slice(0, 3)), ("magnetometer", slice(3, 6))):
        inverse = np.linalg.inv(covariance(floor, sensor, SAMPLES))
        white = np.linalg.cholesky(inverse).T
        sigma = np.asarray(SIGMA[columns])
        d = (white @ (change[:, columns] / sigma)).ravel()
        tangent = numerical_tangent(coloured, sensor)[:, columns] / sigma[:, None]
        T = np.einsum("ab,bck->ack", white, tangent).reshape(len(d), -1)
        left, singular, _ = np.linalg.svd(T / np.linalg.norm(T, axis=0), full_matrices=False)
        basis = left[:, singular > 1e-6 * singular[0]]  # finite differences: psi or gamma may not be told
        expected += float(d @ d - np.sum((basis.T @ d) ** 2))
    assert coloured.projection.snr(change) == pytest.approx(np.sqrt(expected), rel=1e-4)


def numerical_tangent(setting: Setting, sensor: str) -> Array:
    """(n, 6, 14) central differences of the readings by every number of a sensor and its field."""
    pipeline, signals = setting.rig.pipeline, setting.ideal
    columns = []
    truth = getattr(pipeline, sensor)
    for name in ("sensitivity", "offset", "beta_deg", "gamma_deg"):
        for axis in range(3):
            sides = []
            for step in (1e-4, -1e-4):
                values = list(getattr(truth, name))
                values[axis] += step
                moved = replace(pipeline, **{sensor: replace(truth, **{name: tuple(values)})})
                sides.append(moved.expected(signals, np.random.default_rng(0)).volts)
            columns.append((sides[0] - sides[1]) / 2e-4)
    key = "gravity_direction" if sensor == "accelerometer" else "magnetic_direction"
    for axis in range(3):
        sides = []
        for step in (1e-4, -1e-4):
            towards = np.array(getattr(pipeline.environment, key))
            towards[axis] += step
            moved = replace(pipeline, environment=replace(pipeline.environment, **{key: tuple(towards)}))
            sides.append(moved.expected(signals, np.random.default_rng(0)).volts)
        columns.append((sides[0] - sides[1]) / 2e-4)
    return np.stack(columns, axis=2)


@pytest.mark.parametrize(("name", "where", "values"), ABSORBED)
def test_absorbed_effects_leave_nothing(setting: Setting, name: str, where: str, values: dict[str, float]) -> None:
    """Beside changes that would be seen: rounding, and what is quadratic in a twist of milliradians."""
    change = setting.change((make_effect(name, {"where": where, **values}),))
    assert np.linalg.norm(setting.floor.whiten(change, 1.0 / RATE_HZ)) > 5.0
    assert setting.projection.snr(change) < 0.1
    assert np.abs(setting.projection.left_over(change)).max() < 1e-2 * np.abs(change).max()


def test_left_over_has_the_same_signal_and_none_of_the_tangent(setting: Setting) -> None:
    change = setting.change((make_effect("scale_cubic", {"where": "mag2", "fraction_of_full": 0.01}),))
    left = setting.projection.left_over(change)
    assert setting.projection.snr(left) == pytest.approx(setting.projection.snr(change), rel=1e-9)
    assert np.linalg.norm(setting.floor.whiten(left, 1.0 / RATE_HZ)) == pytest.approx(
        setting.projection.snr(change), rel=1e-6
    )


@pytest.mark.parametrize(
    "name", [name for name, effect in EFFECTS.items() if name not in BY_BEING_THERE and not effect.of_log]
)
def test_every_effect_of_the_catalogue_can_be_as_strong_as_wanted(setting: Setting, name: str) -> None:
    """Outliers and repeats come in whole readings: one more or less is up to a few tenths of 30."""
    make = draw_effect(name, np.random.default_rng(3), setting)
    effect, snr = strength_for(make, 30.0, setting)
    loose = name in ("outliers", "dropouts")
    assert snr == pytest.approx(30.0, rel=0.9 if loose else 0.02)
    assert snr == pytest.approx(signal_to_noise((effect,), setting), rel=1e-12)
    assert type(effect) is EFFECTS[name]


MAKERS = {**OUTSIDE, **{name: make for name, (_, make) in FORMS.items()}}


@pytest.mark.parametrize("name", MAKERS)
def test_other_effects_vanish_at_zero_and_are_not_in_the_catalogue(setting: Setting, name: str) -> None:
    make = MAKERS[name](np.random.default_rng(4), setting)
    weak, strong = make(0.0), make(1.0)
    assert name not in EFFECTS
    assert type(strong).name not in EFFECTS
    assert isinstance(strong, Effect)
    if name == "flicker":
        assert not weak.added_spectrum(np.array([0.1]), 0.25).any()
        assert strong.added_spectrum(np.array([0.1]), 0.25) > 0.0
        return
    # a play of no width and a filter of no time still go through their arithmetic: rounding of volts
    np.testing.assert_allclose(setting.change((weak,)), 0.0, atol=1e-12)
    assert setting.projection.snr(setting.change((strong,))) > 0.1


def test_a_twin_is_found_and_a_stranger_is_not(setting: Setting) -> None:
    """Joint offsets of joints 5, 2 and 3 are the same on this sweep (catalogue); a step of one channel is not."""
    effect, _ = strength_for(
        lambda s: make_effect("joint_offset", {"where": "joint5", "offset_rad": 1e-3 * s}), 30.0, setting
    )
    found = {(each.effect, each.where): each.left for each in likenesses(setting.change((effect,)), setting)}
    for where in ("joint2", "joint3", "joint5"):
        assert found["joint_offset", where] < 0.2
    assert ("bias_step", "accel1") not in found
    assert ("joint_offset", "joint1") not in found


def test_a_lag_of_second_order_is_a_delay(setting: Setting) -> None:
    """1 / (1 + sqrt(2) s + s^2) is exp(-sqrt(2) s) to second order in s = i w tau: at 30 standard deviations nothing
    is left but the third, while a multiple of a short delay leaves the second."""
    lag, _ = strength_for(lambda s: SecondOrderLag("accelerometer", 0.05 * s), 30.0, setting)
    found = {(each.effect, each.where): each.left for each in likenesses(setting.change((lag,)), setting)}
    assert found["latency", "accelerometer"] < 1.0


def test_a_tone_is_compared_within_its_band_only(monkeypatch: pytest.MonkeyPatch) -> None:
    hum, shaking = EFFECTS["mains_hum"], EFFECTS["vibration"]
    monkeypatch.setattr(hum, "bands", ((49.9, 50.1),))
    assert in_band(hum, 50.03)
    assert in_band(hum, 13.97)  # folds to 2 Hz as 50.03 Hz does
    assert not in_band(hum, 13.0)
    assert in_band(shaking, 13.0)


def test_fast_sweeps_stay_within_the_joints(setting: Setting) -> None:
    fast = draw_setting(scenarios.load("ann-arbor"), SAMPLES, np.random.default_rng(6), sweeps=FAST)
    moving = replace(fast, inertial=True)
    assert len(moving.ideal) == SAMPLES
    assert fast.projection.snr(moving.ideal.volts - fast.ideal.volts) > 10.0


@pytest.mark.parametrize("name", [name for name in OUTSIDE if name not in JOINTED])
def test_what_is_outside_shows_beside_logged_poses(name: str) -> None:
    """At a signal-to-noise of 100 the readings miss the rig at the logged poses by 10,000 squares more than by their
    noise; half of that is 25 standard deviations of 4,800 squares above them."""
    rng = np.random.default_rng(11)
    setting = draw_setting(scenarios.load("ann-arbor"), SAMPLES, rng, laboratory=LABORATORIES["tool poses"])
    effect, snr = strength_for(OUTSIDE[name](rng, setting), 100.0, setting)
    recording = setting.record((effect,), rng, name)
    seen = replace(setting.ideal, R_base_tool=recording.rotations(None).reshape(-1, 3, 3))
    rig = replace(setting.rig.pipeline, effects=()).expected(seen, np.random.default_rng(0))
    readings = np.hstack([recording.readings(sensor) for sensor in recording.sensors])
    missed = setting.projection.snr(readings - rig.volts) ** 2
    assert missed > 0.5 * snr**2 + SAMPLES * 6
