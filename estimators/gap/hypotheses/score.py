"""Score tests: how much of the whitened residual a candidate's columns explain beyond what is explained already.

LM = r' MZ (Z'MZ)^+ Z'M r, chi-square with rank(MZ) degrees of freedom under the base model (Rao's score test).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import Basis, Columns, orthonormal, project, side_by_side
from estimators.gap.hypotheses.log_tail import chi2_logsf
from rig.arrays import Array

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
        return chi2_logsf(self.statistic, self.rank) if self.rank else 0.0


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
    if len(length) == 1:
        return _solve_one(float(gram[0, 0]) / float(length[0]) ** 2, float(moment[0] / length[0]), float(length[0]))
    values, vectors = np.linalg.eigh(gram / np.outer(length, length))
    kept = values > ABSORBED**2
    visible = float(np.sqrt(max(values[-1], 0.0)))
    if not kept.any():
        return Score(0.0, 0, np.zeros(len(length)), visible)
    along = vectors[:, kept].T @ (moment / length)
    strengths = np.where(length > 1e-100, vectors[:, kept] @ (along / values[kept]) / length, 0.0)
    return Score(float(np.sum(along**2 / values[kept])), int(kept.sum()), strengths, visible)


def _solve_one(value: float, along: float, length: float) -> Score:
    """As ``solve``, of one column."""
    visible = float(np.sqrt(max(value, 0.0)))
    if value <= ABSORBED**2:
        return Score(0.0, 0, np.zeros(1), visible)
    return Score(along**2 / value, 1, np.array([along / value / length if length > 1e-100 else 0.0]), visible)


@dataclass(frozen=True)
class Explained:
    """What is explained already: an orthonormal basis, and the residual with it projected out.

    Attributes:
        absorbed: of the calibration's tangent.
        residual: (c n,) whitened.
        added: (c n, k) orthonormal and orthogonal to the first: the causes' tangent.
    """

    absorbed: Basis
    residual: Array
    added: Array | None = None

    def basis(self, rows: slice) -> Array:
        """(rows, p + k) of both."""
        absorbed = self.absorbed.dense(rows)
        return absorbed if self.added is None else side_by_side(absorbed, self.added[rows])

    def of(self, rows: NDArray[np.intp]) -> Explained:
        """In some of the rows: for columns that are zero outside them, and residuals."""
        return Explained(self.absorbed.of(rows), self.residual[rows], None if self.added is None else self.added[rows])

    def score(self, columns: Columns, gram: Array | None = None) -> Score:
        """Score columns.

        Args:
            gram: their Gram matrix with the calibration projected out, where it is known.
        """
        values, rows = columns.values, columns.rows
        if not len(values):
            return Score(0.0, 0, np.zeros(values.shape[1]), 0.0)
        length = np.sqrt(np.einsum("ij,ij->j", values, values))
        gram = self.unexplained(columns, self.projected(columns) if gram is None else gram)
        return solve(gram, values.T @ self.residual[rows], length)

    def unexplained(self, columns: Columns, gram: Array) -> Array:
        """(m, m) of a Gram matrix with the calibration projected out what the causes leave."""
        if self.added is None:
            return gram
        shared = self.added[columns.rows].T @ columns.values
        return np.asarray(gram - shared.T @ shared)

    def projected(self, columns: Columns) -> Array:
        """(m, m) Gram matrix of columns with the calibration projected out."""
        shared = self.absorbed.along(columns.values, columns.first)
        return np.asarray(columns.values.T @ columns.values - shared.T @ shared)

    def without(self, columns: Array) -> Array:
        """Columns (c n, m) with all that is explained projected out."""
        left = project(self.absorbed, columns)
        return left if self.added is None else project(self.added, left)

    def extended(self, columns: Array) -> Explained:
        """With columns (c n, m) explained as well."""
        fresh = orthonormal(self.without(columns))
        fresh = orthonormal(self.without(fresh))  # twice is enough (Parlett 1980, section 6.9)
        added = fresh if self.added is None else side_by_side(self.added, fresh)
        return Explained(self.absorbed, project(fresh, self.residual), added)
