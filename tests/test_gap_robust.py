"""Widths of parameters where the noise is not what the floor says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from estimators.gap.evidence.laplace import Linear
from estimators.gap.search import robust

Array = NDArray[np.float64]

CHANNELS, COUNT, DRAWS = 3, 1600, 60


def fitted(left: Array, tangent: Array) -> Linear:
    """One strength, at the value where it fits best, with hardly a prior."""
    move = float(tangent @ left / (tangent @ tangent))
    one = np.ones(1)
    return Linear(left - move * tangent, tangent[:, None], move * one, one > 0, one, np.zeros(1, dtype=np.intp))


def widths(memory: float) -> tuple[float, float, float]:
    """Standard deviation of an estimate over draws, and the mean of what the model says and of what is robust.

    Args:
        memory: how much of an error of ten times the floor stays from sample to sample.
    """
    rng = np.random.default_rng(0)
    tangent = np.tile(np.sin(2.0 * np.pi * 5.0 * np.arange(COUNT) / COUNT), CHANNELS)
    found, model, wide = [], [], []
    for _ in range(DRAWS):
        drive = 10.0 * np.sqrt(1.0 - memory**2) * rng.standard_normal((CHANNELS, COUNT + 400))
        linear = fitted(lfilter([1.0], [1.0, -memory], drive, axis=1)[:, 400:].ravel(), tangent)
        found.append(float(linear.point[0]))
        precision = linear.precision(linear.averaged[1])
        model.append(float(linear.posterior(precision)[1][0, 0]))
        wide.append(float(robust.moments(linear, CHANNELS)[1][0, 0]))
    return float(np.std(found)), float(np.sqrt(np.mean(model))), float(np.sqrt(np.mean(wide)))


def test_errors_with_a_memory_widen_what_the_floor_says() -> None:
    """60 draws give a standard deviation to 9 %; three channels and 16 blocks give its square to 30 %, less what ends
    of blocks cut off: within a factor of 1.6, at odds of 1e-5. The floor alone is off by more than ten."""
    for memory in (0.0, 0.9):
        scatter, model, wide = widths(memory)
        assert 1.0 / 1.6 < wide / scatter < 1.6
        assert model < 0.11 * scatter


def test_channels_that_disagree_widen_it_too() -> None:
    """A parameter that is +1 to one channel and -1 to another is known to no better than that."""
    rng = np.random.default_rng(1)
    along = np.sin(2.0 * np.pi * 5.0 * np.arange(COUNT) / COUNT)
    tangent = np.tile(along, CHANNELS)
    apart = np.concatenate([along, -along, 0.0 * along])
    linear = fitted(rng.standard_normal(CHANNELS * COUNT) + apart, tangent)
    _, covariance = robust.moments(linear, CHANNELS)
    assert np.sqrt(covariance[0, 0]) > 0.3
