"""Statistics of readings with other noise in the same poses, drawn without a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimators.known_angle.statistics import Statistics
from rig.arrays import Array


def draw(base: Statistics, rng: np.random.Generator, coefficients: ArrayLike, noise: ArrayLike) -> Statistics:
    """Statistics of new readings in the poses of others: exactly as if white Gaussian noise were added to every sample.

    X^T e is N(0, sigma_k^2 gram), independent of the residual part of e^T e, which is Wishart with n - rank degrees
    of freedom; the cost does not grow with n.

    Args:
        rng: source of the draw.
        coefficients: (10, c) true theta, ``SensorParameters.coefficients``.
        noise: (c,) standard deviation of the noise [recorded unit].
    """
    theta = np.asarray(coefficients, dtype=float)
    sigma = np.broadcast_to(np.asarray(noise, dtype=float), theta.shape[1:])
    values, vectors = np.linalg.eigh(base.gram)
    kept = values > values[-1] * 1e-14
    root = vectors[:, kept] * np.sqrt(values[kept])
    inside = rng.standard_normal((root.shape[1], len(sigma))) * sigma
    outside = wishart_root(rng, base.count - root.shape[1], len(sigma)) * sigma
    projected = root @ inside
    mixed = theta.T @ projected
    square = theta.T @ base.gram @ theta + mixed + mixed.T + inside.T @ inside + outside.T @ outside
    return Statistics(base.count, base.gram, base.gram @ theta + projected, square)


def wishart_root(rng: np.random.Generator, degrees: int, size: int) -> Array:
    """A matrix A (rows, size) with A^T A Wishart with ``degrees`` degrees of freedom and unit covariance (Bartlett)."""
    if degrees < size:
        return rng.standard_normal((max(degrees, 0), size))
    root = np.triu(rng.standard_normal((size, size)), 1)
    root[np.diag_indices(size)] = np.sqrt(rng.chisquare(degrees - np.arange(size)))
    return root


@dataclass(frozen=True, eq=False)
class Draws:
    """Statistics of m data sets in the same poses.

    Attributes:
        count: n samples each.
        gram: (10, 10) as of ``Statistics``.
        cross: (m, 10, c) [recorded unit].
        square: (m, c) sums of V_k^2 [recorded unit squared].
    """

    count: int
    gram: Array
    cross: Array
    square: Array


def draw_many(
    rng: np.random.Generator, gram: ArrayLike, count: int, coefficients: ArrayLike, noise: ArrayLike, draws: int
) -> Draws:
    """Draw as ``draw`` does, m times, without the products between channels, which no fit needs.

    Without these the residual part of V_k^2 is sigma_k^2 times chi-square with n - rank degrees of freedom, and the
    draws have exactly the distribution that white Gaussian noise on every sample gives.

    Args:
        rng: source of the draws.
        gram: (10, 10) of the poses.
        count: n.
        coefficients: (10, c) true theta, ``SensorParameters.coefficients``; or (m, 10, c), a truth for each draw.
        noise: (c,) or (m, c) standard deviation of the noise [recorded unit].
        draws: m.
    """
    poses = np.asarray(gram, dtype=float)
    given = np.asarray(coefficients, dtype=float)
    theta = np.broadcast_to(given, (draws, *given.shape[-2:]))
    sigma = np.broadcast_to(np.asarray(noise, dtype=float), (draws, given.shape[-1]))
    values, vectors = np.linalg.eigh(poses)
    kept = values > values[-1] * 1e-14
    root = vectors[:, kept] * np.sqrt(values[kept])
    freedom = count - root.shape[1]
    inside = rng.standard_normal((draws, root.shape[1], sigma.shape[1])) * sigma[:, None]
    outside = sigma**2 * rng.chisquare(freedom, sigma.shape) if freedom > 0 else np.zeros(sigma.shape)
    exact, added = poses @ theta, root @ inside
    square = (theta * (exact + 2.0 * added)).sum(axis=1) + np.square(inside).sum(axis=1) + outside
    return Draws(count, poses, exact + added, square)
