"""Residuals summed over blocks of successive samples, and which blocks a sensor rested through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import chdtri

from estimators.live.reference import ByRow, Residuals
from rig.arrays import Array, Mask

#: Samples of a block from which on its noise is seen about its own mean.
LEAST: Final = 4

#: An accelerometer without attitude is judged where it rests: where none of this block and those so long on either
#: side [s] has a variance that noise exceeds with this probability, the noise being that of the quietest so many of
#: this many, whenever it was least: who turns it faster for minutes does not rest.
_BESIDE_S: Final = 0.5
_MISSED: Final = 0.01
_QUIETEST: Final = 0.1
_REMEMBERED: Final = 600


@dataclass(frozen=True, eq=False)
class Blocks(ByRow):
    """m blocks of the same number of samples.

    Attributes:
        t: (m,) time of the last sample of each [s].
        sums: (m, k) of standardised residuals. squares: (m,) of their squares; about the block's own mean, if it has
            ``LEAST`` samples, so that a mean that is off is not taken for noise.
        predicted: (m, k) variance of the model's own error.
        directions: (m, 3) of the field in the sensor's frame, in the middle of each.
    """

    sums: Array
    squares: Array
    predicted: Array
    directions: Array

    @classmethod
    def empty(cls, k: int) -> Self:
        """None, of residuals of k series."""
        return cls(np.empty(0), np.empty((0, k)), np.empty(0), np.empty((0, k)), np.empty((0, 3)))

    @classmethod
    def of(cls, residuals: Residuals, length: int) -> Self:
        """Whole blocks of so many samples; what is left over is left out."""
        count = len(residuals) // length
        rows = slice(0, count * length)
        values = residuals.values[rows].reshape(count, length, residuals.values.shape[1])
        return cls(
            residuals.t[rows][length - 1 :: length],
            values.sum(axis=1),
            np.square(values - (values.mean(axis=1, keepdims=True) if length >= LEAST else 0.0)).sum(axis=(1, 2)),
            residuals.predicted[rows][length // 2 :: length],
            residuals.directions[rows][length // 2 :: length],
        )


def within(t: Array, ends: Array, length_s: float) -> Mask:
    """Which times (n,) [s] lie in one of the spans of a length [s] that end at ``ends`` (m,), increasing."""
    later = np.append(ends, np.inf)[np.searchsorted(ends, t)]
    return np.asarray(later - t < length_s)


class Rested:
    """Lets blocks through in whose middle a sensor rested, half a second later."""

    def __init__(self, block_s: float) -> None:
        """Args: block_s: length of a block [s]."""
        self._beside = math.ceil(_BESIDE_S / block_s - 1e-9)
        self._waiting: Blocks | None = None
        self._variances = np.empty(0)
        self._past = np.empty(0)
        self._quietest = np.inf

    def through(self, blocks: Blocks, readings: Array, length: int) -> Blocks:
        """The blocks that are decided by now and rested.

        Args:
            blocks: that come next. readings: (n, 3) of them. length: samples of a block.
        """
        parts = readings[: len(blocks) * length].reshape(len(blocks), length, 3)
        own = parts.var(axis=1, ddof=1).sum(axis=1)
        self._past = np.concatenate([self._past, own])
        while len(self._past) >= 2 * _REMEMBERED:
            self._quietest = min(self._quietest, float(np.quantile(self._past[:_REMEMBERED], _QUIETEST)))
            self._past = self._past[_REMEMBERED:]
        if self._waiting is None or self._waiting.sums.shape[1] != blocks.sums.shape[1]:
            self._waiting, self._variances = Blocks.empty(blocks.sums.shape[1]), np.empty(0)
        waiting, variances = self._waiting.then(blocks), np.concatenate([self._variances, own])
        width = 2 * self._beside + 1
        keep = slice(max(len(waiting) - width + 1, 0), None)
        self._waiting, self._variances = waiting.pick(keep), variances[keep]
        if len(waiting) < width:
            return Blocks.empty(blocks.sums.shape[1])
        freedom = 3.0 * (length - 1)
        quietest = chdtri(freedom, 1.0 - _QUIETEST)
        least = min(self._quietest, float(np.quantile(self._past[-_REMEMBERED:], _QUIETEST)))
        limit = float(least * chdtri(freedom, _MISSED / width) / quietest)
        still = sliding_window_view(variances, width).max(axis=1) <= limit
        return waiting.pick(slice(self._beside, len(waiting) - self._beside)).pick(still)
