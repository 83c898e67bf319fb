"""Normal scores: each value's rank as what a normal variable has there, so that a few large ones count little."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

from rig.arrays import Array


def normal_scores(values: Array) -> Array:
    """(n, c) of each channel's values (n, c)."""
    return np.asarray(ndtri(np.column_stack([rankdata(own) for own in values.T]) / (len(values) + 1.0)))
