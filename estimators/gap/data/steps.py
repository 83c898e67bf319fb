"""Further steps of whitening, beyond a floor's own filter, and readings that are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

Array = NDArray[np.float64]

#: So many readings on either side of one that is left out stand for it.
_NEIGHBOURS: Final = 4


@dataclass(frozen=True)
class Step:
    """A further factor of the whitening.

    Attributes:
        column: the channel.
        factor: (count,) of each whitened reading, or of each coefficient of their cosine transform (DCT-II).
        in_time: which of the two.
        part: the number of the recording, of several, whose readings it is of.
    """

    column: int
    factor: Array
    in_time: bool
    part: int = 0

    def shortened(self, count: int) -> Step:
        """For means over neighbouring samples: the step's lowest frequencies, or the mean of its factors."""
        if not self.in_time:
            return replace(self, factor=self.factor[:count])
        factor = self.factor[: len(self.factor) // count * count].reshape(count, -1).mean(axis=1)
        return replace(self, factor=factor)

    def __call__(self, white: Array) -> Array:
        """Whitened values (..., count)."""
        if self.in_time:
            return white * self.factor
        return np.asarray(idct(dct(white, norm="ortho") * self.factor, norm="ortho"))


@dataclass(frozen=True)
class Gaps:
    """Where a channel's readings are left out.

    Attributes:
        at: (g,) which. short: (s,) those of them with another reading nearby. near: (s, 2 k) the nearest that are there
            of these, k on either side.
    """

    at: NDArray[np.intp]
    short: NDArray[np.intp]
    near: NDArray[np.intp]

    @classmethod
    def of(cls, weights: Array) -> Gaps | None:
        """Of a channel's weights (count,); None where all readings are there, or none."""
        at, there = np.flatnonzero(weights == 0.0), np.flatnonzero(weights > 0.0)
        if not at.size or not there.size:
            return None
        own = np.searchsorted(there, at)[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS)
        near = there[np.clip(own, 0, len(there) - 1)]
        short = np.abs(near - at[:, None]).min(axis=1) <= _NEIGHBOURS
        return cls(at, at[short], near[short])

    def filled(self, white: Array) -> Array:
        """Whitened values (..., count) with the mean of the nearest in place of those that are left out.

        What is slow goes on, and of white noise nothing is added.
        """
        white = white.copy()
        white[..., self.short] = white[..., self.near].mean(axis=-1)
        return white

    def emptied(self, white: Array) -> Array:
        """Values (..., count) with nothing where they are left out."""
        white[..., self.at] = 0.0
        return white


def after_steps(steps: Sequence[Step], white: Array, gaps: Gaps | None) -> Array:
    """Whitened values (..., count) after further steps, in this order."""
    for step in steps:
        white = step(white if gaps is None or step.in_time else gaps.filled(white))
    return white if gaps is None or not steps else gaps.emptied(white)
