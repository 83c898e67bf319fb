"""Residuals about the recording's own optimum, and how far from it the calibration is.

The tests of directions, blocks and memory ask what the model misses, whichever calibration is held against the
recording: its own, of all samples or of some, or one from another day. So the residuals are first moved by one
Gauss-Newton step to where a fit of just these samples would leave them. The step itself tells whether the calibration
holds: with the information F of these n samples and the score U of the calibration, U F^-1 U is chi-square with p
degrees of freedom if the parameters are those; or 1 + n / m times that, if they come from m others of the same kind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from estimators._json import AsJson
from estimators.goodness.residuals import Part, Residuals
from estimators.known_angle.identifiability import Told
from rig.arrays import Array

_NULL = 1e-9


@dataclass(frozen=True)
class Transfer(AsJson):
    """Whether a calibration's parameters are those of a recording.

    Attributes:
        chi_square: U F^-1 U / (1 + n / m); next to nothing for the recording it comes from.
        parameters: p, its degrees of freedom.
        p_value: of as much or more.
    """

    chi_square: float
    parameters: int
    p_value: float


def at_optimum(residuals: Residuals, samples: int) -> tuple[Residuals, Transfer | None]:
    """Move residuals to the optimum of their own samples.

    Args:
        residuals: of a calibration.
        samples: that it comes from.

    Returns:
        The moved residuals, and how far they were; as they are, and None, where these samples cannot tell all
        parameters.
    """
    total = residuals.part(0, len(residuals))
    inverse = inverted(total.information)
    if inverse is None:
        return residuals, None
    step = inverse @ total.score
    chi_square = float(total.score @ step) / (1.0 + residuals.readings / max(samples, 1))
    values = residuals.values - residuals.change(step)

    def part(first: int, stop: int) -> Part:
        own = residuals.part(first, stop)
        turned = own.information @ step
        square = own.square - 2.0 * float(own.score @ step) + float(step @ turned)
        return Part(own.information, own.score - turned, square)

    p = len(step)
    return replace(residuals, values=values, part=part), Transfer(chi_square, p, float(chdtrc(p, max(chi_square, 0.0))))


def inverted(information: Array, scale: Array | None = None) -> Array | None:
    """The inverse (p, p), or None where it is singular, or not finite.

    Args:
        information: (p, p).
        scale: (p,) by which both sides are multiplied first; None: such that the diagonal is one.
    """
    if not np.isfinite(information).all():
        return None
    told = Told.of(information, scale)
    return told.covariance if _NULL * told.condition < 1.0 else None
