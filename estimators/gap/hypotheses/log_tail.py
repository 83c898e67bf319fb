"""The logarithm of a tail probability, finite however far out."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, gammaln


def chi2_logsf(statistic: float, rank: int) -> float:
    """log P(chi-square with ``rank`` degrees of freedom > statistic); far out by its leading term (DLMF 8.11.2)."""
    tail = float(chdtrc(rank, statistic))
    if tail > 0.0:
        return float(np.log(tail))
    half, order = 0.5 * statistic, 0.5 * rank
    return float(-half + (order - 1.0) * np.log(half) - gammaln(order))
