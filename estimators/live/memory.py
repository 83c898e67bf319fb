"""How far the noise's memory spreads the means of windows, learnt from the stream, and what that makes of a test.

Of white noise the mean square of a window's mean, over what the readings' variance makes of it, is one whatever the
window's length. Of noise with a memory it grows with the length, and how far is learnt from the windows so far. A
window is then held against these by Fisher's ratio of two variances, so that what few windows tell counts for little.

Longer windows come later. Until they have been seen themselves, the excess over one of windows a quarter as long is
taken four times: no memory makes it grow faster, as readings cannot be more alike than the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaincinv

Array = NDArray[np.float64]

#: Degrees of freedom of what is known.
CERTAIN: Final = 1e9


class Memory:
    """Mean squares of windows of several lengths, over those of white noise.

    Attributes:
        ratio: (w,) by how much the noise's memory widens each length's test; at least one.
        freedom: (w,) degrees of freedom behind it; zero: nothing is known.
    """

    def __init__(self, lengths: Sequence[int], chance: float) -> None:
        """Args:
        lengths: of the windows, increasing.
        chance: of a false alarm by one test, at which the better one of two ways to learn a ratio is chosen.
        """
        self._growth = np.diff(np.log(np.asarray(lengths, dtype=float)), prepend=0.0)
        self._chance = chance
        self._sums = np.zeros((len(lengths), 2))  # of squares over degrees of freedom, and of these degrees
        self.ratio = np.ones(len(lengths))
        self.freedom = np.zeros(len(lengths))

    def add(self, place: int, total: float, windows: float, degrees: float) -> None:
        """Windows of one length.

        Args:
            place: of the length.
            total: sum of their squares over ``degrees``. windows: how many there are that do not overlap.
            degrees: of freedom of each.
        """
        self._sums[place] += total * degrees, windows * degrees

    def learn(self, degrees: float) -> None:
        """Bring the ratios up to date; ``degrees`` of freedom of a test."""
        for place, (total, freedom) in enumerate(self._sums):
            own = max(1.0, total / freedom) if freedom > 0.0 else 1.0
            self.ratio[place], self.freedom[place] = own, freedom
            if place == 0:
                continue
            growth = float(np.exp(self._growth[place]))
            before = self.ratio[place - 1]
            carried = 1.0 + growth * (before - 1.0)
            # the share of ``carried`` that is uncertain with ``before`` is growth * before
            known = self.freedom[place - 1] * (carried / (growth * before)) ** 2
            if carried * _limit(self._chance, degrees, known) < own * _limit(self._chance, degrees, freedom):
                self.ratio[place], self.freedom[place] = carried, known

    def chance_of(self, place: int, squares: Array, degrees: float) -> Array:
        """The probability that noise makes as much of squares over degrees of freedom; any shape."""
        return exceeded(squares / self.ratio[place], degrees, float(self.freedom[place]))

    def known(self) -> None:
        """Take noise to be white: nothing is to be learnt."""
        self.freedom[:] = CERTAIN


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
