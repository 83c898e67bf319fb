"""Whether a fit of six parameters, without cross terms, needed the nine of one with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from estimators._json import AsJson
from estimators.ellipsoid.monomials import products, symmetric
from estimators.goodness.residuals import Residuals

SIX: Final = 6
NINE: Final = 9
_MOST_STEPS: Final = 20
#: A step that changes the sum of squares by less is the last one.
_SAME: Final = 1e-9


@dataclass(frozen=True)
class CrossTerms(AsJson):
    """Residuals of six parameters against those of nine.

    Attributes:
        ratio: root mean square of the former over that of the latter, each by its degrees of freedom.
        p_value: chance of such a ratio or a larger one without cross terms.
    """

    ratio: float
    p_value: float


def cross_terms(residuals: Residuals, reference: float) -> CrossTerms | None:
    """Fit nine parameters to the fields that six have left, and hold the residuals against each other.

    The nine are a symmetric change E (3, 3) and an offset d (3,) of the fields h: |h + E h + d| = H, Camps (6), by
    Gauss-Newton from zero. Under six, (s6 - s9) / 3 over s9 / (n - 9) has the F distribution with 3 and n - 9 degrees
    of freedom, s being sums of squares.

    Args:
        residuals: by magnitude, of the recording that the six were fitted to.
        reference: H [field unit].

    Returns:
        None where n readings are too few for it.
    """
    sigma, start = residuals.sigma[:, 0], residuals.values[:, 0]
    freedom = len(start) - NINE
    if freedom < 1:
        return None
    magnitude = reference + start
    fields = residuals.directions * magnitude[:, None]
    of_six = least = float(np.square(start / sigma).sum())
    change, offset = np.zeros((3, 3)), np.zeros(3)
    for _ in range(_MOST_STEPS):
        moved = fields + fields @ change + offset
        length = np.linalg.norm(moved, axis=1)
        left = (start + length - magnitude) / sigma
        square = float(left @ left)
        done = least - square < _SAME * of_six
        least = min(least, square)
        if done and change.any():
            break
        unit = moved / np.where(length > 0.0, length, 1.0)[:, None]
        rows = np.column_stack([products(unit, fields), unit]) / sigma[:, None]
        step, _, rank, _ = np.linalg.lstsq(rows, -left)
        if rank < NINE:
            return None
        change += symmetric(step[:SIX])
        offset += step[SIX:]
    if not 0.0 < least < np.inf:
        return None
    f = (of_six - least) / (NINE - SIX) / (least / freedom)
    ratio = float(np.sqrt(of_six / (freedom + NINE - SIX) / (least / freedom)))
    return CrossTerms(ratio, float(fdtrc(NINE - SIX, freedom, max(f, 0.0))))
