"""Static detection: what is still is found, and what moves is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from stillness_examples import NOISE, SKY, at_rest, rig, stops

import estimators.stillness.threshold
from estimators.stillness import (
    CAMPS_THRESHOLD_V2,
    Stillness,
    choose_threshold,
    find_still,
    windowed_variance,
)
from estimators.stillness.variance import variance_by_half_windows, weighted_variance
from rig.acquisition import Acquisition
from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RefusedFit, RigError
from rig.maneuver import HandTumble, TorusSweep
from rig.recording import Recording
from rig.sensor import TriaxialSensor
from rig.simulate import Rig

# The sliding variance


@pytest.mark.parametrize("offset", [0.0, 33_000.0])
def test_the_variance_is_that_of_each_window(offset: float) -> None:
    rng = np.random.default_rng(4)
    n, window = 40_000, 101  # three blocks
    signal = rng.normal(size=n) + 50.0 * np.sin(np.arange(n) / 700.0) + offset
    found = windowed_variance([signal, -2.0 * signal], window)
    wanted = np.lib.stride_tricks.sliding_window_view(signal, window).var(axis=-1, ddof=1)
    # Running sums about a sample of the block: 16,000 additions of squares up to 1e4 round by some 1e-16 of them each.
    assert found[0, 50:-50] == pytest.approx(wanted, abs=1e-13 * 1e4 * 100)
    assert found[1] == pytest.approx(4.0 * found[0], rel=1e-6)
    assert (found[0, :50] == found[0, 50]).all()
    assert (found[0, -50:] == found[0, -51]).all()


@pytest.mark.parametrize("n", [101, 151, 200, 40_000])
def test_sums_over_channels_and_half_windows_are_of_the_same_variances(n: int) -> None:
    rng = np.random.default_rng(4)
    window, half, weights = 101, 50, np.array([2.0, 0.1])
    channels = [rng.normal(size=n) + 5.0 * np.sin(np.arange(n) / 700.0), 30.0 + 3.0 * rng.normal(size=n)]
    wanted = windowed_variance(channels, window)
    # 16,000 additions of squares below 4e3 round by some 1e-16 of their sum each, at worst all to the same side.
    assert weighted_variance(channels, window, weights) == pytest.approx(weights @ wanted, abs=1e-12 * 4e3)
    variance, means = variance_by_half_windows(channels, window)
    assert variance == pytest.approx(wanted[:, half : n - half : half], abs=1e-12 * 4e3)
    for own, values in zip(means, channels, strict=True):
        assert own == pytest.approx(values[: len(own) * half].reshape(-1, half).mean(axis=1), abs=1e-14 * 50.0)


@pytest.mark.parametrize("window", [100, 1, 101])
def test_a_window_that_does_not_fit_is_refused(window: int) -> None:
    with pytest.raises(RigError, match="expected an odd number"):
        windowed_variance([np.zeros(100)], window)


# The threshold that is chosen


def test_the_false_alarm_rate_is_the_stated_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of independent windows of white noise so many exceed the threshold as it says.

    Two widths instead of five, so that there are some to be counted. The stated rate rests on the peak found in the
    same 20,000 windows, which is good to a tenth of its width, hence 30 % in the rate; and the count itself scatters by
    its root. Five standard deviations of the latter fail once in 2 million.
    """
    monkeypatch.setattr(estimators.stillness.threshold, "WIDTHS", 2.0)
    window, m = 51, 20_000
    windows = np.random.default_rng(5).normal(size=(6, m, window)) * np.array(NOISE)[:, None, None]
    variance = windows.var(axis=2, ddof=1)
    found = choose_threshold(variance, window)
    above = ((variance / found.floor[:, None]).mean(axis=0) > found.limit).sum()
    expected = m * found.false_alarm
    assert 100 < expected < 1000
    assert abs(above - expected) < 5.0 * np.sqrt(expected) + 0.3 * expected
    # The floor is the mean of 6 x 20,000 x 50 squares less the few above: 0.13 % and 1 %.
    assert np.sqrt(found.floor) == pytest.approx(NOISE, rel=0.015)


