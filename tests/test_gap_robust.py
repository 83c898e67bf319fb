"""Widths of parameters where the noise is not what the floor says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from estimators.gap.evidence.laplace import Linear
from estimators.gap.search import robust
from rig.arrays import Array

CHANNELS, COUNT, DRAWS = 6, 1600, 400
#: Fewer of 400 intervals of 95 % hold the truth at odds of 1e-5.
FEWEST = 359


def fitted(left: Array, tangent: Array) -> Linear:
    """One strength, at the value where it fits best, with hardly a prior."""
    move = float(tangent @ left / (tangent @ tangent))
    one = np.ones(1)
    return Linear(left - move * tangent, tangent[:, None], move * one, one > 0, one, np.zeros(1, dtype=np.intp))


def widths(misfit: Callable[[np.random.Generator], Array]) -> tuple[int, float, float]:
    """How many of 95 % intervals hold the truth, and how wide these are, robust and by the floor, over what is needed.

    Args:
        misfit: draws errors (CHANNELS, COUNT) of ten times the floor.
    """
    rng = np.random.default_rng(0)
    tangent = np.tile(np.sin(2.0 * np.pi * 5.0 * np.arange(COUNT) / COUNT), CHANNELS)
    found, model, wide = np.empty((3, DRAWS))
    for draw in range(DRAWS):
        linear = fitted(10.0 * misfit(rng).ravel(), tangent)
        precision = linear.likeliest
        model[draw] = linear.posterior(precision)[1][0, 0]
        mean, covariance = robust.moments(linear, CHANNELS)
        found[draw], wide[draw] = linear.point[0] + mean[0], covariance[0, 0]
    held = int((np.abs(found) < 1.959964 * np.sqrt(wide)).sum())
    scatter = float(np.std(found))
    return held, float(np.sqrt(wide.mean())) / scatter, float(np.sqrt(model.mean())) / scatter


def remembering(memory: float) -> Callable[[np.random.Generator], Array]:
    """Errors of which so much stays from sample to sample, of each channel by itself."""

    def draw(rng: np.random.Generator) -> Array:
        drive = np.sqrt(1.0 - memory**2) * rng.standard_normal((CHANNELS, COUNT + 400))
        return np.asarray(lfilter([1.0], [1.0, -memory], drive, axis=1)[:, 400:])

    return draw


def of_all_channels(rng: np.random.Generator) -> Array:
    """The same errors in every channel."""
    return np.tile(rng.standard_normal(COUNT), (CHANNELS, 1))


def of_each_channel(rng: np.random.Generator) -> Array:
    """An error of each channel that is like what is fitted, throughout."""
    along = np.sin(2.0 * np.pi * 5.0 * np.arange(COUNT) / COUNT)
    return np.asarray(rng.standard_normal((CHANNELS, 1)) * along + 0.1 * rng.standard_normal((CHANNELS, COUNT)))


@pytest.mark.parametrize(
    "misfit",
    [remembering(0.0), remembering(0.9), of_all_channels, of_each_channel],
    ids=["white", "slow", "shared", "of one channel"],
)
def test_what_is_wrong_widens_what_the_floor_says(misfit: Callable[[np.random.Generator], Array]) -> None:
    """Whatever neighbours in time or channels share; never so wide that it says nothing. The floor alone is off by
    three and more."""
    held, wide, model = widths(misfit)
    assert held >= FEWEST
    assert wide < 2.2
    assert model < 0.35
