"""Noise that is louder at some times than at others, at rest already: told there, and no cause in the sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from whitened_examples import data, louder, noise_of  # noqa: F401

import estimators
import scenarios
from estimators.gap.data.basefit import learn_floor
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.states import left_of
from estimators.gap.evidence.unsteady_floor import UNSTEADY, unsteady_floor
from estimators.gap.floor.unsteady import TwoLevels, Unsteady, unsteadiness
from estimators.gap.hypotheses.score import Explained
from rig.channels import COLUMNS_OF
from rig.maneuver import LockedPoses
from rig.recording import Recording

BOARDS = (range(3), range(3, 6))
POSES = np.repeat(np.arange(7), 200)


def loudness(count: int, seed: int, period: int) -> np.ndarray:
    """(n,) a factor that swells and fades, its mean square one."""
    phase = 2.0 * np.pi * np.random.default_rng(seed).random()
    swelling = 1.0 + 0.6 * np.sin(2.0 * np.pi * np.arange(count) / period + phase)
    return np.asarray(swelling / np.sqrt(np.mean(swelling**2)))


def bursts(count: int, seed: int) -> np.ndarray:
    """(n,) a factor that is three for a tenth of the time, some twenty readings each; its mean square one."""
    rng = np.random.default_rng(seed)
    loud = np.convolve(rng.random(count) < 0.005, np.ones(20))[:count] > 0.0
    factor = np.where(loud, 3.0, 1.0)
    return np.asarray(factor / np.sqrt(np.mean(factor**2)))


@pytest.mark.parametrize("kind", ["normal", "long tails", "coloured", "resonant", "shared"])
def test_steady_noise_is_not_called_unsteady(kind: str) -> None:
    """Of any distribution and colour. A gain beyond log n is of a likelihood ratio beyond 2 log 1300 = 14.3, of some
    ten shapes and of ten groupings: less than one in 100 draws; four in 60 come once in 2,000 runs of that."""
    rng, told = np.random.default_rng(0), 0
    for _ in range(60):
        noise = rng.standard_t(4.0, (len(POSES), 6)) if kind == "long tails" else rng.standard_normal((len(POSES), 6))
        if kind == "coloured":
            noise = lfilter([1.0], [1.0, -0.9], noise, axis=0)
        if kind == "resonant":
            noise = lfilter([1.0], [1.0, -1.6, 0.9], noise, axis=0)
        if kind == "shared":
            noise = 0.8 * noise + 0.6 * rng.standard_normal((len(POSES), 1))
        told += bool(unsteadiness(noise, POSES, 0.1, BOARDS))
    assert told < 4


def test_steady_noise_of_a_few_steps_is_not_called_unsteady() -> None:
    """Where between two steps a pose is changes how large the noise's readings are, not how loud it is. A gain
    beyond log 600,000 of one of some ten shapes comes once in 60,000 draws; of three recordings with nine groupings
    each, once in 2,000 runs of this."""
    still = scenarios.load("ann-arbor").simulate_locked(0)
    for seed in range(3):
        rng, coarse = np.random.default_rng(seed), {}
        for sensor in still.sensors:
            readings = still.readings(sensor)
            step = np.std(readings[: len(readings) // 4], axis=0)
            steady = readings - rng.random(3) * step + rng.standard_normal(readings.shape) * step
            coarse[sensor] = np.round(steady / step) * step
        floor = learn_floor(replace(still, **coarse), 0.025)
        assert not any(channel.unsteady for channel in floor)


@pytest.mark.parametrize("columns", [(0, 1, 2, 3, 4, 5), (3, 4, 5), (1,)])
def test_noise_that_swells_is_called_unsteady_where_it_is_and_by_as_much(columns: tuple[int, ...]) -> None:
    """The logarithm of its variance has a standard deviation of .97, told to a factor of two: by a period or two."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((len(POSES), 6))
    own = loudness(len(POSES), 3, 300)
    noise[:, columns] *= own[:, None]
    (found,) = unsteadiness(noise, POSES, 0.1, BOARDS)
    assert found.columns == columns
    assert 0.5 < found.spread / float(np.std(2.0 * np.log(own))) < 2.0
    assert 1.0 < found.memory_s < 30.0


@pytest.mark.parametrize("longer", [1, 70])
def test_bursts_have_two_levels(longer: int) -> None:
    """A stay of twenty readings at the louder, of a tenth of the time, is a rate of .028 a reading; told to a grid
    whose steps are of a factor of two to three."""
    rng, poses = np.random.default_rng(2), np.repeat(POSES, longer)
    factor = bursts(len(poses), 5)
    (found,) = unsteadiness(rng.standard_normal((len(poses), 6)) * factor[:, None], poses, 0.1, BOARDS)
    assert found.levels is not None
    assert 4.0 <= found.levels.ratio <= 16.0
    assert found.levels.share == pytest.approx(float(np.mean(factor > 1.0)), abs=0.06)
    assert 0.028 / 3.0 < found.levels.rate_Hz * 0.1 < 0.028 * 3.0


