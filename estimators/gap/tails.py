"""Logarithms of tail probabilities, by scipy.special: scipy.stats is slow to import."""

from __future__ import annotations

import numpy as np
from scipy.special import bdtrc, chdtrc, gammaln


def chi2_logsf(statistic: float, rank: int) -> float:
    """log P(chi-square with ``rank`` degrees of freedom > statistic); far out by its leading term (DLMF 8.11.2)."""
    tail = float(chdtrc(rank, statistic))
    if tail > 0.0:
        return float(np.log(tail))
    half, order = 0.5 * statistic, 0.5 * rank
    return float(-half + (order - 1.0) * np.log(half) - gammaln(order))


def binom_logsf(successes: float, trials: int, probability: float) -> float:
    """log P(more than so many successes); minus infinity where that is less than a float can be."""
    tail = float(bdtrc(successes, trials, probability)) if successes >= 0 else 1.0
    return float(np.log(tail)) if tail > 0.0 else -np.inf
