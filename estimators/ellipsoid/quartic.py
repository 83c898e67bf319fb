"""The ellipsoid from sums that need no ellipsoid to be taken: products of monomials about a fixed point.

``Moments`` weigh each reading by the noise that a preliminary ellipsoid expects of it, so they can be taken only once
that is known. Where all readings are weighed alike, the sums of all monomials up to degree four follow any affine map
of the readings exactly. They are taken as readings come, in constant memory, and serve every later ellipsoid: the
recursive form of the estimate. Equal weights are those of maximum likelihood where the noise is the same in every
direction of the field's sphere; where channels differ, the estimate is as consistent, and its variance larger by the
square of their relative difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators._rows import working_rows
from estimators.ellipsoid.algebraic import from_products
from estimators.ellipsoid.estimate import Estimate
from estimators.ellipsoid.fit import EllipsoidFit, Parameters, fit_of
from estimators.ellipsoid.likelihood import solve
from estimators.ellipsoid.moments import Moments
from estimators.ellipsoid.monomials import PAIRS, TERMS, multiply_out, packed
from estimators.ellipsoid.rows import Dropped
from estimators.ellipsoid.shape import Ellipsoid
from rig.errors import RefusedFit, RigError
from rig.threads import one_blas_thread

Array = NDArray[np.float64]

_BLOCK: Final = 4096
_STEP: Final = 0.05
_STEPS: Final = 20


@dataclass(frozen=True, eq=False)
class QuarticSums:
    """What n samples say about any ellipsoid. Sums about one origin add and subtract.

    Rounding: the readings may lie anywhere about the origin; it is best one of them.

    Attributes:
        origin: (3,) [recorded unit].
        count: n.
        gram: (10, 10) sum of z z^T, z the monomials of V - origin in the order of ``monomials.EXPONENTS`` [recorded
            unit to the power of their degrees].
    """

    origin: Array
    count: int
    gram: Array

    @classmethod
    def of(cls, readings: Array, origin: Array) -> Self:
        """Sum over readings (n, 3) about an origin (3,) [recorded unit]."""
        count = len(readings)
        work = working_rows(TERMS, min(_BLOCK, max(count, 1)))
        work[0] = 1.0
        gram = np.zeros((TERMS, TERMS))
        with one_blas_thread():
            for start in range(0, count, _BLOCK):
                rows = work[:, : min(_BLOCK, count - start)]
                np.subtract(readings[start : start + _BLOCK].T, origin[:, None], out=rows[1:4])
                multiply_out(rows[1:])
                gram += rows @ rows.T
        return cls(origin, count, gram)

    def __add__(self, other: QuarticSums) -> Self:
        """The sums over both sets of samples.

        Raises:
            RigError: their origins differ.
        """
        if not np.array_equal(self.origin, other.origin):
            raise RigError("quartic sums: found two origins, expected sums about the same one")
        return type(self)(self.origin, self.count + other.count, self.gram + other.gram)

    @property
    def mean(self) -> Array:
        """(3,) of the readings [recorded unit]."""
        return np.asarray(self.origin + self.gram[0, 1:4] / max(self.count, 1))

    @property
    def spread(self) -> float:
        """Root mean square distance from the mean [recorded unit]."""
        first = self.gram[0, 1:4] / max(self.count, 1)
        square = float(self.gram[0, 4:7].sum()) / max(self.count, 1) - float(first @ first)
        return float(np.sqrt(max(square, 0.0)))

    def within(self, frame: Ellipsoid) -> Array:
        """(10, 10) the same sums of the monomials in y = frame.whitening (V - frame.center)."""
        change = _monomials_of(frame.whitening, frame.whitening @ (self.origin - frame.center))
        return np.asarray(change @ self.gram @ change.T)

    def moments(self, frame: Ellipsoid, variances: Array) -> Moments:
        """As ``Moments.of``, with equal weights.

        Args:
            frame: preliminary ellipsoid.
            variances: (3,) of a sample's noise, up to a common factor [recorded unit squared].
        """
        noise = (frame.whitening * variances) @ frame.whitening
        weight = 0.75 / float(noise.trace())  # 1 / (4 nu), nu the mean over directions
        gram = weight * self.within(frame)
        second = weight * self.count
        return Moments(frame, packed(noise), self.count, gram, gram[0], second, np.zeros(TERMS), 0.0, 0.0)


def _monomials_of(matrix: Array, shift: Array) -> Array:
    """(10, 10) T with z(matrix x + shift) = T z(x)."""
    result = np.zeros((TERMS, TERMS))
    result[0, 0] = 1.0
    result[1:4, 0], result[1:4, 1:4] = shift, matrix
    for row, (i, j) in enumerate(PAIRS, 4):
        result[row, 0] = shift[i] * shift[j]
        result[row, 1:4] = shift[i] * matrix[j] + shift[j] * matrix[i]
        for column, (k, m) in enumerate(PAIRS, 4):
            product = matrix[i, k] * matrix[j, m]
            result[row, column] = product if k == m else product + matrix[i, m] * matrix[j, k]
    return result


def fit_sums(
    sums: QuarticSums,
    sample: Array,
    reference_magnitude: float = 1.0,
    *,
    parameters: Parameters = 9,
    noise: ArrayLike | None = None,
    name: str = "sensor",
) -> EllipsoidFit:
    """Calibrate a triaxial sensor from the sums; the arguments and the result are those of ``fit_ellipsoid``.

    Args:
        sums: of the readings.
        sample: (m, 3) some of them, that show in which directions they lie [recorded unit].
        reference_magnitude: |h| [field unit].
        parameters: 6 or 9.
        noise: (3,) standard deviation of a sample [recorded unit]; None: from the residuals.
        name: of the sensor, for messages.

    Raises:
        RefusedFit: there is no ellipsoid; where there is one that is told badly, ``EllipsoidFit.problem`` says so.
    """
    if sums.count <= parameters:
        raise RefusedFit(f"{name}: found {sums.count} readings, expected more than the {parameters} parameters")
    variances = np.ones(3) if noise is None else np.square(np.asarray(noise, dtype=float))
    with one_blas_thread(), np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = _estimate(sums, variances, parameters, noise is not None)
        if found is None:
            raise RefusedFit(f"{name}: the readings lie on no ellipsoid yet, expected the field from more directions")
        return fit_of(found, sample, float(reference_magnitude), parameters, noise is not None, Dropped())


def _estimate(sums: QuarticSums, variances: Array, parameters: int, known: bool) -> Estimate | None:
    spread = sums.spread
    if not spread > 0.0:
        return None
    about = Ellipsoid(sums.mean, np.eye(3) / spread, np.eye(3) * spread)
    gram = sums.within(about)
    frame = from_products(gram, gram[0], about, variances, parameters)
    for _ in range(_STEPS):
        if frame is None:
            return None
        moments = sums.moments(frame, variances)
        optimum = solve(moments, parameters, known)
        if optimum is None:
            return None
        if optimum.step < _STEP:
            return Estimate(optimum, moments, variances)
        frame = optimum.ellipsoid
    return None
