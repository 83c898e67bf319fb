"""Noise of long tails: Student's distribution, and whether readings that stand out are spikes or the end of a tail."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import gammaln, log_ndtr, ndtri, stdtr, stdtrit

from rig.arrays import Array

#: Degrees of freedom that are tried; more is as good as normal.
_DEGREES: Final = (2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0, 16.0, 24.0)
#: Steps to the likeliest scale, of which each halves what is left at least.
_STEPS: Final = 20
#: Many values tell the scale as so many means of values alike in size: to a tenth of its standard error at worst.
_GROUPS: Final = 4096
#: A reading's neighbours: so many on either side.
_NEIGHBOURS: Final = 3
#: Readings beyond so many deviations of normal noise may be spikes.
_FAR: Final = 4.5
#: Sizes of spikes that are tried, and steps to the likeliest share of each.
_SIZES, _SHARES = 8, 8
#: Draws of noise that tell what is done to it.
_SIMULATED: Final = 100_000
#: The share of long-tailed readings, on one side, that is drawn in.
_DRAWN_IN: Final = 0.005


def beside_neighbours(white: Array) -> Array:
    """Whitened readings (n,) less the median of each one's neighbours: what is slow goes, single readings stay."""
    padded = np.pad(white, _NEIGHBOURS, mode="edge")
    others = np.delete(sliding_window_view(padded, 2 * _NEIGHBOURS + 1), _NEIGHBOURS, axis=1)
    others.sort(axis=1)  # many times as fast as np.median
    return np.asarray(white - 0.5 * (others[:, _NEIGHBOURS - 1] + others[:, _NEIGHBOURS]))


def student(values: Array) -> tuple[float, float, float]:
    """The likeliest degrees of freedom and scale of Student's distribution about zero, and the log likelihood.

    The degrees are infinite where normal noise is likelier than all that were tried together.
    """
    deviation = float(np.sqrt(np.mean(values**2)))
    normal = -len(values) * (float(np.log(deviation)) + 0.5 * float(np.log(2.0 * np.pi)) + 0.5)
    grouped = _grouped(values**2)
    scales = [_scale(*grouped, degrees) for degrees in _DEGREES]
    ways = [_likelihood(values, *way) for way in zip(_DEGREES, scales, strict=True)]
    if float(np.logaddexp.reduce(ways)) - np.log(len(ways)) <= normal:
        return np.inf, deviation, normal
    best = int(np.argmax(ways))
    return _DEGREES[best], scales[best], ways[best]


def scale_of(values: Array, degrees: float) -> float:
    """The likeliest scale, by reweighting (Lange, Little and Taylor, Journal of the American Statistical Association
    84, 1989)."""
    return _scale(*_grouped(values**2), degrees)


def _scale(squares: Array, shares: Array, degrees: float) -> float:
    square = float(squares[np.searchsorted(np.cumsum(shares), 0.5)])
    for _ in range(_STEPS):
        square = float(shares @ ((degrees + 1.0) * squares / (degrees + squares / square)))
    return float(np.sqrt(square))


def _grouped(squares: Array) -> tuple[Array, Array]:
    """Means of squares (n,) that are alike in size, in order, and the share of all that each is of."""
    ordered = np.sort(squares)
    edges = np.unique(np.linspace(0, len(ordered), _GROUPS, endpoint=False).astype(int))
    counts = np.diff(edges, append=len(ordered))
    return np.add.reduceat(ordered, edges) / counts, counts / len(ordered)


def tails_of(local: Array, degrees: float | None) -> tuple[float, float]:
    """Degrees of freedom and scale of readings beside their neighbours, whitened.

    Args:
        degrees: as a recording at rest shows them; None or infinite: the readings decide whether normal noise with some
            spikes of any size is likelier.
    """
    if degrees is not None and np.isfinite(degrees):
        return degrees, scale_of(local, degrees)
    spread = float(np.sqrt(np.mean(np.clip(local, -4.0, 4.0) ** 2)))
    own, scale, likelihood = student(local)
    if np.isfinite(own) and likelihood > _with_spikes(local, spread):
        return own, scale
    return np.inf, spread