def test_a_sensor_at_rest_is_at_rest_throughout() -> None:
    """The chosen threshold has a false alarm rate of some 1e-8 a window; here are 2,000 of them in ten recordings."""
    for seed in range(10):
        found = find_still(at_rest(20_000, seed=seed))
        assert found.still.all()
        assert found.poses == 1
        assert found.false_alarm is not None
        assert found.false_alarm < 1e-7


def test_the_threshold_is_found_although_most_of_the_time_it_moves() -> None:
    """Still for a fifth of the time, with motion of any size from that of the noise on."""
    rng = np.random.default_rng(6)
    window, m = 101, 4000
    still = 0.01**2 * rng.chisquare(300, m // 5) / 300
    moving = 0.01**2 * np.exp(rng.uniform(1.0, 9.0, m - m // 5))
    found = choose_threshold(np.tile(np.concatenate([still, moving]), (3, 1)), window)
    # 800 windows with chi-square of 300 degrees: their mean is good to 0.3 %, and few of the moving ones slip under.
    assert np.sqrt(found.floor) == pytest.approx(0.01, rel=0.02)
    assert 1.3 < found.limit < 2.0  # five widths of sqrt(2/300) = 0.08, or a little more


# Detection


def check_found(found: Stillness, holding: NDArray[np.bool_], motion: Array, poses: int) -> None:
    """All holds, nearly all of their samples, and beyond them only what has moved by less than the noise."""
    assert found.poses == poses
    assert (found.still & holding).sum() > 0.9 * holding.sum()
    beyond = found.still & ~holding
    assert beyond.sum() < 0.02 * len(holding)
    assert motion[beyond].max(initial=0.0) < 1.0


def strayed(recording: Recording, clean: Recording, holding: NDArray[np.bool_]) -> Array:
    """(n,) how far the noiseless reading is from the nearest hold's in time, in standard deviations of the noise."""
    held = np.flatnonzero(holding)
    after = np.searchsorted(held, np.arange(len(holding))).clip(max=len(held) - 1)
    before = (after - 1).clip(min=0)
    far = np.full(len(holding), np.inf)
    for near in (held[after], held[before]):
        apart = np.max(np.abs(clean.readings("accelerometer") - clean.readings("accelerometer")[near]), axis=1)
        far = np.minimum(far, apart / NOISE[0])
    return np.asarray(far)


@pytest.mark.parametrize("threshold", [None, 4e-4], ids=["chosen", "given"])
@pytest.mark.parametrize("with_pose", [False, True], ids=["readings", "readings and encoders"])
def test_the_stops_of_an_arm_are_found(threshold: float | None, with_pose: bool) -> None:
    maneuver, run = stops()
    clean = replace(rig(Arm.a465()), acquisition=Acquisition(decimation=1, bits=None)).simulate(
        maneuver, np.random.default_rng(0)
    )
    holding = maneuver.holding(run.t)
    found = find_still(run if with_pose else replace(run, q=None), threshold=threshold)
    check_found(found, holding, strayed(run, clean, holding), 20)
    assert found.noise[:3] == pytest.approx(NOISE[:3], rel=0.03)  # 20 x 300 samples: 0.9 %, and the converter's 0.1 %


def test_the_threshold_of_camps_finds_poses_held_by_hand() -> None:
    """Their gains, 1.8 V/g, and 600 points; in 0.0016 V^2 is motion of 40 mV RMS, 1.3 degrees."""
    tumble = HandTumble(seed=2, duration_s=120.0, hold_s=3.0, move_s=2.0)
    gain = 1.8 / 9.8
    sensor = TriaxialSensor((gain,) * 3, (0.0, 0.0, 0.0), (0.0, 0.0, -90.0), (0.0, 90.0, 0.0))
    board = Acquisition((0.005,) * 6, range_V=None, decimation=1, pose="none")
    run = Rig(None, SKY, sensor, None, board).simulate(tumble, np.random.default_rng(3), motion="inertial")
    holding = tumble.holding(run.t)
    found = find_still(run, threshold=CAMPS_THRESHOLD_V2)
    assert found.false_alarm is None
    assert found.poses == 24
    assert (found.still & holding).sum() > 0.85 * holding.sum()
    assert (found.still & ~holding).sum() < 0.05 * len(run)  # 40 mV, against a motion of volts in two seconds
    chosen = find_still(run)
    assert chosen.poses == 24
    assert (chosen.still & ~holding).sum() < (found.still & ~holding).sum()  # tighter: the noise is 5 mV


def test_encoders_see_what_gravity_does_not() -> None:
    """A turn about the vertical: the accelerometer reads the same all the time."""
    run = at_rest(3000)
    yaw = np.interp(run.t, [0.0, 10.0, 15.0, 30.0], [0.0, 0.0, 1.0, 1.0])
    turned = replace(run, q=np.column_stack([yaw, np.full(3000, 0.5)]))
    assert find_still(run).poses == 1
    found = find_still(turned)
    assert found.poses == 2
    # 2 mrad in a window of one second, at 0.2 rad/s: a sample or two.
    assert found.first.tolist() == pytest.approx([0, 1500], abs=2)
    assert found.stop.tolist() == pytest.approx([1000, 3000], abs=2)
    quaternion = np.column_stack([np.cos(yaw / 2), np.zeros(3000), np.zeros(3000), np.sin(yaw / 2)])
    by_tool = find_still(replace(run, tool_quaternion=quaternion))
    assert by_tool.first.tolist() == pytest.approx(found.first.tolist(), abs=2)
    assert by_tool.poses == 2


def test_a_knock_is_no_new_pose() -> None:
    run = at_rest(3000)
    knocked = np.array(run.accelerometer)
    knocked[1500:1510] += 0.5
    found = find_still(replace(run, accelerometer=knocked))
    assert len(found.first) == 2
    assert found.poses == 1
    assert not found.still[1500:1510].any()


def test_a_drift_too_slow_for_any_window_is_cut_into_poses() -> None:
    """0.3 V in a hundred seconds is 3 mV in a window, a third of the noise; 3 standard deviations of it are 30 mV."""
    run = at_rest(10_000)
    drift = np.linspace(0.0, 0.3, 10_000)[:, None]
    found = find_still(replace(run, accelerometer=run.accelerometer + drift))
    assert found.still.all()
    assert found.poses == pytest.approx(10, abs=2)
    spans = [float(drift[b - 1, 0] - drift[a, 0]) for a, b in zip(found.first, found.stop, strict=True)]
    assert max(spans) < 0.03 + 2 * 0.003 + 0.005  # to the next window's end, and 1 mV of noise in either's mean
    assert min(spans[:-1]) > 0.03 - 0.005


def test_what_never_stands_still_is_refused() -> None:
    sweep = TorusSweep(duration_s=60.0)
    run = rig(Arm.a465()).simulate(sweep, np.random.default_rng(7))
    with pytest.raises(RefusedFit, match="never stands still: its pose turns faster"):
        find_still(run)
    with pytest.raises(RefusedFit, match=r"never stands still: in its quietest windows .* a steady motion"):
        find_still(replace(run, q=None))
    with pytest.raises(RefusedFit, match="never stands still for"):
        find_still(replace(run, q=None), threshold=1e-5)


def test_readings_without_noise_are_found_too() -> None:
    readings = np.full((3000, 3), 2.5)
    readings[1000:1500] += np.linspace(0.0, 1.0, 500)[:, None] ** 2
    readings[1500:] += 1.0
    found = find_still(at_rest(3000, accelerometer=readings))
    assert found.poses == 2
    assert found.stop[0] < 1060  # the parabola's first tenth stays within 1 % of its height
    assert found.first[1] >= 1500 - 5


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"window_s": 0.0}, "window_s"),
        ({"window_s": 100.0}, "at least the window's"),
        ({"threshold": -1.0}, "expected a positive variance"),
        ({"threshold": {"magnetometer": 1.0}}, "unknown recorded sensor 'magnetometer'"),
        ({"sensors": ("magnetometer",)}, "has no magnetometer"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, object], match: str) -> None:
    with pytest.raises(RigError, match=match):
        find_still(at_rest(500), **options)  # type: ignore[arg-type]


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(RigError, match="11 or more"):
        find_still(at_rest(10))
