"""Strengths of noise: how wide, of one axis or all, and learned by the weights of that noise itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from whitened_examples import data, unexplained  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.named_noise import named
from estimators.gap.evidence.reweighted import left_by_weights
from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left, deviations


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 2.0, 3.9, 8.0])
def test_a_strength_is_as_wide_as_its_square_tells(ratio: float) -> None:
    """The second moment about the fitted strength of exp(-(s^2 - f^2)^2 / 2), by quadrature; far from nothing half of
    the square's over the strength, to 5 % where that takes over."""
    top = ratio + 6.0
    weight = quad(lambda s: np.exp(-0.5 * (s * s - ratio**2) ** 2), 0.0, top, points=[ratio])[0]
    second = quad(lambda s: np.exp(-0.5 * (s * s - ratio**2) ** 2) * (s - ratio) ** 2, 0.0, top, points=[ratio])[0]
    found = deviations(np.array([2.0 * ratio]), np.array([4.0]))[0]
    assert found == pytest.approx(2.0 * np.sqrt(second / weight), rel=0.05)


def test_causes_and_calibration_are_fitted_by_the_weights_of_the_noise(data: WhitenedData) -> None:
    """Generalised least squares by its definition, with a channel's noise ten times as large in half of the time."""
    rng = np.random.default_rng(2)
    factor = np.where(np.arange(data.count) < data.count // 2, 0.1, 1.0)
    counted = (data.weights[:, data.columns].T > 0.0).ravel()
    both = project(data.absorbed, rng.standard_normal((data.size, 3)) * counted[:, None])
    left, tangent, strength = both[:, 0], both[:, 1:], np.ones(2, dtype=bool)
    linear = Linear(left, tangent, np.zeros(2), strength, np.ones(2), np.zeros(2, dtype=np.intp))
    weights = np.ones((len(data.columns), data.count))
    weights[1] = factor
    design = np.column_stack([data.absorbed.dense(), tangent])
    white = weights.ravel()
    expected = left - design @ np.linalg.lstsq(design * white[:, None], left * white)[0]
    found = left_by_weights(data, linear, [Step(data.columns[1], factor, in_time=True)])
    np.testing.assert_allclose(found, expected, atol=1e-8)
    np.testing.assert_allclose(left_by_weights(data, unexplained(left), []), left, atol=1e-12)


def left_with(data: WhitenedData, channel: int, rng: np.random.Generator) -> Left:
    """White noise, and 3 s of memory in one channel, twice as large."""
    noise = rng.standard_normal((6, data.count))
    memory = np.exp(-data.interval_s / 3.0)
    course = np.zeros(data.count)
    for index in range(1, data.count):
        course[index] = memory * course[index - 1] + np.sqrt(1.0 - memory**2) * rng.standard_normal()
    noise[channel] += 2.0 * course
    return Left(data, Explained(data.absorbed, project(data.absorbed, noise.ravel())))


def test_noise_of_one_axis_costs_one_strength_and_leaves_the_others_open(data: WhitenedData) -> None:
    """The prior of one axis alone, one in two over three axes, instead of two more strengths that are not there; and
    what these may be reaches to nothing: within 1.96 widths in nine of ten (no fewer than 31 of 40, at 90 %)."""
    holds = 0
    for seed in range(20):
        left = left_with(data, 1, np.random.default_rng([4, seed]))
        (state,) = [
            each for each in named([left], [], NoiseState()) if each.labels == ("noise_coloured@accelerometer",)
        ]
        (fitted,) = state.fitted
        assert np.argmax(fitted.gains) == 1
        values = np.asarray(fitted.effect.sigma_V)
        holds += int(np.sum(values[[0, 2]] <= 1.96 * fitted.std[[0, 2]]))
    assert holds >= 31


def test_of_a_large_strength_the_width_is_that_of_its_square_to_first_order() -> None:
    """Of s, whose square has a standard deviation of v: v / (2 s), however many of its widths it is from nothing."""
    roots, spread = np.array([1e2, 1e4, 1e8]), np.array([1e-3, 1e-3, 1e-3])
    np.testing.assert_allclose(deviations(roots, spread), spread / (2.0 * roots), rtol=1e-9)
