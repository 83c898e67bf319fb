"""Outliers: whether there are any, and which readings they are."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.special import ndtri, stdtrit

from estimators.ellipsoid.algebraic import adjusted
from estimators.ellipsoid.distances import MEDIAN_SQUARE, Residuals
from estimators.ellipsoid.monomials import FREE, TERMS, noise_in_products, table
from estimators.ellipsoid.shape import Ellipsoid, Quadric
from estimators.ellipsoid.used_rows import spread_rows
from rig.arrays import Array, Mask, Rows

Refit = Callable[[Mask], tuple[Ellipsoid, Array, Array] | None]

#: The probability that a reading of Gaussian noise is called an outlier in a whole data set (Bonferroni's bound).
FALSE_ALARM: Final = 1e-3
#: Up to so many readings each is judged by the fit to all the others, exactly.
EXACT_ROWS: Final = 1024
#: Of a standard normal deviate within this many standard deviations the variance is this.
_CORE: Final = 2.5
_CORE_VARIANCE: Final = 0.9112563609353919
#: Degrees of freedom from which on Student's distribution is taken to be normal.
_NORMAL: Final = 5000
#: What else but outliers makes a fourth moment exceed 3: noise of the channels that is known to some per cent only.
_ROUGHLY: Final = 0.2
_DRAWS: Final = 500
_SUBSET: Final = 1000
_ROUNDS: Final = 30
_FREE_ROUNDS: Final = 10


@lru_cache(maxsize=16)
def limit(count: int) -> float:
    """Standard deviations that none of so many Gaussian readings exceeds, but in one of ``1/FALSE_ALARM`` data sets."""
    return float(-ndtri(0.5 * FALSE_ALARM / count))


def robust_variance(squares: Array) -> float:
    """Variance by the median of squared residuals (n,)."""
    middle = len(squares) // 2
    return float(np.partition(squares, middle)[middle]) / MEDIAN_SQUARE


def heavy_tailed(count: int, fourth: float, variance: float) -> bool:
    """Whether the mean fourth power of standardised residuals exceeds a Gaussian's 3 by more than chance.

    Args:
        count: of the residuals. fourth: sum of their fourth powers.
        variance: mean of their squares.
    """
    return fourth > count * variance**2 * (3.0 + _ROUGHLY + 5.0 * math.sqrt(24.0 / count))


def core_variance(squares: Array) -> float:
    """Variance by the squared residuals (n,) below 2.5 standard deviations, which hold few outliers."""
    variance = robust_variance(squares)
    for _ in range(20):
        core = squares[squares < _CORE**2 * variance]
        after = float(core.sum()) / (len(core) * _CORE_VARIANCE) if len(core) else variance
        if abs(after - variance) < 1e-4 * variance:
            break
        variance = after
    return variance


def outlying(squares: Array, leverage: Array, kept: Mask, variance: float, freedom: int) -> Mask:
    """(n,) which readings are outliers, each judged by the fit to the kept ones but itself.

    Benjamini and Hochberg, "Controlling the false discovery rate" (1995): where nothing is an outlier, nothing is
    called one but in ``FALSE_ALARM`` of the data sets; where many are, at most that share of them is not.

    Args:
        squares: (n,) as of ``Residuals.over``.
        leverage: (n,) of each reading in the fit.
        kept: (n,) those that were fitted.
        variance: of the kept ones, in the same units, found with ``freedom`` degrees of freedom.
    """
    square = squares / variance
    inside = np.minimum(leverage, 0.999)
    # a fitted reading has variance 1 - leverage and helped to make the variance; another has 1 + leverage
    internal = np.minimum(square / (1.0 - inside), freedom * (1.0 - 1e-9))
    external = internal * (freedom - 1.0) / (freedom - internal)
    judged = np.where(kept, external, square / (1.0 + leverage))
    n = len(squares)
    most = max(n // 2, 1)

    def critical(ranks: Array) -> Array:
        chance = 0.5 * FALSE_ALARM / n * ranks
        return np.asarray(np.square(ndtri(chance) if freedom > _NORMAL else stdtrit(freedom - 1.0, chance)))

    far = np.flatnonzero(judged > critical(np.array([float(most)]))[0])  # no other can be one, whatever its rank
    order = far[np.argsort(-judged[far])][:most]
    found = np.flatnonzero(judged[order] > critical(np.arange(1.0, len(order) + 1.0)))
    result = np.zeros(n, dtype=bool)
    if found.size:
        result[order[: found[-1] + 1]] = True
    return result


def any_outlying(squares: Array, leverage: Array, variance: float, freedom: int) -> bool:
    """Whether the worst of readings that were all fitted is an outlier; arguments as of ``outlying``."""
    internal = float((squares / (1.0 - np.minimum(leverage, 0.999))).max()) / variance
    internal = min(internal, freedom * (1.0 - 1e-9))
    critical = float(stdtrit(freedom - 1.0, 0.5 * FALSE_ALARM / len(squares)))
    return internal * (freedom - 1.0) / (freedom - internal) > critical**2


def inliers(
    readings: Array, variances: Array, known: bool, parameters: int, counts: Array | None, refit: Refit
) -> Mask | None:
    """(n,) the readings without outliers: a high-breakdown start, then fit and test until nothing changes.

    What noise each channel has is learned with them: readings that are wrong make a channel seem noisy, and those of
    the others outliers.

    Args:
        readings: (n, 3) [recorded unit].
        variances: (3,) of a sample's noise, up to a common factor; where they are not ``known``, a first guess.
        parameters: 6 or 9.
        counts: (n,) how many samples each is the mean of.
        refit: of a mask of readings: the ellipsoid, the leverage (n,) of all readings, and the variances; None where
            there is no ellipsoid.

    Returns:
        None where fewer than half of the readings agree on an ellipsoid.
    """
    start = least_median(readings, variances, parameters)
    if start is None:
        return None
    residuals = Residuals.of(readings, start, counts)
    learned = None if known else residuals.variances(resistant=True)
    squares = residuals.over(variances if learned is None else learned)
    kept = squares < _CORE**2 * core_variance(squares)
    for turn in range(_ROUNDS):
        found = refit(kept)
        if found is None:
            return None
        ellipsoid, leverage, variances = found
        squares = Residuals.of(readings, ellipsoid, counts).over(variances)
        freedom = max(int(kept.sum()) - parameters, 2)
        variance = core_variance(squares) * (1.0 + parameters / freedom)
        after = ~outlying(squares, leverage, kept, variance, freedom)
        if (after == kept).all():
            break
        kept = after if turn < _FREE_ROUNDS else after & kept  # a reading at the limit may come and go for ever
    return kept if 2 * int(kept.sum()) > len(kept) else None


def least_median(readings: Array, variances: Array, parameters: int) -> Ellipsoid | None:
    """The ellipsoid with the least median distance among fits to small random subsets, each then fitted to its better
    half (Rousseeuw and Van Driessen's concentration, "Computing LTS regression for large data sets", 2006).

    The draw is always the same, so that the same readings give the same answer.
    """
    pick = spread_rows(len(readings), _SUBSET)
    sample = readings if pick is None else readings[pick]
    middle = np.median(sample, axis=0)
    size = float(np.median(np.linalg.norm(sample - middle, axis=1)))
    if not size > 0.0:
        return None
    frame = Ellipsoid(middle, np.eye(3) / size, np.eye(3) * size)
    used = FREE[parameters].stop
    rows = table(sample, frame.whitening, middle)[:used]
    small = rows[:, _draws(len(sample), min(parameters + 1, len(sample)))].transpose(1, 0, 2)
    candidates = np.linalg.eigh(small @ small.transpose(0, 2, 1))[1][:, :, 0]
    noise = np.concatenate([variances / size**2, np.zeros(3)])
    distances = _distances(candidates, rows)
    half = len(sample) // 2
    best: tuple[float, Ellipsoid] | None = None
    for index in np.argsort(np.median(distances, axis=1))[:5]:
        distance = distances[index]
        for _ in range(4):
            better = rows[:, np.argpartition(distance, half)[: half + 1]]
            sums = np.zeros(TERMS)
            sums[:used] = better.sum(axis=1)
            quadric = adjusted(better @ better.T, noise_in_products(noise, sums, 0.0)[0][:used, :used])
            distance = _distances(quadric[None], rows)[0]
        median = float(np.median(distance))
        if best is None or median < best[0]:
            found = Quadric.of(frame, float(quadric[0]), quadric[1:])
            best = best if found is None else (median, found.ellipsoid)
    return None if best is None else best[1]


@lru_cache(maxsize=4)
def _draws(count: int, few: int) -> Rows:
    """(draws, few) the random subsets of so many rows."""
    chosen = np.random.default_rng(0).random((_DRAWS, count)).argpartition(few - 1, axis=1)[:, :few].copy()
    chosen.flags.writeable = False
    return chosen


def _distances(quadrics: Array, rows: Array) -> Array:
    """(k, n) first-order distances of points, given by monomials (p, n), from quadrics (k, p)."""
    wide = np.zeros((len(quadrics), TERMS))
    wide[:, : quadrics.shape[1]] = quadrics
    square = np.zeros((len(quadrics), rows.shape[1]))
    gradient, flat = np.empty_like(square), rows[:4]  # 1, y1, y2, y3
    for terms, twice in (((1, 4, 7, 8), 1), ((2, 7, 5, 9), 2), ((3, 8, 9, 6), 3)):
        form = wide[:, terms]
        form[:, twice] *= 2.0
        np.matmul(form, flat, out=gradient)
        gradient *= gradient
        square += gradient
    np.maximum(square, 1e-300, out=square)
    np.sqrt(square, out=square)
    return np.asarray(np.abs(np.matmul(quadrics, rows, out=gradient), out=gradient) / square)
