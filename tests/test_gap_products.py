"""Products that a diagnosis makes in one transform are those that it would make one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import dct

from estimators.gap.data.steps import Gaps, Step, after_steps, products_after
from estimators.gap.evidence.repeats import Clock, _polished
from estimators.gap.evidence.terms import Errors, _gram, _gram_of_cosines
from estimators.gap.hypotheses.courses import COSINES, cosines
from rig.arrays import Array

COUNT = 1500


def values(seed: int = 0, rows: int = 5) -> Array:
    return np.random.default_rng(seed).standard_normal((rows, COUNT))


def gaps_of(left_out: int) -> Gaps:
    weights = np.ones(COUNT)
    weights[np.random.default_rng(1).choice(COUNT, left_out, replace=False)] = 0.0
    return Gaps.of(weights)


@pytest.mark.parametrize("left_out", [0, 3, 400])
def test_products_after_a_step_are_those_of_what_it_leaves(left_out: int) -> None:
    gaps, factor = gaps_of(left_out), np.linspace(0.3, 2.0, COUNT)
    white = after_steps([Step(0, factor, in_time=False)], values(), gaps)
    found = products_after(dct(gaps.filled(values()), norm="ortho") * factor, gaps)
    np.testing.assert_allclose(found, white @ white.T, atol=1e-10 * COUNT)


@pytest.mark.parametrize("left_out", [0, 3, 400])
def test_steps_at_once_are_steps_one_after_the_other(left_out: int) -> None:
    """Where readings are left out others stand for these before each filter, whether or not one knows of the next."""
    gaps, rng = gaps_of(left_out), np.random.default_rng(2)
    kinds = [False, False, True, True, False, True, False]
    steps = [Step(0, rng.uniform(0.5, 2.0, COUNT), in_time) for in_time in kinds]
    for first in range(len(steps)):
        in_two = after_steps(steps[first:], after_steps(steps[:first], gaps.emptied(values()), gaps), gaps)
        np.testing.assert_allclose(after_steps(steps, gaps.emptied(values()), gaps), in_two, atol=1e-11)


@pytest.mark.parametrize("count", [100, 2 * COSINES, COUNT])
def test_products_along_cosines_are_sums_of_cosines(count: int) -> None:
    """Of 100 samples some orders are beyond what these tell apart."""
    series = np.random.default_rng(3).standard_normal((count, 4, 6))
    errors = Errors(series, np.ones(6, dtype=bool), cosines(count))
    for freedoms in (slice(0, 1), slice(1, 4)):
        directly = _gram(errors, freedoms, slice(0, COSINES))
        np.testing.assert_allclose(_gram_of_cosines(errors, freedoms), directly, atol=1e-12 * np.abs(directly).max())


@pytest.mark.parametrize("harmonics", [1, 4, 16])
def test_a_waveform_is_polished_as_far_as_it_is_told(harmonics: int) -> None:
    """Of a waveform of signal-to-noise 1,000 without noise, in a recording of 33,000 s, less than 5 of the square of a
    million is lost: a share of 1e-3 of the grid's step loses (pi 1e-3 / 4)^2 / 3, of each harmonic, less than 1."""
    count, interval_s = 6656, 5.0
    clock = Clock("", ("s", 1.0), np.arange(count) * interval_s, interval_s, 0, 0)
    rng = np.random.default_rng(4)
    for _ in range(5):
        series = 1.0 + 0.3 * rng.standard_normal((2, 1, count))
        frequency = rng.uniform(0.1, 0.9) * 0.1 / harmonics
        course = clock.course(frequency, harmonics)
        change = series[0, 0] * (course.values @ (rng.standard_normal(2 * harmonics) * course.weight))
        change *= 1000.0 / np.linalg.norm(change)
        start = frequency + rng.uniform(-0.5, 0.5) * clock.cell / harmonics
        square, found = _polished(clock, series, series[:, 0] * change, harmonics, start)
        assert square > 1e6 - 5.0
        assert found == pytest.approx(frequency, abs=0.01 * clock.cell / harmonics)


@pytest.mark.parametrize("left_out", [0, 3, 400])
def test_one_factor_of_all_frequencies_is_one_of_all_times(left_out: int) -> None:
    gaps = gaps_of(left_out)
    (of_frequency, of_time) = (Step(0, np.full(COUNT, 0.7), in_time) for in_time in (False, True))
    assert of_frequency.scales
    assert not Step(0, np.linspace(0.7, 0.7001, COUNT), in_time=False).scales
    both = [after_steps([step], gaps.emptied(values()), gaps) for step in (of_frequency, of_time)]
    np.testing.assert_allclose(both[0], both[1], atol=1e-15)
