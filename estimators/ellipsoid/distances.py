"""How far readings lie from an ellipsoid, and what noise of each channel that shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from estimators._small import eigh
from estimators.ellipsoid.shape import Ellipsoid
from rig.arrays import Array

#: No channel is believed to be so much quieter than the mean, in variance: residuals hardly show it.
_QUIETEST: Final = 0.02
#: Beyond this condition the directions do not tell the channels apart.
_CONDITION: Final = 300.0
#: The regression is weighted anew where the variances differ by more than this, until they change by less than that.
_ALIKE: Final = 2.0
_SETTLED: Final = 0.02
_ROUNDS: Final = 30
#: Median of the square of a standard normal deviate, and the mean of it where what exceeds one counts as one.
MEDIAN_SQUARE: Final = 0.45493642311957283
_WITHIN: Final = 0.5160585509617133
_ONES: Final = np.ones(3)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Squared distances of readings from an ellipsoid, to first order.

    With m the normal of the ellipsoid at a reading, scaled so that m . (V - V') is the distance on the unit sphere, and
    s_k the variances of the channels' noise, the squared distance has the expectation sum s_k m_k^2 / count.

    Attributes:
        table: (4, n) the squared components of m [1 / recorded unit squared]; and the distances on the unit sphere,
            squared, times the count.
    """

    table: Array

    @classmethod
    def of(cls, readings: Array, ellipsoid: Ellipsoid, counts: Array | None = None) -> Self:
        """Of readings (n, 3) [recorded unit], which are means of ``counts`` (n,) samples."""
        y = ellipsoid.whitening @ readings.T
        y -= ellipsoid.whitening.dot(ellipsoid.center)[:, None]
        table = np.empty((4, len(readings)))
        normal, squared = table[:3], table[3]
        np.matmul(ellipsoid.whitening, y, out=normal)
        normal *= normal
        y *= y
        square = _ONES @ y
        np.subtract(square, 1.0, out=squared)
        squared *= squared
        squared *= square
        squared *= 0.25
        if counts is not None:
            squared *= counts
        return cls(table)

    def over(self, variances: Array) -> Array:
        """(n,) squared distances over their expectations, for variances (3,) of the noise [recorded unit squared]."""
        return np.asarray(self.table[3] / (variances @ self.table[:3]))

    def variances(self, resistant: bool = False) -> Array | None:
        """(3,) of each channel's noise [recorded unit squared]; None where the readings do not tell.

        A regression of the squared distances on the squared normals, weighted by what they are expected to be.

        Args:
            resistant: take what exceeds its expectation for just that, as half of normal noise's squares do not: fewer
                than half of the readings can then spoil the answer (Huber, "Robust Statistics", 1981, section 5.2).
        """
        normal, squares = self.table[:3], self.table[3]
        expected = _ONES @ normal  # up to a factor
        mean = float(np.median(squares / expected)) / MEDIAN_SQUARE if resistant else squares.sum() / expected.sum()
        if not mean > 0.0:
            return None
        variances = mean * _ONES
        for _ in range(_ROUNDS):
            expected = variances @ normal
            ratio = squares / expected
            if resistant:
                ratio = np.minimum(ratio, 1.0) / _WITHIN
            share = variances[:, None] * normal / expected
            values, vectors = eigh(share @ share.T)
            if values[2] > _CONDITION * values[0]:
                return None
            before = variances
            variances = np.maximum(variances * (vectors / values).dot((share @ ratio).dot(vectors)), _QUIETEST * mean)
            least, _, most = sorted(variances.tolist())
            if (most < _ALIKE * least and not resistant) or np.abs(variances - before).max() < _SETTLED * least:
                break
        return np.asarray(variances)
