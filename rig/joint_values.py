"""Joint values as people give them, deg or m of joints that slide, and as the rig has them, rad and m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array, Mask


def joint_values(values: ArrayLike, slides: Sequence[int]) -> Array:
    """Joint values (..., N) in deg, or m of the joints that slide (numbers from 1), in rad and m."""
    given = np.array(values, dtype=float)
    return np.where(_sliding(given, slides), given, np.radians(given))


def given_values(q: ArrayLike, slides: Sequence[int]) -> Array:
    """The reverse of ``joint_values``."""
    own = np.array(q, dtype=float)
    return np.where(_sliding(own, slides), own, np.degrees(own))


def _sliding(values: Array, slides: Sequence[int]) -> Mask:
    """(N,) which columns of joint values (..., N) are of joints that slide."""
    return np.isin(np.arange(1, values.shape[-1] + 1), slides)
