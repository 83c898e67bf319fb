"""The floor of poses at rest with readings at a limit, or with spikes: that of the noise alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scenarios
from estimators.gap.data.basefit import learn_floor
from estimators.gap.floor.censored import uncut
from estimators.gap.floor.clean_rest import sound
from estimators.gap.floor.colour import held
from rig.effects import Effect, make_effect
from rig.effects.tails import limit
from rig.errors import RigError

POSES, COUNT = 3, 4000
LABELS = np.repeat(np.arange(POSES), COUNT)
MEANS = np.array([0.0, 40.0, -30.0])


def variance(segments: list[np.ndarray]) -> float:
    return float(np.mean(np.concatenate([each - each.mean() for each in segments]) ** 2))


def drawn(seed: int, degrees: float = np.inf) -> np.ndarray:
    """Three poses, one after the other; noise of scale one."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal if np.isinf(degrees) else lambda count: rng.standard_t(degrees, count)
    return np.concatenate([mean + noise(COUNT) for mean in MEANS])


@pytest.mark.parametrize("degrees", [np.inf, 3.0, 5.0, 8.0])
@pytest.mark.parametrize("step", [0.0, 0.1, 1.5])
def test_noise_alone_stays_as_it_is(degrees: float, step: float) -> None:
    values = drawn(1, degrees)
    values = np.round(values / step) * step if step else values
    segments, known = sound(values, LABELS, step)
    assert known == 1.0
    assert np.array_equal(np.concatenate(segments), values)


@pytest.mark.parametrize("beyond", [-0.5, 0.43, 2.0])
@pytest.mark.parametrize("top", [True, False])
def test_poses_at_a_limit_are_left_out_where_others_are_not(beyond: float, top: bool) -> None:
    """Of the highest pose, or the lowest, 69 to 2 % are at the limit."""
    values = drawn(2)
    clipped = np.minimum(values, MEANS.max() + beyond) if top else np.maximum(values, MEANS.min() - beyond)
    segments, known = sound(clipped, LABELS, 0.0)
    cut = np.argmax(MEANS) if top else np.argmin(MEANS)
    assert known == 1.0
    assert np.array_equal(np.concatenate(segments), values[cut != LABELS])


@pytest.mark.parametrize(
    ("limits", "left"),
    [((MEANS.min() - 0.4, MEANS.max() + 0.4), LABELS == 0), ((-np.inf, 20.0), LABELS != 1)],
    ids=["on both sides leave the pose between", "that a whole pose is at leave the others"],
)
def test_limits(limits: tuple[float, float], left: np.ndarray) -> None:
    values = drawn(3)
    segments, _ = sound(np.clip(values, *limits), LABELS, 0.0)
    assert np.array_equal(np.concatenate(segments), values[left])


@pytest.mark.parametrize("beyond", [-0.5, 0.43, 1.5])
def test_where_no_pose_is_free_the_tail_is_filled_up(beyond: float) -> None:
    """200 draws of one pose of 2,000, with 69, 33 and 7 % at the limit: no bias, and as well known as is said.

    The mean of 200 has a fourteenth of one draw's deviation: four of these, and a second-order bias below one. Their
    scatter has a deviation of 5 %: four.
    """
    rng, found, said = np.random.default_rng(5), [], []
    for _ in range(200):
        values = np.minimum(rng.standard_normal(2000), beyond)
        segments, known = uncut([values], [values == beyond], 0.0)
        found.append(0.5 * np.log(variance(segments)))
        said.append(1.0 / np.sqrt(2.0 * known * 2000))
    deviation = float(np.mean(said))
    assert abs(np.mean(found)) < 5.0 * deviation / np.sqrt(200)
    assert np.std(found) == pytest.approx(deviation, rel=0.2)


def test_a_converter_rounds_to_the_limit_as_well() -> None:
    """One in six readings of a step's width below the limit is rounded up to it: half a step less is the limit."""
    rng, step = np.random.default_rng(6), 0.5
    values = np.minimum(np.round(rng.standard_normal(40_000) / step) * step, 0.5)
    segments, known = uncut([values], [values == 0.5], step)
    deviation = np.sqrt(2.0 / (known * 40_000))
    assert variance(segments) == pytest.approx(1.0 + step**2 / 12.0, abs=4.0 * deviation)


@pytest.mark.parametrize(("share", "size"), [(3e-4, 35.0), (1e-3, 8.0), (1e-2, 15.0), (3e-2, 12.0)])
def test_spikes_are_no_part_of_the_floor(share: float, size: float) -> None:
    """Four deviations of the variance of 12,000 readings, a tenth more for those that repeat a neighbour."""
    rng, values = np.random.default_rng(7), drawn(7)
    hit = rng.random(len(values)) < share
    spiky = values + np.where(hit, size * rng.choice([-1.0, 1.0], len(values)), 0.0)
    segments, known = sound(spiky, LABELS, 0.0)
    assert known == 1.0
    assert variance(segments) == pytest.approx(1.0, abs=4.4 * np.sqrt(2.0 / len(values)))
    left = np.concatenate(segments)
    assert np.array_equal(left[~hit], values[~hit])