def test_bursts_at_rest_are_no_spikes() -> None:
    """What is large then is of the floor: its variance is that of all readings, to a twentieth; taken for spikes,
    nearly a tenth of it would be left out."""
    still = scenarios.load("ann-arbor").simulate_locked(0)
    factor = bursts(len(still), 5)[:, None]
    rng, loud = np.random.default_rng(1), {}
    for sensor in still.sensors:
        readings = still.readings(sensor)
        size = 5.0 * np.std(np.diff(readings, axis=0), axis=0) * factor
        loud[sensor] = readings + size * rng.standard_normal(readings.shape)
    floor = learn_floor(replace(still, **loud), 0.025)
    for sensor, columns in COLUMNS_OF.items():
        poses = np.array_split(loud[sensor], 3)
        whole = np.mean([np.diff(own, axis=0).var(axis=0) / 2.0 for own in poses], axis=0)
        np.testing.assert_allclose([channel.variance for channel in floor[columns]], whole, rtol=0.05)


@pytest.mark.parametrize("kind", ["swelling", "bursts"])
def test_the_floor_is_as_loud_as_the_sweep_shows_where_rest_showed_that(data: WhitenedData, kind: str) -> None:
    """30 readings of each of six channels in a length of the level tell its logarithm to 1 / 9."""
    rng = np.random.default_rng(2)
    factor = loudness(data.count, 3, 150) if kind == "swelling" else bursts(data.count, 3)
    lefts = left_of(data, Explained(data.absorbed, (rng.standard_normal((6, data.count)) * factor).ravel()))
    assert unsteady_floor(lefts) is None  # rest did not
    levels = None if kind == "swelling" else TwoLevels(9.0, 0.1, 0.025 / data.interval_s)
    known = Unsteady(0.9, 30.0 * data.interval_s, 0.2, tuple(range(6)), levels)
    unsteady = replace(data, floor=tuple(replace(each, unsteady=known) for each in data.floor))
    found = unsteady_floor(left_of(unsteady, Explained(data.absorbed, lefts[0].explained.residual)))
    assert found is not None
    assert (found.name, found.other, found.fitted) == (UNSTEADY, False, ())
    assert {step.column for step in found.steps} == set(data.columns)
    for step in found.steps:
        if step.in_time:
            assert np.corrcoef(np.log(step.factor), -np.log(factor))[0, 1] > 0.8


def test_a_level_that_drifts_all_along_is_that_of_a_floor_that_was_unsteady_at_rest() -> None:
    """From .75 to 1.35 of the mean, of six channels of 9,600 readings. A process that remembers a twenty-fifth of the
    recording costs 143 of the 1,680 that this gains in log likelihood; a drift, of which but the size and the mean are
    not known, less than 12."""
    rng = np.random.default_rng(6)
    rising = np.linspace(0.75, 1.35, 9600)
    squares = np.sum((rng.standard_normal((6, 9600)) * rising / np.sqrt(np.mean(rising**2))) ** 2, axis=0)
    known = Unsteady(0.415, 94.0, 0.2, tuple(range(6)))
    inverse, weight, gained = known.inverse_variance(squares, np.full(9600, 6.0), 0.25)
    assert np.corrcoef(np.log(inverse), -np.log(rising))[0, 1] > 0.99
    assert -12.0 < weight < 0.0
    assert gained > 1600.0


def test_noise_as_steady_as_its_mean_is_no_unsteady_floor(data: WhitenedData) -> None:
    """A level that is one everywhere is less likely under one that would have changed."""
    rng = np.random.default_rng(4)
    known = Unsteady(0.9, 30.0 * data.interval_s, 0.1, tuple(range(6)), TwoLevels(9.0, 0.1, 0.025 / data.interval_s))
    unsteady = replace(data, floor=tuple(replace(each, unsteady=known) for each in data.floor))
    assert unsteady_floor(left_of(unsteady, Explained(data.absorbed, rng.standard_normal(6 * data.count)))) is None


def swelling(run: Recording, rest: Recording, seed: int) -> Recording:
    """The readings with noise six times as large as their own, which swells and fades in forty seconds."""
    rate_Hz = 1.0 / float(np.median(np.diff(run.t)))
    noise = np.random.default_rng(seed).standard_normal((len(run), 6))
    noise *= 6.0 * loudness(len(run), seed, int(40.0 * rate_Hz))[:, None]
    return louder(run, noise * noise_of(rest))


def test_noise_that_swells_at_rest_and_in_the_sweep_is_no_cause() -> None:
    """It was something without a name, with more than .999 in each of three."""
    scenario, still = (scenarios.load("ann-arbor").with_acquisition(decimation=each) for each in (100, 1))
    quiet = []
    for seed in range(3):
        run = scenario.simulate(seed)
        rest = still.rig.simulate(LockedPoses(hold_s=100.0, rate_Hz=20.0), np.random.default_rng(seed))
        found = estimators.diagnose(swelling(run, rest, 10 + seed), swelling(rest, rest, 20 + seed))
        assert not [cause for cause in found.causes if cause.probability > 0.95]
        quiet.append(found.posterior["nothing"])
    assert np.mean(quiet) > 0.5
