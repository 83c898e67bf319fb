"""What a set of poses can tell: Fisher information, Cramer-Rao bound, and what lies in its null space.

All of it follows from the Gram matrix of [vec R, 1], the parameters and the noise; no reading is needed, so it serves
estimates and plans alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimators._small import eigh
from estimators.known_angle.model import PARAMETERS_OF, Method, SensorParameters, sizes_by_name
from rig.arrays import Array, Mask

#: Eigenvalues of the scaled information (unit diagonal) below this are null. The Gram matrix is good to some 1e-15 of
#: itself, so that an eigenvalue of 1e-11 still has four digits; orientations repeated with rounded encoders or poses
#: written with seven digits make eigenvalues of 1e-14.
NULL_EIGENVALUE = 1e-11
#: A parameter takes part in a null direction when its share of the unit null vector exceeds this.
NULL_SHARE = 1e-3


@dataclass(frozen=True)
class Told:
    """What a Fisher information tells, scaled to a unit diagonal.

    Attributes:
        null: (p, d) orthonormal null directions of the scaled matrix.
        covariance: (p, p) the Cramer-Rao bound: inverse information, without the null directions.
        condition: largest over smallest eigenvalue; infinite where d > 0.
    """

    null: Array
    covariance: Array
    condition: float

    @classmethod
    def of(cls, information: Array, scale: Array | None = None) -> Told:
        """Of a matrix (p, p); ``scale`` (p,) multiplies both sides instead of ``unit_scale``."""
        scale = unit_scale(information) if scale is None else scale
        eigenvalues, vectors = eigh(scale[:, None] * information * scale)
        told = eigenvalues > NULL_EIGENVALUE
        spread = scale[:, None] * vectors[:, told]
        condition = float(eigenvalues[-1] / eigenvalues[0]) if told.all() else np.inf
        return cls(vectors[:, ~told], (spread / eigenvalues[told]) @ spread.T, condition)


def unit_scale(information: Array) -> Array:
    """(.., p) that scales information matrices (.., p, p) to a unit diagonal."""
    diagonal = information.diagonal(axis1=-2, axis2=-1)
    return np.asarray(1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)))


def is_open(null: Array) -> Mask:
    """(p,) which parameters take part in null directions (p, d)."""
    return np.asarray(np.sqrt((null * null).sum(axis=1)) > NULL_SHARE)


@dataclass(frozen=True)
class Information:
    """The Fisher information of one sensor's parameters, in the coordinates of ``SensorParameters.jacobian``.

    Attributes:
        method: which model.
        matrix: (p, p) dimensionless parameters, so dimensionless.
        per_channel: (3, p, p) the channels' shares, which add up to it.
        null: (p, d) orthonormal null directions of the matrix scaled to a unit diagonal.
        covariance: (p, p) the Cramer-Rao bound: inverse information, without its null directions.
        condition: largest over smallest eigenvalue of the scaled matrix; infinite where d > 0.
    """

    method: Method
    matrix: Array
    per_channel: Array
    null: Array
    covariance: Array
    condition: float

    @classmethod
    def of(
        cls, gram: Array, parameters: SensorParameters, noise: ArrayLike, method: Method = "simultaneous"
    ) -> Information:
        """The information of samples with white Gaussian noise.

        Args:
            gram: (10, 10) of [vec R, 1].
            parameters: where it is taken; no sensitivity may be zero.
            noise: (3,) standard deviation of a sample [recorded unit].
            method: the model.
        """
        jacobian = parameters.jacobian(method)
        return cls._of(method, jacobian.swapaxes(1, 2) @ (gram @ jacobian), noise)

    @classmethod
    def _of(cls, method: Method, unweighted: Array, noise: ArrayLike) -> Information:
        weights = 1.0 / np.square(np.broadcast_to(np.asarray(noise, dtype=float), 3))
        per_channel = weights[:, None, None] * unweighted
        matrix = per_channel.sum(axis=0)
        told = Told.of(matrix)
        return cls(method, matrix, per_channel, told.null, told.covariance, told.condition)

    def with_noise(self, noise: ArrayLike, assumed: ArrayLike) -> Information:
        """The same with other noise (3,) than the ``assumed`` (3,) that it was made with."""
        square = np.square(np.broadcast_to(np.asarray(assumed, dtype=float), 3))
        return Information._of(self.method, square[:, None, None] * self.per_channel, noise)

    def leverage(self) -> Array:
        """(3,) parameters that each channel's readings have paid for; they add up to p.

        With the covariance C, channel k's part of the trace of the hat matrix is tr(C F_k).
        """
        return np.asarray((self.covariance * self.per_channel).sum(axis=(1, 2)))

    def sandwich(self, noise: ArrayLike, assumed: ArrayLike) -> Array:
        """(p, p) covariance of estimates whose weights assumed other noise than there is.

        Args:
            noise: (3,) the real standard deviations.
            assumed: (3,) those that ``self`` was made with.
        """
        ratio = np.square(np.asarray(noise, dtype=float) / np.asarray(assumed, dtype=float))
        return np.asarray(self.covariance @ np.einsum("k,kij->ij", ratio, self.per_channel) @ self.covariance)

    def undetermined(self) -> tuple[str, ...]:
        """The vectors and numbers that the poses leave open: ``sensitivity1``, ``offset1``, ``axis1``, ..,
        ``field``."""
        return self._beyond((self.null * self.null).sum(axis=1), NULL_SHARE)

    def uncertain(self, covariance: Array, limit: float) -> tuple[str, ...]:
        """Those whose standard deviation by a covariance (p, p) exceeds ``limit`` (share of S_k, of S_k |f|, rad)."""
        return self._beyond(covariance.diagonal(), limit)

    def _beyond(self, squares: Array, limit: float) -> tuple[str, ...]:
        return tuple(name for name, size in sizes_by_name(squares, self.method).items() if size > limit)


def bound(gram: Array, parameters: SensorParameters, noise: ArrayLike, method: Method = "simultaneous") -> Array:
    """The Cramer-Rao bound (p, p) in the coordinates of ``SensorParameters.jacobian``; NaN where nothing is told."""
    information = Information.of(gram, parameters, noise, method)
    covariance = information.covariance.copy()
    lost = is_open(information.null)
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    assert covariance.shape == (PARAMETERS_OF[method],) * 2
    return covariance
