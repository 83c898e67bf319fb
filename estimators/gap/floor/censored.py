"""Normal noise of which a limit of the channel cuts off the larger readings: what the readings that are left tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr, ndtri

from rig.arrays import Array, Mask


def uncut(segments: Sequence[Array], cut: Sequence[Mask], step: float) -> tuple[list[Array], float]:
    """The segments with readings beyond the limit in place of those at it, and the share that is left of what so many
    readings tell of the deviation.

    By the likeliest normal noise, of one deviation about a mean in each segment, of which readings at the limit tell
    only that they lie beyond it. The quantiles of its tail then stand in their places, in random order: of coloured
    noise, what these had in common with their neighbours is lost, and looks white.

    Args:
        segments: (n,) [recorded unit] of poses at rest; those of which the limit leaves too little are left out.
        cut: (n,) which readings are at a limit. step: of the converter, which rounds to the limit as well [recorded
            unit].
    """
    kept = [(own, at) for own, at in zip(segments, cut, strict=True) if np.count_nonzero(~at) > 1]
    if not any(float(np.ptp(own[~at])) > 0.0 for own, at in kept):
        return [], 0.0
    means, deviation, known = _likeliest(kept, 0.5 * step)
    rng = np.random.default_rng(0)
    found = []
    for mean, (own, at) in zip(means, kept, strict=True):
        filled = own.copy()
        for sign, mask in _sides(own, at):
            many = int(mask.sum())
            limit = own[mask][0] - 0.5 * sign * step
            beyond = float(ndtr(-sign * (limit - mean) / deviation))
            tail = -ndtri(beyond * (np.arange(many) + 0.5) / many)
            filled[mask] = mean + sign * deviation * rng.permutation(tail)
        found.append(filled)
    return found, known


def _sides(own: Array, at: Mask) -> list[tuple[float, Mask]]:
    """The limits that a segment has readings at, +1 above and -1 below the others."""
    middle = float(np.mean(own[~at]))
    sides = [(1.0, at & (own > middle)), (-1.0, at & (own <= middle))]
    return [(sign, mask) for sign, mask in sides if mask.any()]


def _likeliest(kept: Sequence[tuple[Array, Mask]], rounded: float) -> tuple[Array, float, float]:
    """Means (k,), deviation, and the share of the information on the deviation that is left.

    In mean / deviation and 1 / deviation the log likelihood is concave, so that its maximum is the only one (Olsen,
    Econometrica 46, 1978).
    """
    origin = np.array([float(np.mean(own[~at])) for own, at in kept])
    free = np.array([np.count_nonzero(~at) for _, at in kept], dtype=float)
    squares = np.array([float(np.var(own[~at])) for own, at in kept])
    unit = float(np.sqrt(free @ squares / free.sum()))
    squares = squares / unit**2
    sides = [
        (index, sign, int(mask.sum()), float((own[mask][0] - sign * rounded - origin[index]) / unit))
        for index, (own, at) in enumerate(kept)
        for sign, mask in _sides(own, at)
    ]

    def loss(point: Array) -> tuple[float, Array]:
        inverse, shift = point[0], point[1:]
        value = float(0.5 * free @ (inverse**2 * squares + shift**2) - free.sum() * np.log(inverse))
        gradient = np.concatenate([[inverse * float(free @ squares) - free.sum() / inverse], free * shift])
        for index, sign, many, level in sides:
            beyond = sign * (shift[index] - inverse * level)
            value -= many * float(log_ndtr(beyond))
            slope = many * _hazard(beyond) * sign
            gradient[0] += slope * level
            gradient[1 + index] -= slope
        return value, gradient

    start = np.concatenate([[1.0], np.zeros(len(kept))])
    bounds: list[tuple[float | None, float | None]] = [(1e-6, None), *[(None, None)] * len(kept)]
    point = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    deviation = unit / float(point[0])
    hessian = _hessian(point, free, squares, sides)
    about_means = hessian[0, 0] - hessian[0, 1:] @ np.linalg.solve(hessian[1:, 1:], hessian[1:, 0])
    whole = 2.0 * sum(len(own) - 1 for own, _ in kept)
    known = min(float(about_means) * float(point[0]) ** 2 / whole, 1.0)
    return origin + point[1:] * deviation, deviation, known


def _hazard(beyond: float) -> float:
    """phi / Phi."""
    return float(np.exp(-0.5 * beyond**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(beyond)))


def _hessian(
    point: Array, free: Array, squares: Array, sides: Sequence[tuple[int, float, int, float]]
) -> NDArray[np.float64]:
    """Of minus the log likelihood: of the inverse deviation, then of each mean over the deviation."""
    inverse, shift = point[0], point[1:]
    found = np.diag(np.concatenate([[float(free @ squares) + free.sum() / inverse**2], free]))
    for index, sign, many, level in sides:
        beyond = sign * (shift[index] - inverse * level)
        hazard = _hazard(beyond)
        curvature = many * hazard * (hazard + beyond)
        direction = np.zeros(len(point))
        direction[0], direction[1 + index] = -level, 1.0
        found += curvature * np.outer(direction, direction)
    return np.asarray(found)
