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
from numpy.typing import NDArray

from estimators.ellipsoid._small import eigh
from estimators.ellipsoid.monomials import EXPONENTS, FLAT, PAIRS, TERMS, fill, quadratic_form
from estimators.ellipsoid.shape import Ellipsoid
from rig.errors import RigError

Array = NDArray[np.float64]

#: Samples at a time: two tables of 9 and 8 rows of 8,192 doubles are about a core's second-level cache.
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
        noise = (frame.whitening * variances) @ frame.whitening
        values = eigh(noise)[0]
        wobbly = bool(values[2] - values[0] > _ISOTROPIC * values[2])
        form = quadratic_form(4.0 * noise)
        both = np.array([_TRACE, form])
        bent = quadratic_form(16.0 * noise @ noise) if wobbly else form
        origin = (frame.whitening @ frame.center)[:, None]
        size = -(-n // max(-(-n // BLOCK), 1))
        sums, first, drift = np.zeros(_SUMS), np.zeros(TERMS), np.zeros(TERMS)
        second = largest = fourth = 0.0
        for start in range(0, n, max(size, 1)):
            stop = min(start + size, n)
            rows, weighted = work_tables(stop - start)
            fill(readings[start:stop], frame.whitening, origin, rows)
            square, spread = both @ rows[3:]
            weight = square / spread
            if wobbly:
                drift += _with_constant(rows, 1.0 - weight * (bent @ rows[3:]) / spread)
            if counts is not None:
                first += _with_constant(rows, weight)
                second += float((weight / counts[start:stop]).sum())
                weight *= counts[start:stop]
            sums += products(rows, weight, weighted)
            square -= 1.0
            square *= square
            square *= weight
            largest = max(largest, float(square.max()))
            fourth += float(square @ square)
        gram = sums[WHERE]
        if counts is None:
            first, second = gram[0], float(gram[0, 0])
        return cls(frame, noise.take(FLAT), n, gram, first, second, drift, largest, fourth)

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


def products(rows: Array, weight: Array, weighted: Array) -> Array:
    """The 35 sums of w times monomials of degree four and less, some of them twice, in one product of 8 by 8 rows.

    Of the 10 x 10 products of monomials these are enough: (1, y1, quadratic) by (y2, y3, quadratic), and the sums of w
    and w y1.

    Args:
        rows: (9, n) as of ``monomials.fill``. weight: (n,).
        weighted: (8, n) to work in.

    Returns:
        (66,); ``WHERE`` finds the products of two monomials in it.
    """
    weighted[0] = weight
    np.multiply(rows[0], weight, out=weighted[1])
    np.multiply(rows[3:], weight, out=weighted[2:])
    sums = np.empty(_SUMS)
    np.matmul(weighted, rows[1:].T, out=sums[2:].reshape(8, 8))
    sums[0] = weight.sum()
    sums[1] = rows[0] @ weight
    return sums


def work_tables(size: int) -> tuple[Array, Array]:
    """(9, size), (8, size) to work in, of a thread's own and overwritten by its next call.

    New ones would cost as much as the sums over a small recording: their pages have to be mapped and cleared.
    """
    tables: Array | None = getattr(_LOCAL, "tables", None)
    if tables is None:
        tables = _LOCAL.tables = np.empty(17 * BLOCK)
    elif size > BLOCK:
        tables = np.empty(17 * size)
    return tables[: 9 * size].reshape(9, size), tables[9 * size : 17 * size].reshape(8, size)


def _with_constant(rows: Array, weight: Array) -> Array:
    """(10,) the sums of all monomials times a weight (n,)."""
    return np.concatenate([[weight.sum()], rows @ weight])


def _where() -> NDArray[np.intp]:
    """(10, 10): the place of the sum of z_i z_j in ``products``."""
    left = (EXPONENTS[0], EXPONENTS[1], *EXPONENTS[4:])
    right = EXPONENTS[2:]
    places = {EXPONENTS[0]: 0, EXPONENTS[1]: 1}
    for i, a in enumerate(left):
        for j, b in enumerate(right):
            places[(a[0] + b[0], a[1] + b[1], a[2] + b[2])] = 2 + len(right) * i + j
    return np.array([[places[(a[0] + b[0], a[1] + b[1], a[2] + b[2])] for b in EXPONENTS] for a in EXPONENTS])


_LOCAL: Final = threading.local()
_SUMS: Final = 66
_TRACE: Final = np.array([float(i == j) for i, j in PAIRS])
WHERE: Final = _where()
