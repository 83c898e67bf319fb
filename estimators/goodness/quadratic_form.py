"""The distribution of a quadratic form of Gaussian variables."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, ndtr

from rig.arrays import Array


def tail_probability(form: Array, covariance: Array, value: float) -> float:
    """P(z^T form z >= value) of z ~ N(0, covariance).

    With the eigenvalues a of form times covariance the quadratic form is a sum of chi-squares of one degree, each times
    an a. Its tail is that of D. Kuonen's saddlepoint approximation ("Saddlepoint approximations for distributions of
    quadratic forms in normal variables", Biometrika 86, 1999), good to some per cent of itself however small it is.
    Near the mean, where that has a removable singularity, a chi-square with the same mean and variance stands in
    (Satterthwaite).

    Args:
        form: (m, m) symmetric.
        covariance: (m, m), of any rank.
        value: to be exceeded.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    weights = np.linalg.eigvalsh(root.T @ form @ root)
    mean, variance = float(weights.sum()), 2.0 * float(np.square(weights).sum())
    if mean <= 0.0 or variance <= 0.0:
        return 1.0
    if abs(value - mean) < 0.1 * np.sqrt(variance) or value <= 0.0:
        return float(chdtrc(2.0 * mean**2 / variance, max(0.0, 2.0 * mean * value / variance)))
    doubled = 2.0 * weights

    def slope(zeta: float) -> float:
        return float((weights / (1.0 - zeta * doubled)).sum()) - value

    # The derivative of the cumulant generating function rises from below to infinity at the first pole.
    high = (1.0 - 1e-12) / float(doubled[-1])
    low = (1.0 - 1e-12) / float(doubled[0]) if doubled[0] < 0.0 else -float(len(weights)) / (2.0 * value)
    if slope(high) <= 0.0:  # so far out that nothing is left
        return 0.0
    if slope(low) >= 0.0:
        return 1.0
    zeta = float(brentq(slope, low, high, xtol=1e-14 * high, rtol=1e-12))
    factor = 1.0 - zeta * doubled
    cumulant = -0.5 * float(np.log(factor).sum())
    w = float(np.sign(zeta)) * np.sqrt(max(2.0 * (zeta * value - cumulant), 0.0))
    v = zeta * np.sqrt(2.0 * float(np.square(weights / factor).sum()))
    if w == 0.0 or v / w <= 0.0:
        return float(chdtrc(2.0 * mean**2 / variance, 2.0 * mean * value / variance))
    return float(ndtr(-(w + np.log(v / w) / w)))
