"""Further steps of whitening, beyond a floor's own filter, and readings that are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from rig.arrays import Array

#: So many readings on either side of one that is left out stand for it, where no more than twice as many are.
_NEIGHBOURS: Final = 4
#: Factors of all frequencies that differ by less than this share of them are one.
_ONE_FACTOR: Final = 1e-12


@dataclass(frozen=True)
class Step:
    """A further factor of the whitening.

    Attributes:
        column: the channel.
        factor: (count,) of each whitened reading, or of each coefficient of their cosine transform (DCT-II).
        in_time: which of the two.
        part: the number of the recording, of several, whose readings it is of.
        of_floor: whether the floor's own size changes so: it is one after that.
    """

    column: int
    factor: Array
    in_time: bool
    part: int = 0
    of_floor: bool = False

    @cached_property
    def scales(self) -> bool:
        """Whether it scales each whitened reading by itself: a factor of all frequencies is one of all times."""
        return self.in_time or float(np.ptp(self.factor)) <= _ONE_FACTOR * float(self.factor[0])

    def shortened(self, count: int) -> Step:
        """For means over neighbouring samples: the step's lowest frequencies, or the mean of its factors."""
        if not self.in_time:
            return replace(self, factor=self.factor[:count])
        factor = self.factor[: len(self.factor) // count * count].reshape(count, -1).mean(axis=1)
        return replace(self, factor=factor)

    def __call__(self, white: Array) -> Array:
        """Whitened values (..., count)."""
        if self.scales:
            return white * (self.factor if self.in_time else self.factor[0])
        return np.asarray(idct(dct(white, norm="ortho") * self.factor, norm="ortho"))


@dataclass(frozen=True)
class Gaps:
    """Where a channel's readings are left out; nowhere if all are, as nothing stands for them.

    Attributes:
        at: (g,) which. near: (g, 2 k) the nearest that are there, k before and k after.
        long: (g,) which of them are in long gaps. images: (m, 2) of these a reading as far before the gap, and one as
            far behind it, or nearest to that. later: (m,) weight of the second.
    """

    at: NDArray[np.intp]
    near: NDArray[np.intp]
    long: NDArray[np.bool_]
    images: NDArray[np.intp]
    later: Array

    @classmethod
    def of(cls, weights: Array) -> Gaps:
        """Of a channel's weights (count,)."""
        there = np.flatnonzero(weights > 0.0)
        at = np.flatnonzero(weights == 0.0)[: len(weights) if there.size else 0]
        own = np.searchsorted(there, at)[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS)
        near = there[np.clip(own, 0, len(there) - 1)]
        run = np.cumsum(np.diff(at, prepend=at[:1]) > 1)
        long = np.bincount(run, minlength=1)[run] > 2 * _NEIGHBOURS
        edges, inside = near[long, _NEIGHBOURS - 1 : _NEIGHBOURS + 1], at[long][:, None]
        beyond = 2 * edges - inside - np.sign(edges - inside)  # the edge itself is its neighbour's image
        images = there[np.clip(np.searchsorted(there, beyond), 0, len(there) - 1)]
        width = edges[:, 1] - edges[:, 0]  # none at the ends, where both edges are one
        later = np.where(width > 0, (inside[:, 0] - edges[:, 0]) / np.maximum(width, 1), 0.0)
        return cls(at, near, long, images, later)

    @property
    def first(self) -> int:
        """The first that is there."""
        return int(np.argmin(np.append(self.at, -1) == np.arange(len(self.at) + 1)))

    def bridged(self, means: Array) -> Array:
        """Values (..., count) with a straight line in place of those that are left out: a filter must not carry these
        on."""
        before, after = self.near[:, _NEIGHBOURS - 1], self.near[:, _NEIGHBOURS]
        share = np.clip((self.at - before) / np.maximum(after - before, 1), 0.0, 1.0)
        means = means.copy()
        means[..., self.at] = (1.0 - share) * means[..., before] + share * means[..., after]
        return means

    def filled(self, white: Array) -> Array:
        """Whitened values (..., count) with others in place of those that are left out: the mean of the nearest, and in
        long gaps the mirror images of what is on either side, one fading into the other.

        What is slow goes on, with no jump at an edge: so a cosine transform goes on at its ends.
        """
        if not self.at.size:
            return white
        there, white = white, white.copy()
        white[..., self.at] = there[..., self.near].mean(axis=-1)
        before, after = np.moveaxis(there[..., self.images], -1, 0)
        white[..., self.at[self.long]] = (1.0 - self.later) * before + self.later * after
        return white

    def share(self, count: int) -> float:
        """Mean square of so many filled values of white noise, but for the means of the nearest."""
        imaged = float(np.sum((1.0 - self.later) ** 2 + self.later**2))
        return max((count - len(self.at) + imaged) / count, 1e-9)

    def emptied(self, white: Array) -> Array:
        """Values (..., count) with nothing where they are left out."""
        white[..., self.at] = 0.0
        return white


def after_steps(steps: Sequence[Step], white: Array, gaps: Gaps) -> Array:
    """Whitened values (..., count) of one channel after further steps, in this order."""
    for step in joined(steps, gaps):
        white = step(white if step.scales else gaps.filled(white))
    return gaps.emptied(white) if steps else white


def joined(steps: Sequence[Step], gaps: Gaps) -> list[Step]:
    """Steps of one channel, neighbours of one kind as one; but of frequency where readings are left out, as before each
    of these steps others stand for them."""
    found: list[Step] = []
    for step in steps:
        if found and found[-1].in_time == step.in_time and (step.in_time or not gaps.at.size):
            found[-1] = replace(step, factor=found[-1].factor * step.factor)
        else:
            found.append(step)
    return found


def products_after(spectrum: Array, gaps: Gaps) -> Array:
    """(k, k) products of values, of which there are cosine transforms (k, count), with nothing where they are left out.

    The transform keeps products: it is undone only where something is left out.
    """
    left = gaps.emptied(idct(spectrum, norm="ortho")) if gaps.at.size else spectrum
    return np.asarray(left @ left.T)