def log_tail(values: Array, degrees: float) -> Array:
    """Logarithm of the chance to lie beyond values (n,), in scales, on one side."""
    if np.isinf(degrees):
        return np.asarray(log_ndtr(-np.abs(values)))
    return np.asarray(np.log(np.maximum(stdtr(degrees, -np.abs(values)), 1e-300)))


def limit(chance: float, degrees: float) -> float:
    """The value, in scales, beyond which a reading lies by so small a chance on one side."""
    return float(-ndtri(chance) if np.isinf(degrees) else -stdtrit(degrees, chance))


def drawn_in(values: Array, degrees: float, scale: float) -> Array:
    """Values (n,) of long-tailed noise with the outermost drawn in to the limit of the rest; normal noise as it is."""
    if np.isinf(degrees):
        return values
    most = limit(_DRAWN_IN, degrees) * scale
    return np.clip(values, -most, most)


def variance_beside_neighbours(noise: Array, degrees: float, scale: float) -> float:
    """The variance of noise that was drawn in beside its neighbours, over that of noise drawn in about zero.

    Of readings that are drawn anew from those given, whatever their distribution; exact to half a per cent.

    Args:
        noise: (n,) about zero. degrees, scale: of Student's distribution, as it is told by.
    """
    drawn = np.random.default_rng(0).choice(noise, _SIMULATED)
    local = beside_neighbours(drawn)
    there = drawn + drawn_in(local, degrees, scale_of(local, degrees)) - local
    return float(np.mean(there**2) / np.mean(drawn_in(drawn, degrees, scale) ** 2))


def level_spread(noise: Array, degrees: float, scale: float) -> float:
    """How many times the variance of the level of drawn-in noise, as a recording shows it, is that of normal noise.

    By what a single reading does to it, the limit's share included (Hampel, Journal of the American Statistical
    Association 69, 1974), whatever the distribution.

    Args:
        noise, degrees, scale: as of ``variance_beside_neighbours``.
    """
    if np.isinf(degrees):
        return 1.0
    square = (noise / scale) ** 2
    most = limit(_DRAWN_IN, degrees) ** 2
    variance = float(np.mean(np.minimum(square, most)))
    of_limit = float(np.mean(square > most)) * most / variance
    told = float(np.mean((degrees + 1.0) * degrees * square / (degrees + square) ** 2))  # of the scale, by each
    of_scale = ((degrees + 1.0) * square / (degrees + square) - 1.0) / told
    return 0.5 * float(np.var(np.minimum(square, most) / variance + of_limit * of_scale))


def _likelihood(values: Array, degrees: float, scale: float) -> float:
    constant = float(gammaln(0.5 * (degrees + 1.0)) - gammaln(0.5 * degrees)) - 0.5 * float(np.log(degrees * np.pi))
    tail = 0.5 * (degrees + 1.0) * np.log1p((values / scale) ** 2 / degrees)
    return len(values) * (constant - float(np.log(scale))) - float(tail.sum())


def _with_spikes(local: Array, spread: float) -> float:
    """Log likelihood of normal noise with some spikes: all sizes up to the largest alike, or normal ones."""
    largest = float(np.abs(local).max())
    count = int(np.count_nonzero(np.abs(local) > _FAR * spread))
    noise = _log_normal(local, spread)
    if not count:
        return float(noise.sum())
    share = count / len(local)
    found = [float(np.logaddexp(np.log1p(-share) + noise, np.log(share / (2.0 * largest))).sum())]
    for size in np.geomspace(2.0 * spread, max(largest, 2.0 * spread), _SIZES):
        spikes, share = _log_normal(local, float(np.hypot(size, spread))), count / len(local)
        for _ in range(_SHARES):
            both = np.logaddexp(np.log1p(-share) + noise, np.log(share) + spikes)
            share = float(np.clip(np.mean(np.exp(np.log(share) + spikes - both)), 0.5 / len(local), 0.5))
        found.append(float(np.logaddexp(np.log1p(-share) + noise, np.log(share) + spikes).sum()))
    return max(found)


def _log_normal(values: Array, deviation: float) -> Array:
    return np.asarray(-0.5 * (values / deviation) ** 2 - 0.5 * np.log(2.0 * np.pi) - np.log(deviation))
