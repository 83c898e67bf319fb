"""What a set of directions can tell about a sensor whose attitude is not known.

Of each reading only the length of the field counts: the error of |M (V - b)| is the noise along the field. With the
field M (V - b) = H u, a small symmetric change E of M, M -> (I + E) M, and a shift c = M db / H of the centre, it
changes by

    r / H = u . E u - u . c,

which is linear in six (or, without non-orthogonality, three) entries of E and three of c; so the Fisher information
follows from the directions u and the noise alone: no reading is needed, and it serves plans as well. It is that of
equations (2) and (7) of Camps et al. with the errors weighted by their variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.known_angle.identifiability import Told, is_open
from rig.arrays import Array
from rig.errors import RigError

Parameters = Literal[6, 9]

#: In the order of the information's rows: relative change of a sensitivity, the angle between two axes [rad], and an
#: offset as a share of the field.
NAMES: Final[dict[int, tuple[str, ...]]] = {
    6: ("sensitivity1", "sensitivity2", "sensitivity3", "offset1", "offset2", "offset3"),
    9: (
        *("sensitivity1", "sensitivity2", "sensitivity3", "angle1-2", "angle1-3", "angle2-3"),
        *("offset1", "offset2", "offset3"),
    ),
}


@dataclass(frozen=True, eq=False)
class AttitudeFreeInformation:
    """The Fisher information of six or nine parameters, in the units of ``NAMES``.

    Attributes:
        names: (p,) of the parameters.
        matrix: (p, p).
        readings: how many it comes from.
        covariance: (p, p) the Cramer-Rao bound without the null directions.
        null: (p, d) orthonormal directions that are not told.
        condition: largest over smallest eigenvalue of the matrix scaled to a unit diagonal; infinite where d > 0.
    """

    names: tuple[str, ...]
    matrix: Array
    readings: float
    covariance: Array
    null: Array
    condition: float

    @classmethod
    def of(
        cls,
        directions: ArrayLike,
        noise: ArrayLike,
        counts: ArrayLike | None = None,
        parameters: Parameters = 9,
    ) -> AttitudeFreeInformation:
        """The information of readings in some directions.

        Args:
            directions: (n, 3) unit vectors of the field in the sensor's frame.
            noise: standard deviation of a reading as a share of the field, sigma / (S |f|): one number, or (3,).
            counts: (n,) readings in each direction; None: one.
            parameters: nine, or six where axes are taken to be at right angles.

        Raises:
            RigError: another number of parameters, or noise that is not positive.
        """
        rows, deviation = _rows(directions, noise, parameters)
        weights = np.divide(1.0, np.square(deviation), where=deviation > 0.0, out=np.zeros_like(deviation))
        number = float(len(rows))
        if counts is not None:
            weights = weights * np.asarray(counts, dtype=float)
            number = float(np.sum(counts))
        matrix = rows.T @ (weights[:, None] * rows)
        told = Told.of(matrix)
        return cls(NAMES[parameters], matrix, number, told.covariance, told.null, told.condition)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The parameters that these directions leave open."""
        return tuple(name for name, lost in zip(self.names, is_open(self.null), strict=True) if lost)

    @property
    def std(self) -> dict[str, float]:
        """The predicted standard deviation of each parameter; infinite where it is left open."""
        open_ones = self.undetermined
        values = np.sqrt(self.covariance.diagonal())
        return {
            name: np.inf if name in open_ones else float(value) for name, value in zip(self.names, values, strict=True)
        }

    def gain(self, candidates: ArrayLike, noise: ArrayLike, importance: ArrayLike, counts: float = 1.0) -> Array:
        """How much readings in new directions would lower the weighted sum of variances.

        Where parameters are still open, the gain is that on top of a standard deviation of one for each, which is worse
        than no calibration at all.

        Args:
            candidates: (m, 3) unit vectors.
            noise: as of ``of``.
            importance: (p,) weights of the variances.
            counts: readings in the new direction.

        Returns:
            (m,).
        """
        rows, deviation = _rows(candidates, noise, 9 if len(self.names) == 9 else 6)
        covariance = np.linalg.inv(self.matrix + np.eye(len(self.names)))
        moved = rows @ covariance
        new = np.square(deviation) / counts + np.einsum("ij,ij->i", moved, rows)
        return np.asarray((np.square(moved) @ np.asarray(importance, dtype=float)) / new)


def design_rows(directions: ArrayLike, parameters: int) -> Array:
    """Derivatives (n, p) of r / H by the parameters in the units of ``NAMES``.

    E_ij shows twice, in u_i u_j and in u_j u_i; and axes at an angle of 90 degrees less a make E_ij = -a / 2.

    Args:
        directions: (n, 3) unit vectors.
        parameters: 6 or 9.

    Raises:
        RigError: another number of parameters.
    """
    if parameters not in NAMES:
        raise RigError(f"parameters: found {parameters}, expected 6 or 9")
    u = np.asarray(directions, dtype=float)
    mixed = [u[:, [0]] * u[:, [1]], u[:, [0]] * u[:, [2]], u[:, [1]] * u[:, [2]]] if parameters == 9 else []
    return np.hstack([np.square(u), *mixed, -u])


def _rows(directions: ArrayLike, noise: ArrayLike, parameters: int) -> tuple[Array, Array]:
    """``design_rows`` and the standard deviation (n,) of r / H."""
    sigma = np.broadcast_to(np.asarray(noise, dtype=float), 3)
    if not (np.isfinite(sigma).all() and (sigma > 0.0).all()):
        raise RigError(f"noise: found {sigma.tolist()}, expected positive shares of the field")
    rows = design_rows(directions, parameters)
    return rows, np.sqrt(np.square(np.asarray(directions, dtype=float)) @ np.square(sigma))
