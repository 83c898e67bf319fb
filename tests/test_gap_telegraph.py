"""An error that switches between two levels: by enumeration, and beside coloured noise of the same spectrum."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from whitened_examples import data, discrepancies, unexplained  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence import telegraph
from estimators.gap.evidence.discrepancy import Discrepancies, weighed
from estimators.gap.evidence.telegraph import likely_levels, slow_power, two_levels
from estimators.gap.floor.two_levels import forward, smoothed
from rig.arrays import Array
from rig.effects._numerics import gauss_markov


def test_the_likelihood_of_two_levels_is_that_of_all_paths() -> None:
    """Of nine samples 512 paths: their sum and the share of those at the upper level, to rounding."""
    rng = np.random.default_rng(1)
    residual, told = rng.standard_normal(9), rng.uniform(0.5, 2.0, 9)
    moments = residual * np.sqrt(told)
    apart, share, rate = 1.3, 0.3, 0.1
    levels = np.array([-apart * share, apart * (1.0 - share)])
    leaves, comes = 2.0 * rate * (1.0 - share), 2.0 * rate * share
    moves = np.array([[1.0 - comes, comes], [leaves, 1.0 - leaves]])
    total, upper = 0.0, np.zeros(9)
    for path in itertools.product((0, 1), repeat=9):
        weight = (1.0 - share, share)[path[0]] * float(np.prod([moves[a, b] for a, b in itertools.pairwise(path)]))
        level = levels[list(path)]
        weight *= float(np.exp(moments @ level - 0.5 * told @ level**2))
        total, upper = total + weight, upper + weight * np.array(path)
    one = (np.array([share]), np.array([rate]))
    odds = levels[1] * moments - 0.5 * levels[1] ** 2 * told - (levels[0] * moments - 0.5 * levels[0] ** 2 * told)
    gains, filtered = forward(odds[:, None], *one)
    at_lower = float(levels[0] * moments.sum() - 0.5 * levels[0] ** 2 * told.sum())
    assert np.isclose(gains[0] + at_lower, np.log(total), rtol=1e-12)
    np.testing.assert_allclose(smoothed(filtered[:, 0], share, rate), upper / total, rtol=1e-10)


def switching(rng: np.random.Generator, count: int, times: int) -> Array:
    return np.searchsorted(np.sort(rng.integers(0, count, times)), np.arange(count)) % 2 - 0.5


def normal_gain(residual: Array, covariance: Array) -> float:
    """Log likelihood of normal noise of a covariance beside white noise, against white noise alone."""
    whole = covariance + np.eye(len(residual))
    sign, determinant = np.linalg.slogdet(whole)
    assert sign > 0
    return 0.5 * float(residual @ residual - residual @ np.linalg.solve(whole, residual) - determinant)


def test_two_levels_and_coloured_noise_of_one_spectrum_are_told_apart() -> None:
    """A telegraph and a Gauss-Markov process of the same autocovariance, 30 standard deviations in 1,500 samples with
    15 switches: the evidence is for what is there in at least 18 of 20 each, where 90 % hold in nearly all draws."""
    count, times, size = 1500, 15, 30.0
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    covariance = size**2 / count * np.exp(-2.0 * times / count * lag)
    right = [0, 0]
    for seed in range(20):
        rng = np.random.default_rng([7, seed])
        noise = rng.standard_normal(count)
        jumping = switching(rng, count, times)
        smooth = gauss_markov(np.arange(count, dtype=float), count / (2.0 * times), rng.standard_normal((count, 1)))
        for kind, course in enumerate((jumping, smooth[:, 0])):
            course = course - course.mean()
            residual = noise - noise.mean() + size * course / np.linalg.norm(course)
            _, excess = slow_power(residual, np.ones(count))
            evidence, _ = two_levels(residual, np.ones(count), likely_levels(excess))
            right[kind] += (evidence > normal_gain(residual, covariance)) is (kind == 0)
    assert min(right) >= 18


def test_white_noise_does_not_switch() -> None:
    """Averaged over how often and how long, evidence for levels in nothing is below one in all but few: a likelihood
    ratio averaged over its prior exceeds e^3 in one of twenty at most (Markov); here the distance is fitted."""
    gains = []
    for seed in range(40):
        residual = np.random.default_rng([8, seed]).standard_normal(3000)
        power, excess = slow_power(residual, np.ones(3000))
        gains.append(two_levels(residual, np.ones(3000), likely_levels(excess))[0] if power > 0.0 else 0.0)
    assert np.mean(np.array(gains) > 3.0) < 0.15


@pytest.mark.parametrize(("scaled", "size"), [(False, 30.0), (True, 60.0)])
def test_what_switches_is_told_as_that(
    data: WhitenedData, discrepancies: Discrepancies, scaled: bool, size: float
) -> None:
    """An offset, by thirty standard deviations over 24 switches: found, at the right channel, and more evident than any
    smooth course by the evidence that two levels have over those. An amplifier scales the offset too: neither that
    alone nor the gain of the field alone leaves nothing, each misses part of sixty standard deviations, as the field is
    a part of the reading."""
    rng = np.random.default_rng(5 if scaled else 3)
    channel, source = (5, "the whole reading of mag3") if scaled else (2, "the offset of accel3")
    change = np.zeros((data.count, 6))
    change[:, channel] = switching(rng, data.count, 24) * (data.modelled[:, channel] if scaled else 1.0)
    change = project(data.absorbed, data.whiten(change))
    noise = project(data.absorbed, rng.standard_normal(data.size))
    found = weighed(unexplained(noise + size * change / np.linalg.norm(change)), discrepancies)
    assert (found[0].term.source, found[0].term.course) == (source, telegraph.NAME)
    parts = ("the offset of mag3", "the gain of mag3")
    others = [each for each in found if (each.term.source in parts if scaled else each.term.course == "time")]
    assert found[0].log_mass > max(each.log_mass for each in others) + 5.0


def test_what_the_calibration_takes_of_levels_hides_none(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """Of a level that changes a few times the calibration takes its share, and the levels' evidence is of the rest: the
    term is weighed wherever it would be worth it, here with a margin of one nat."""
    rng = np.random.default_rng(9)
    change = np.zeros((data.count, 6))
    change[:, 3] = switching(rng, data.count, 8)
    left = project(data.absorbed, data.whiten(change))
    linear = unexplained(project(data.absorbed, rng.standard_normal(data.size)) + 200.0 * left / np.linalg.norm(left))
    found = weighed(linear, discrepancies)[0]
    assert (found.term.source, found.term.course) == ("the offset of mag1", telegraph.NAME)
    again = weighed(linear, discrepancies, least=found.log_mass - 1.0)[0]
    assert (again.term.source, again.term.course) == (found.term.source, found.term.course)
