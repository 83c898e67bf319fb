"""The one pass over the data: weighted sums of products of monomials, after which its length no longer matters.

The readings are mapped to the unit sphere by a preliminary ellipsoid, y = W (V - b). There the quadric's residual
Q = |y|^2 - 1 has variance 4 y^T N y / count with N the noise of y, and its inverse is the weight of the
maximum-likelihood estimate (Sampson's). It is taken in the form |y|^2 / (4 y^T N y), which depends on the direction of
y only, hence not on the radial noise that Q consists of. As the weights hardly differ over the sphere, a preliminary
ellipsoid good to a few per cent is as good as the final one.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from estimators._rows import working_rows
from estimators.ellipsoid.monomials import EXPONENTS, FLAT, PAIRS, TERMS, multiply_out, quadratic_form
from estimators.ellipsoid.shape import Ellipsoid
from rig.arrays import Array, Rows
from rig.errors import RigError

#: Samples at a time: 16 rows of 8,192 doubles are about a core's second-level cache.
BLOCK: Final = 8192
#: The noise of y may differ by this share between directions before the weights' own noise is looked at; its effect is
#: the square of this share, of the bias that it adds to.
_ISOTROPIC: Final = 0.1


@dataclass(frozen=True, eq=False)
class Moments:
    """What n samples say about the ellipsoid near ``frame``. Sums over disjoint samples with one frame add.

    Attributes:
        frame: the preliminary ellipsoid.
        noise: (6,) covariance N of the noise of y for a count of one, as ``monomials.packed``.
        rows: n.
        gram: (10, 10) sum of w z z^T, z the monomials in y and w the weights.
        first: (10,) sum of (w / count) z. second: sum of w / count^2.
        drift: (10,) the expectation, by the noise of the weights, of the sum of w z Q for N.
        largest: squared residual at the preliminary ellipsoid over its variance, of the reading where it is largest.
        fourth: sum of the squares of these.
    """

    frame: Ellipsoid
    noise: Array
    rows: int
    gram: Array
    first: Array
    second: float
    drift: Array
    largest: float
    fourth: float

    @classmethod
    def of(cls, readings: Array, frame: Ellipsoid, variances: Array, counts: Array | None = None) -> Self:
        """Sum over readings.

        Args:
            readings: (n, 3) [recorded unit].
            frame: preliminary ellipsoid.
            variances: (3,) of a sample's noise, up to a common factor [recorded unit squared].
            counts: (n,) how many samples each reading is the mean of.
        """
        n = len(readings)
        noise = (frame.whitening * variances).dot(frame.whitening)
        mean = float(noise.trace()) / 3.0
        # The largest difference of eigenvalues is at most the root of twice the sum of their squared deviations.
        wobbly = 2.0 * (float(np.vdot(noise, noise)) - 3.0 * mean**2) > (_ISOTROPIC * mean) ** 2
        # |y|^2, its variance, and what of it the noise of the weights needs, as forms in the quadratic monomials
        to_forms = np.empty((3 if wobbly else 2, 6))
        to_forms[0], to_forms[1] = _TRACE, quadratic_form(4.0 * noise)
        if wobbly:
            to_forms[2] = quadratic_form(16.0 * noise.dot(noise))
        to_sphere = np.empty((3, 4))
        to_sphere[:, :3], to_sphere[:, 3] = frame.whitening, -frame.whitening.dot(frame.center)
        size = -(-n // max(-(-n // BLOCK), 1))
        used = 6 if wobbly else 5
        sums, first = np.zeros((6, TERMS)), np.zeros(TERMS)
        second = largest = fourth = 0.0
        for start in range(0, n, max(size, 1)):
            stop = min(start + size, n)
            table = _work_table()[:, : stop - start]
            rows, weighted = table[_ROWS], table[_WEIGHTED]
            table[_RAW] = readings[start:stop].T
            np.matmul(to_sphere, table[_RAW_AND_ONE], out=rows[1:4])
            multiply_out(rows[1:])
            np.matmul(to_forms, rows[4:], out=weighted[-3:][: len(to_forms)])
            square, spread, drifting = weighted[-3:]
            weight = np.divide(square, spread, out=weighted[0])
            if counts is not None:
                first += rows @ weight
                second += float((weight / counts[start:stop]).sum())
            if wobbly:
                drifting /= spread
                drifting *= weight
                np.subtract(1.0, drifting, out=drifting)
            if counts is not None:
                weight *= counts[start:stop]
            square -= 1.0
            square *= square
            square *= weight
            largest = max(largest, float(square.max()))
            fourth += float(square @ square)
            np.multiply(rows[3:7], weight, out=weighted[1:5])
            sums[:used] += weighted[:used] @ rows.T
        gram = sums.take(_WHERE)
        if counts is None:
            first, second = gram[0], float(gram[0, 0])
        return cls(frame, noise.take(FLAT), n, gram, first, second, sums[5], largest, fourth)

    def __add__(self, other: Moments) -> Moments:
        """The moments of both sets of samples.

        Raises:
            RigError: their frames differ.
        """
        if other.frame is not self.frame:
            raise RigError("moments: found two preliminary ellipsoids, expected sums with the same one")
        return Moments(
            self.frame,
            self.noise,
            self.rows + other.rows,
            self.gram + other.gram,
            self.first + other.first,
            self.second + other.second,
            self.drift + other.drift,
            max(self.largest, other.largest),
            self.fourth + other.fourth,
        )


def _work_table() -> Array:
    """(16, BLOCK) to work in, of a thread's own and overwritten by its next call; see ``_ROWS``.

    New ones would cost as much as the sums over a small recording: their pages have to be mapped and cleared.
    """
    table: Array | None = getattr(_LOCAL, "table", None)
    if table is None:
        table = _LOCAL.table = working_rows(16, BLOCK)
        table[_ROWS.start] = 1.0
    return table


def _where() -> Rows:
    """(10, 10): the place of the sum of w z_i z_j among w (1, y3, y1^2, y2^2, y3^2) times all monomials.

    These hold all of the products of two monomials, at half the arithmetic.
    """
    left = (EXPONENTS[0], *EXPONENTS[3:7])
    places = {}
    for i, a in enumerate(left):
        for j, b in enumerate(EXPONENTS):
            places[(a[0] + b[0], a[1] + b[1], a[2] + b[2])] = TERMS * i + j
    return np.array([[places[(a[0] + b[0], a[1] + b[1], a[2] + b[2])] for b in EXPONENTS] for a in EXPONENTS])


_LOCAL: Final = threading.local()
#: Rows of the work table: weights times (1, y3, y1^2, y2^2, y3^2), and those of the drift; then the monomials, of which
#: the first is one. In the place of the last three weighted rows are at first the readings, then the forms.
_WEIGHTED: Final = slice(0, 6)
_RAW: Final = slice(3, 6)
_RAW_AND_ONE: Final = slice(3, 7)
_ROWS: Final = slice(6, 16)
_TRACE: Final = np.array([float(i == j) for i, j in PAIRS])
_WHERE: Final = _where()
