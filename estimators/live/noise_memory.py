"""How far the noise's memory spreads the means of windows, learnt from the stream, and what that makes of a test.

Of white noise the mean square of a window's mean, over what the readings' variance makes of it, is one whatever the
window's length. Of noise with a memory it grows with the length, and how far is learnt from the windows so far. A
window is then held against these by Fisher's ratio of two variances, so that what few windows tell counts for little.

Windows that are remembered by later ones tell less than as many independent ones: the variance of a mean square grows
by one plus twice the sum of the squared correlations (Bartlett, "On the theoretical specification and sampling
properties of autocorrelated time-series", 1946). These are seen between the longest windows that are tested, and all of
a mean square beyond one is taken to be remembered so long.

Longer windows come later. Until they have been seen themselves, the excess over one of windows before is taken times
their length over those's: no memory makes it grow faster, as readings cannot be more alike than the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import betainc, betaincinv

from rig.arrays import Array

#: Degrees of freedom of what is known.
CERTAIN: Final = 1e9
#: Of so many no more is learnt.
_ENOUGH: Final = 100.0
#: Successive windows that are remembered at most, and how many independent ones show how long the noise remembers.
_FOLLOWED: Final = 2048
_SHOWN: Final = 5.0
#: A mean square that white noise exceeds more seldom shows a memory.
_SURE: Final = 1e-3
#: What a window may add to what is known, whenever it comes, is what noise exceeds with this probability: a change that
#: begins below the tests' limits would be taken up as noise, and hide itself, otherwise.
_SELDOM: Final = 1e-3


class Memory:
    """Mean squares of windows of several lengths, over those of white noise.

    Attributes:
        ratio: (w,) by how much the noise's memory widens each length's test; at least one.
        freedom: (w,) degrees of freedom behind it; zero: nothing is known.
        settled: (w,) of which nothing more is to be learnt.
    """

    def __init__(self, lengths: Sequence[int], chance: float, followed: int) -> None:
        """Args:
        lengths: of the windows, increasing.
        chance: of a false alarm by one test, at which the better one of two ways to learn a ratio is chosen.
        followed: place of the length whose windows are ``follow``ed.
        """
        self._growth = np.diff(np.log(np.asarray(lengths, dtype=float)), prepend=0.0)
        self._chance, self._followed = chance, followed
        self._sums = np.zeros((len(lengths), 2))  # of squares over degrees of freedom, and of these degrees
        self._windows = np.zeros(len(lengths))
        self._means: deque[Array] = deque(maxlen=_FOLLOWED)
        self._correlated = 0.0
        self.ratio = np.ones(len(lengths))
        self.freedom = np.zeros(len(lengths))
        self.settled = np.zeros(len(lengths), dtype=bool)

    def add(self, place: int, total: float, windows: float, degrees: float) -> None:
        """Windows of one length.

        Args:
            place: of the length.
            total: sum of their squares over ``degrees``. windows: how many there are that do not overlap.
            degrees: of freedom of each.
        """
        if not self.settled[place]:
            self._sums[place] += total * degrees, windows * degrees
            self._windows[place] += windows

    def follow(self, means: Array) -> None:
        """Standardised means (m, k) of the next windows, which do not overlap."""
        if not len(means) or self.settled[self._followed]:
            return
        self._means.extend(means)
        values = np.array(self._means)
        count, k = values.shape
        spectrum = np.square(np.abs(np.fft.rfft(values, 2 * count, axis=0))).sum(axis=1)
        products = np.fft.irfft(spectrum)[:count]
        by_chance = float((1.0 - np.arange(1, count) / count).sum()) / (count * k)
        seen = float(np.square(products[1:] / max(products[0], 1e-300)).sum())
        self._correlated = 2.0 * max(seen - by_chance, 0.0)

    def learn(self, degrees: float, settle: bool = False) -> None:
        """Bring the ratios up to date; ``degrees`` of freedom of a test; ``settle``: what is known well enough."""
        for place, freedom in enumerate(self._sums[:, 1]):
            if self.settled[place]:
                continue
            own = self._ratio_of(place)
            freedom = float(freedom) / self._alike(place, own)
            self.ratio[place], self.freedom[place] = own, freedom
            if settle and freedom >= _ENOUGH:
                self.settled[place] = True
            if place == 0:
                continue
            growth = float(np.exp(self._growth[place]))
            before = float(self.ratio[place - 1])
            carried = 1.0 + growth * (before - 1.0)
            # the share of ``carried`` that is uncertain with ``before`` is growth * before
            known = float(self.freedom[place - 1]) * (carried / (growth * before)) ** 2
            if carried * _limit(self._chance, degrees, known) < own * _limit(self._chance, degrees, freedom):
                self.ratio[place], self.freedom[place] = carried, known

    @property
    def beyond(self) -> bool:
        """Whether the noise surely has a memory, and one that is long against all that was seen of it."""
        place = self._followed
        _, freedom = self._sums[place]
        sure = float(exceeded(np.array(self._ratio_of(place)), float(freedom), CERTAIN)) < _SURE
        return sure and self._windows[place] < _SHOWN * self._slow

    @property
    def _slow(self) -> float:
        """How many of the windows that are followed tell as much as one independent one, of what is remembered."""
        ratio, windows = self._ratio_of(self._followed), max(float(self._windows[self._followed]), 1.0)
        return min(1.0 + self._correlated * (ratio / max(ratio - 1.0, 1e-9)) ** 2, windows)

    def _ratio_of(self, place: int) -> float:
        total, freedom = self._sums[place]
        return max(1.0, float(total / freedom)) if freedom > 0.0 else 1.0

    def _alike(self, place: int, ratio: float) -> float:
        """How many windows tell as much as one independent one of a mean square of ``ratio``."""
        more, followed = ratio - 1.0, max(self._windows[self._followed], 1.0)
        slow = max(self._windows[place] / followed * self._slow, 1.0)
        return float((1.0 + 2.0 * more + more**2 * slow) / ratio**2)

    def chance_of(self, place: int, squares: Array, degrees: float) -> Array:
        """The probability that noise makes as much of squares over degrees of freedom; any shape."""
        return exceeded(squares / self.ratio[place], degrees, float(self.freedom[place]))

    def most(self, place: int, degrees: float) -> float:
        """The mean square that noise hardly ever exceeds, as far as it is known; of so many degrees of freedom."""
        return float(self.ratio[place]) * _limit(_SELDOM, degrees, float(self.freedom[place]))

    def known(self) -> None:
        """Take noise to be white: nothing is to be learnt."""
        self.freedom[:], self.settled[:] = CERTAIN, True


def exceeded(ratio: Array, degrees: float, freedom: float) -> Array:
    """The probability that Fisher's ratio of two variances, of so many degrees of freedom, exceeds ``ratio``."""
    if not freedom > 0.0:
        return np.ones_like(ratio)
    return np.asarray(betainc(0.5 * freedom, 0.5 * degrees, freedom / (freedom + degrees * ratio)))


def _limit(chance: float, degrees: float, freedom: float) -> float:
    """What Fisher's ratio of variances exceeds with a probability of ``chance``."""
    if not freedom > 0.0:
        return np.inf
    share = float(betaincinv(0.5 * freedom, 0.5 * degrees, chance))
    return freedom * (1.0 - share) / (degrees * share) if share > 0.0 else np.inf
