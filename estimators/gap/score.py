"""Score tests: how much of the whitened residual a candidate's columns explain beyond what is explained already.

LM = r' MZ (Z'MZ)^+ Z'M r, chi-square with rank(MZ) degrees of freedom under the base model (Rao's score test).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.stats import chi2

from estimators.gap.bench import orthonormal, project

Array = NDArray[np.float64]

#: A direction of which the projection leaves less than this share of its length is absorbed: nobody can see it.
ABSORBED = 3e-3


@dataclass(frozen=True)
class Score:
    """What one set of columns explains.

    Attributes:
        statistic: LM, chi-square under the base model.
        rank: its degrees of freedom.
        strengths: (m,) least-squares strengths of the columns.
        visible: largest share of a column's length that the projection leaves, 0 to 1.
    """

    statistic: float
    rank: int
    strengths: Array
    visible: float

    @property
    def evidence(self) -> float:
        """Twice the log Bayes factor against the base model; see ``evidence``."""
        return evidence(self.statistic, self.rank)

    @property
    def log_p(self) -> float:
        """Logarithm of the p-value."""
        return float(chi2.logsf(self.statistic, self.rank)) if self.rank else 0.0


def evidence(statistic: float, rank: int) -> float:
    """Twice the log Bayes factor of ``rank`` strengths under Zellner's g-prior, g by empirical Bayes.

    George and Foster, "Calibration and empirical Bayes variable selection" (Biometrika 87, 2000), equation (8) with one
    model: g = statistic / rank - 1 gives statistic - rank - rank log(statistic / rank), zero where that g is negative.
    """
    if rank == 0 or statistic <= rank:
        return 0.0
    return float(statistic - rank - rank * np.log(statistic / rank))


def solve(gram: Array, moment: Array, length: Array) -> Score:
    """The score from projected Gram matrix Z'MZ (m, m), Z'Mr (m,) and the columns' unprojected lengths (m,)."""
    length = np.maximum(length, 1e-100)
    values, vectors = eigh(gram / np.outer(length, length), check_finite=False)
    kept = values > ABSORBED**2
    visible = float(np.sqrt(max(values[-1], 0.0)))
    if not kept.any():
        return Score(0.0, 0, np.zeros(len(length)), visible)
    along = vectors[:, kept].T @ (moment / length)
    strengths = np.where(length > 1e-100, vectors[:, kept] @ (along / values[kept]) / length, 0.0)
    return Score(float(np.sum(along**2 / values[kept])), int(kept.sum()), strengths, visible)


@dataclass(frozen=True)
class Explained:
    """What is explained already: an orthonormal basis, and the residual with it projected out.

    Attributes:
        basis: (c n, p) orthonormal.
        residual: (c n,) whitened.
    """

    basis: Array
    residual: Array

    def score(self, columns: Array, first: int = 0) -> Score:
        """Score columns (c n, m), or the rows of them from ``first`` on outside which they are zero."""
        rows = slice(first, first + len(columns))
        own = columns.T @ columns
        shared = self.basis[rows].T @ columns
        return solve(own - shared.T @ shared, columns.T @ self.residual[rows], np.sqrt(np.diag(own)))

    def extended(self, columns: Array) -> Explained:
        """With columns (c n, m) explained as well."""
        fresh = orthonormal(project(self.basis, columns))
        fresh = orthonormal(project(self.basis, fresh))  # twice is enough (Parlett 1980, section 6.9)
        return Explained(np.hstack([self.basis, fresh]), project(fresh, self.residual))
