"""Ellipsoids, and the quadrics that they come from.

Products of matrices this small are written with ``dot``, which takes half the time of ``@``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimators._small import eigh, inverse
from estimators.ellipsoid.monomials import packed, quadratic_form, symmetric
from rig.arrays import Array


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The readings V with |whitening (V - center)| = 1; Camps (2), (7).

    Attributes:
        center: (3,) [recorded unit].
        whitening: (3, 3) symmetric, positive definite [1 / recorded unit]; diagonal for six parameters.
        gain: (3, 3) its inverse: A of V = A h + b with |h| = 1 [recorded unit].
    """

    center: Array
    whitening: Array
    gain: Array


@dataclass(frozen=True, eq=False)
class Quadric:
    """An ellipsoid as the zeros of y^T M y + 2 k^T y + c, with what its derivatives need.

    Attributes:
        ellipsoid: in readings.
        matrix: (3, 3) M. inner: (3, 3) inverse of it. shift: (3,) M^-1 k, minus the centre in y. level: k^T M^-1 k - c.
        roots, vectors: (3,), (3, 3): eigenvalues and eigenvectors of the ellipsoid's whitening.
    """

    ellipsoid: Ellipsoid
    matrix: Array
    inner: Array
    shift: Array
    level: float
    roots: Array
    vectors: Array

    @classmethod
    def of(cls, frame: Ellipsoid, constant: float, coefficients: Array) -> Quadric | None:
        """From coefficients of monomials; None where the quadric is no ellipsoid.

        Args:
            frame: y = frame.whitening (V - frame.center).
            constant: c.
            coefficients: (9,) of the other monomials in y; (6,) without mixed products.
        """
        where, share = _MATRIX[len(coefficients)]
        matrix = coefficients[where] * share
        half = 0.5 * coefficients[:3]
        if matrix[0, 0] < 0.0:  # the same quadric, of the other sign
            matrix, half, constant = -matrix, -half, -constant
        inner = inverse(matrix)
        if inner is None:
            return None
        shift = inner.dot(half)
        level = float(half.dot(shift)) - constant
        if not level > 0.0:  # NaN as well
            return None
        values, vectors = eigh(frame.whitening.dot(matrix).dot(frame.whitening))
        roots = np.sqrt(values / level)
        ellipsoid = Ellipsoid(
            frame.center - frame.gain.dot(shift), (vectors * roots).dot(vectors.T), (vectors / roots).dot(vectors.T)
        )
        return cls(ellipsoid, matrix, inner, shift, level, roots, vectors)

    def derivative(self, frame: Ellipsoid, parameters: int) -> Array:
        """(p, p) of gain (for a magnitude of one) and offset by the coefficients.

        E = W M W / level is the inverse square of the gain; a power of a symmetric matrix is differentiated in its
        eigenvectors (Daleckii and Krein).
        """
        pairs = parameters - 3
        unit = _UNITS[:pairs]  # (pairs, 3, 3) dM by its coefficients; dk is half of those of the linear terms
        turned = unit @ self.shift
        result = np.zeros((parameters, parameters))
        moved = frame.gain.dot(self.inner)
        result[pairs:, :3] = -0.5 * moved
        result[pairs:, 3:] = moved.dot(turned.T)
        sideways = frame.whitening.dot(self.vectors)
        inside = sideways.T @ unit @ sideways
        column = self.roots[:, None]
        inside /= (column * self.roots) * (column + self.roots) * -self.level
        gains = packed(self.vectors @ inside @ self.vectors.T)[:, :pairs].T
        # d level = 2 shift . dk - shift^T dM shift, and -d level / level times M is part of dE
        whole = gains.dot(quadratic_form(self.matrix)[:pairs]) / self.level
        result[:pairs, 3:] = gains + whole[:, None] * turned.dot(self.shift)
        result[:pairs, :3] = whole[:, None] * -self.shift
        return result


_HALF: Final = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
#: The coefficients that make up M, and how much of each.
_MATRIX: Final = {
    9: (np.array([[3, 6, 7], [6, 4, 8], [7, 8, 5]]), 0.5 + 0.5 * np.eye(3)),
    6: (np.array([[3, 0, 0], [0, 4, 0], [0, 0, 5]]), np.eye(3)),
}
_UNITS: Final = np.array([symmetric(row) for row in np.diag(_HALF)])
