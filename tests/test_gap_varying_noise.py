"""Noise whose size follows something, and noise that only looks as if it remembered: neither has a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import scenario as small
from whitened_examples import data, recorded  # noqa: F401

import estimators
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.named_noise import named
from estimators.gap.evidence.states import NoiseState, left_of
from estimators.gap.evidence.varying_noise import varying
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left
from rig.arm import Arm
from rig.effects import EFFECTS, make_effect
from rig.effects._numerics import gauss_markov

#: Noise, but for what all channels share.
NAMES = ("noise_excess", "noise_coloured", "bias_random_walk")


def residual(data: WhitenedData, seed: int, sizes: np.ndarray) -> np.ndarray:
    """White noise of all channels, and of the accelerometer some that remembers two readings, of sizes (n, 3)."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((6, data.count))
    own = gauss_markov(data.t, 2.0 * data.interval_s, rng.standard_normal((data.count, 3)))
    white[:3] += (2.0 * own * sizes).T
    return white.ravel()


def states(data: WhitenedData, left: np.ndarray) -> tuple[list[NoiseState], list[NoiseState]]:
    return states_of(left_of(data, Explained(data.absorbed, left)))


def states_of(lefts: Sequence[Left]) -> tuple[list[NoiseState], list[NoiseState]]:
    """Noise with a name, and of a size that follows something: beyond nothing, then in the form of the likeliest."""
    own = named(lefts, [name for name in EFFECTS if name not in NAMES], NoiseState())
    return own, varying(own, NoiseState(), lefts)


def test_noise_that_grows_with_the_field_is_told_in_that_form(data: WhitenedData) -> None:
    """Of twice the floor on average: dozens of nats on 4,992 readings."""
    field = np.abs(data.base.inputs[:, :3])
    for seed in range(3):
        own, (_, found) = states(data, residual(data, seed, field / np.sqrt(np.mean(field**2, axis=0))))
        best = max(own, key=lambda each: each.fitted[-1].gain)
        assert best.labels == ("noise_coloured@accelerometer",)
        assert found.other
        assert not found.fitted
        further = found.steps[len(best.steps) :]
        assert [step.column for step in further] == [0, 1, 2]
        for step in further:
            root = 1.0 / step.factor
            assert np.mean(root**2) == pytest.approx(1.0, rel=0.1)
            assert np.corrcoef(root, field[:, step.column])[0, 1] > 0.8


def test_noise_that_is_louder_one_way_up_is_no_noise_of_one_strength(data: WhitenedData) -> None:
    """White noise of twice the floor, where an axis points down: by its variance throughout it is an excess."""
    up = data.base.inputs[:, 2] > 0.0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        left = rng.standard_normal((6, data.count))
        left[2] += 2.0 * up * rng.standard_normal(data.count)
        own, (alone, found) = states(data, left.ravel())
        best = max(own, key=lambda each: each.fitted[-1].gain)
        assert best.labels == ("noise_excess@accel3",)
        (step,) = found.steps[len(best.steps) :]
        assert np.corrcoef(1.0 / step.factor, up)[0, 1] > 0.8
        assert alone.follows == "level"


def test_each_recording_has_its_own_course_of_what_noise_follows(data: WhitenedData, arm: Arm) -> None:
    """Of two, the second half as long and on its own path: louder one way up in both."""
    run = recorded(2, decimation=200)
    lefts = []
    for number, each in enumerate((data, set_up(run, estimated_floor(run, arm), arm))):
        rng, up = np.random.default_rng(number), each.base.inputs[:, 2] > 0.0
        left = rng.standard_normal((6, each.count))
        left[2] += 2.0 * up * rng.standard_normal(each.count)
        lefts.append(Left(each, Explained(each.absorbed, left.ravel())))
    *_, found = states_of(lefts)[1]
    for step in found.steps:
        if step.in_time:
            up = lefts[step.part].data.base.inputs[:, 2] > 0.0
            assert np.corrcoef(1.0 / step.factor, up)[0, 1] > 0.8
    assert {step.part for step in found.steps if step.in_time} == {0, 1}


def test_noise_that_is_no_louder_on_average_is_told_where_it_follows_something(data: WhitenedData) -> None:
    """Of each channel, its RMS 20 % larger at one end of its range and as much smaller at the other: no excess tells
    that. A quarter of a nat times the square of the variance's logarithm a reading: some hundreds on 9,984."""
    inputs = data.base.inputs
    level = 2.0 * (inputs - inputs.min(axis=0)) / np.ptp(inputs, axis=0) - 1.0
    for seed in range(3):
        left = np.random.default_rng(seed).standard_normal((6, data.count)) * (1.0 + 0.2 * level.T)
        _, (found, *_) = states(data, left.ravel())
        assert found.other
        assert found.follows == "level"
        assert {step.column for step in found.steps} == set(range(6))


def test_noise_without_a_name_stays_that_beside_a_floor() -> None:
    """Whichever is learned first."""
    nameless, floor = NoiseState("noise", other=True, follows="level"), NoiseState("floor")
    for found in (nameless.beyond(floor), floor.beyond(nameless)):
        assert (found.name, found.other, found.follows) == ("noise", True, "level")


def test_noise_of_one_size_is_in_no_other_form(data: WhitenedData) -> None:
    """Thirty families, of which the likeliest is to gain log(30 * number of effects / .015) nats in evidence, eight and
    more: 20 draws, once in a hundred runs at most."""
    for seed in range(20):
        assert not states(data, residual(data, seed, np.ones((data.count, 3))))[1]


@pytest.mark.parametrize("seed", range(2))
def test_white_noise_of_three_axes_is_no_noise_that_remembers(seed: int) -> None:
    """Twice the floor on every axis: a correlation time far below the interval between readings had that name, as one
    name for three channels costs less than three."""
    excess = [
        make_effect("noise_excess", {"where": f"accel{axis}", "extra_sigma": 0.03 * (1.0 + 0.2 * axis)})
        for axis in (1, 2, 3)
    ]
    without: Sequence[str] = [name for name in EFFECTS if name not in NAMES]
    run = small().with_effects(excess).simulate(seed)
    found = estimators.diagnose(run, small().simulate_locked(seed), without=without)
    assert not [cause for cause in found.causes if cause.effect == "noise_coloured" and cause.probability > 0.5]
    assert found.verdict != "no-gap"


@pytest.mark.parametrize(("spread", "found"), [(1.0, True), (4.0, False)])
def test_squares_of_long_tailed_noise_tell_less_of_what_it_follows(
    data: WhitenedData, spread: float, found: bool
) -> None:
    """Of 1.4 times the size one way up and .6 the other: some 20 nats where noise is normal, which are found in 20 of
    20 draws, and a quarter of that, found in none, where the level of the noise scatters four times as much."""
    up = data.base.inputs[:, 2] > 0.0
    tailed = replace(data, floor=tuple(replace(each, spread=spread) for each in data.floor))
    for seed in range(3):
        left = np.random.default_rng(seed).standard_normal((6, data.count))
        left[2] *= np.where(up, 1.4, 0.6)
        lefts = left_of(tailed, Explained(tailed.absorbed, left.ravel()))
        assert bool(varying([], NoiseState(), lefts)) == found
