"""Intervals of what a study counts and measures."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from rig.arrays import Array

#: Intervals are given at this level.
LEVEL: Final = 0.95
_TAIL: Final = 0.5 * (1.0 - LEVEL)


def spread_interval(freedom: int) -> tuple[float, float]:
    """What a standard deviation of so many degrees of freedom is to be multiplied with, for the interval's ends."""
    low, high = np.sqrt(freedom / chi2.isf([_TAIL, 1.0 - _TAIL], freedom)).tolist()
    return low, high


def clopper_pearson(inside: NDArray[Any], draws: int) -> tuple[Array, Array]:
    """The exact interval of a probability from how often something has happened."""
    low = np.where(inside > 0, beta.ppf(_TAIL, np.maximum(inside, 1), draws - inside + 1), 0.0)
    high = np.where(inside < draws, beta.ppf(1.0 - _TAIL, inside + 1, np.maximum(draws - inside, 1)), 1.0)
    return low, high
