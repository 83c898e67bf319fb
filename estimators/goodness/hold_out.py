"""Does the calibration predict readings it has not seen?

The recording is cut into blocks of time. For each, the fit is moved to where it would be without the block and without
guard gaps on either side (one Gauss-Newton step, exact to the extent that the model is linear over the change), and the
block's residuals are taken from there. Successive samples know of each other, hence blocks with gaps, not single
samples.

How much larger they get has a known distribution when the model is right: with the block's score s and the guards' g,
the shift is -M (s + g), M the inverse information of the rest, so that the increase of the sum of squares is a
quadratic form in (s, g), whose covariance also follows from the information.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, ndtr

from estimators.goodness.own_optimum import inverted
from estimators.goodness.residuals import Part, Residuals
from estimators.known_angle.identifiability import unit_scale
from rig.arrays import Array
from rig.documents import plain

BLOCKS: Final = 10
#: The share of a block that is left out on either side of it.
GUARD: Final = 0.1


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Residuals of blocks that were not fitted.

    Attributes:
        blocks: how many could be left out. alone: those that could not, as they alone determine some parameter.
        ratio: RMS of the residuals when held out over that when fitted.
        p_value: of the block that is predicted worst, for as many blocks as there are.
        worst_s: begin and end of that block [s].
        block_p_values: of each block; NaN for those that could not be left out.
    """

    blocks: int
    alone: tuple[int, ...]
    ratio: float
    p_value: float
    worst_s: tuple[float, float]
    block_p_values: Array

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {name: plain(getattr(self, name)) for name in ("blocks", "alone", "ratio", "p_value", "worst_s")}


def hold_out(residuals: Residuals) -> HoldOut | None:
    """Leave out block after block.

    Args:
        residuals: of a sensor, at the optimum of their own samples (``at_optimum``).

    Returns:
        None where the recording is too short, or every block is needed.
    """
    n = len(residuals)
    if n < 2 * BLOCKS:
        return None
    edges = np.linspace(0, n, BLOCKS + 1).round().astype(int)
    guard = int(GUARD * (n // BLOCKS))
    inner = np.stack([edges[:-1] + guard, edges[1:] - guard], axis=1)
    cuts = [*np.concatenate([edges[:-1, None], inner], axis=1).ravel().tolist(), n]
    parts = [residuals.part(first, stop) for first, stop in pairwise(cuts)]
    total = _sum(parts)
    scale = unit_scale(total.information)
    full = inverted(total.information, scale)
    fitted = held = 0.0
    p_values = np.full(BLOCKS, np.nan)
    for block in range(BLOCKS):
        own = _sum(parts[3 * block : 3 * block + 3])
        guards = _sum([parts[i] for i in (3 * block - 1, 3 * block + 3) if 0 <= i < len(parts)])
        rest = total.information - own.information - guards.information
        inverse = None if full is None else inverted(rest, scale)
        if inverse is None or full is None:
            continue
        increase, p_values[block] = _increase(own, guards, inverse, full)
        fitted += own.square
        held += own.square + increase
    told = np.isfinite(p_values)
    if not told.any() or fitted <= 0.0:
        return None
    worst = int(np.nanargmin(p_values))
    t = residuals.t
    return HoldOut(
        int(told.sum()),
        tuple(int(block) for block in np.flatnonzero(~told)),
        float(np.sqrt(held / fitted)),
        min(1.0, int(told.sum()) * float(p_values[worst])),
        (float(t[edges[worst]]), float(t[edges[worst + 1] - 1])),
        p_values,
    )


def _sum(parts: list[Part]) -> Part:
    return Part(
        np.asarray(sum(part.information for part in parts)),
        np.asarray(sum(part.score for part in parts)),
        sum(part.square for part in parts),
    )


def _increase(own: Part, guards: Part, inverse: Array, full: Array) -> tuple[float, float]:
    """By how much a block's sum of squares grows when it is held out, and the probability of as much or more."""
    moved = inverse @ (own.score + guards.score)
    increase = float(2.0 * own.score @ moved + moved @ own.information @ moved)
    p = len(full)
    both = np.zeros((2 * p, 2 * p))  # the information of block and guards ..
    both[:p, :p], both[p:, p:] = own.information, guards.information
    stacked = np.vstack([own.information, guards.information])
    covariance = both - stacked @ full @ stacked.T  # .. less what the fit has taken: the covariance of the scores
    form = np.tile(inverse @ own.information @ inverse, (2, 2))
    form[:p, :p] += 2.0 * inverse
    form[:p, p:] += inverse
    form[p:, :p] += inverse
    return increase, tail_probability(form, covariance, increase)


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
