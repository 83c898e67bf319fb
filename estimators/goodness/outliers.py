"""Readings that no noise explains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, pdtrc, stdtr

from estimators.goodness.residuals import Residuals
from rig.arrays import Array, Rows

#: Readings farther from the model than so many standard deviations are outliers: 1 in 1.7 million Gaussian ones.
CUT: Final = 5.0
#: Median absolute deviation of a unit normal.
_MAD: Final = 0.6744897501960817
_SIGNIFICANT: Final = 1e-4
_SHOWN: Final = 20


@dataclass(frozen=True, eq=False)
class Outliers:
    """The outliers of a recording.

    Attributes:
        rows: (m,) samples with one, ascending.
        count: readings, of all channels. expected: in Gaussian noise.
        largest: the largest residual in these.
        significant: more than chance explains (false alarms: 1e-4).
        pull: how far they move the mean of a channel, in standard errors of it: the largest of the channels.
        times_s: of the first twenty [s].
    """

    rows: Rows
    count: int
    expected: float
    largest: float
    significant: bool
    pull: float
    times_s: tuple[float, ...]

    def to_json(self) -> dict[str, Any]:
        """What a calibration's quality holds of it."""
        return {
            "count": self.count,
            "samples": len(self.rows),
            "expected": self.expected,
            "largest_sigmas": self.largest,
            "pull_sigmas": self.pull,
            "significant": self.significant,
            "times_s": list(self.times_s),
        }


def outliers(residuals: Residuals) -> Outliers:
    """Look for residuals beyond five robust standard deviations.

    They are significant if they are more than Gaussian noise has, and if the farthest is too far for Student's
    distribution on what is left (Bonferroni): of few readings the median deviation is a poor scale.
    """
    z = residuals.standardised
    spread = robust_scale(z)
    ratio = np.abs(z) / spread
    out = ratio > CUT
    rows = np.flatnonzero(out.any(axis=1))
    count = int(out.sum())
    expected = z.size * 2.0 * float(ndtr(-CUT))
    left = z[~out]
    freedom = max(1.0, float(left.size - residuals.parameters))
    scatter = max(float(np.sqrt(np.square(left).sum() / freedom)), np.finfo(float).tiny)
    farthest = 2.0 * z.size * float(stdtr(freedom, -float(np.abs(z).max()) / scatter))
    significant = count > 0 and max(farthest, float(pdtrc(count - 1, expected))) < _SIGNIFICANT
    with np.errstate(invalid="ignore"):
        pull = np.abs(np.where(out, z, 0.0).sum(axis=0)) / (spread * np.sqrt(len(z)))
    return Outliers(
        rows,
        count,
        expected,
        float(ratio.max()),
        significant,
        float(pull.max()),
        tuple(float(value) for value in residuals.t[rows[:_SHOWN]]),
    )


def robust_scale(values: ArrayLike) -> Array:
    """(k,) standard deviation of (n, k) from the median absolute value; half of them may be anything."""
    middle = np.median(np.abs(np.asarray(values, dtype=float)), axis=0)
    return np.asarray(np.maximum(middle / _MAD, np.finfo(float).tiny))