def test_long_tails_with_spikes_keep_their_tails() -> None:
    """Student's noise of five degrees, and six readings as far out as it comes once in 10^11: the six go, and of the
    tails all that comes oftener than once in 3 * 10^5 stays."""
    values = drawn(8, 5.0)
    spiky = values.copy()
    spiky[1000:7000:1000] += 150.0
    segments, _ = sound(spiky, LABELS, 0.0)
    left, there = np.concatenate(segments), np.arange(len(values))
    ordinary = (np.abs(values - MEANS[LABELS]) < limit(1.0 / 3e5, 5.0)) & ~np.isin(there, there[1000:7000:1000])
    assert np.array_equal(left[ordinary], values[ordinary])
    assert np.abs(left[1000:7000:1000] - MEANS[LABELS[1000:7000:1000]]).max() < 20.0


def floor_mV(effect: Effect) -> np.ndarray:
    """(3,) what a locked recording of Table 2's rig with an effect shows, poses of 20 s."""
    scenario = scenarios.load("renk2005-table2").with_effects([effect])
    brief = replace(scenario, locked=replace(scenario.locked, hold_s=20.0))
    floor = learn_floor(brief.simulate_locked(1), 0.2)[:3]
    return np.array([1e3 * np.sqrt(channel.variance + channel.tails) for channel in floor])


@pytest.mark.parametrize(
    "effect",
    [
        make_effect("saturation", {"where": "accel1", "level": 1.4701 - 0.43 * 0.0134}),  # a third of the lowest pose
        make_effect("saturation", {"where": "accel1", "level": 2.4506 + 0.43 * 0.0134}),  # all of that, most of others
        make_effect("outliers", {"where": "acquisition", "share": 1e-3, "size_V": 0.5}),
    ],
)
def test_the_floor_of_the_rig_is_found_beside_an_effect_on_single_readings(effect: Effect) -> None:
    """Thinned to one in five, 12,000 readings tell the floor to 0.65 %, and a tenth of them, where most are at the
    limit, to 2 %: four of these, and 0.2 % that the converter adds."""
    found = floor_mV(effect)
    at_a_limit = effect.name == "saturation"
    within = np.array([0.082 if at_a_limit else 0.03, 0.03, 0.03])
    assert np.all(np.abs(found / [13.4, 13.6, 14.6] - 1.0) < within)


def test_a_file_that_is_rounded_beyond_its_noise_is_refused() -> None:
    """The noise of readings at rest that stay at two values is not known, whatever the sweep's converter is."""
    locked = scenarios.load("ann-arbor").simulate_locked(0)
    assert locked.magnetometer is not None
    two = 0.1 * (np.random.default_rng(5).random(locked.magnetometer.shape) < 0.1)
    with pytest.raises(RigError, match=r"mag1 stays at 2 values at rest, expected readings that show its noise$"):
        learn_floor(replace(locked, magnetometer=two), 0.25, np.zeros(6))


@pytest.mark.parametrize("size", [1e-13, 2e-10])
def test_readings_that_are_one_number_but_for_rounding_are_refused(size: float) -> None:
    """Arithmetic on a constant leaves many values of it, which are no noise."""
    locked = scenarios.load("ann-arbor").simulate_locked(0)
    assert locked.magnetometer is not None
    rounded = locked.magnetometer.copy()
    rounded[:, 1] = 0.3 + size * np.random.default_rng(5).standard_normal(len(rounded))
    with pytest.raises(RigError, match=r"mag2 is constant, expected its noise at rest$"):
        learn_floor(replace(locked, magnetometer=rounded), 0.25)


@pytest.mark.parametrize("readings", [200, 5])
def test_series_between_each_other_show_what_is_slow_once(readings: int) -> None:
    """However many of them are long enough to be one: of five readings a pose, one of four is."""
    poses = [np.arange(float(readings)) for _ in range(3)]
    of_all, of_series = held(poses, 0.05), held(poses, 0.05, stride=4, most=4)
    assert of_series.poses == 3
    assert of_series.lasted[0] == pytest.approx(of_all.lasted[0], abs=3 * 4 * 0.05)
    assert of_series.lasted[0] >= 0.5 * of_all.lasted[0]


def test_a_supply_that_drifts_at_rest_is_learned() -> None:
    """Lags that are cut off are no autocovariance of what lasts for longer: a matrix of them once had no factor."""
    rng = np.random.default_rng(2)
    supply = {"where": "supply", "waveform": tuple(0.003 * rng.standard_normal(24)), "supply_V": 0.0}
    scenario = scenarios.load("ann-arbor").with_effects([make_effect("supply_ratiometric", supply)])
    floor = learn_floor(scenario.simulate_locked(3), 0.25)
    assert all(np.isfinite(noise.variance) and noise.variance > 0.0 for noise in floor)
