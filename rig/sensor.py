"""A triaxial sensor: three axes, each with its sensitivity, offset and orientation; Renk (6), (11), (19)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array
from rig.directions import angles_from_direction, direction_from_angles
from rig.errors import RigError

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class TriaxialSensor:
    """V_k = S_k x_k + delta_k with x_k the component of the field along axis k.

    Attributes:
        sensitivity: S (3,) [V per field unit: V s^2/m or V/G], above zero.
        offset: delta (3,) [V].
        beta_deg, gamma_deg: (3,) [deg] the orientation of each axis in frame 6, Renk (6).
    """

    sensitivity: Triple
    offset: Triple
    beta_deg: Triple
    gamma_deg: Triple

    def __post_init__(self) -> None:
        for name in ("sensitivity", "offset", "beta_deg", "gamma_deg"):
            values = np.asarray(getattr(self, name), dtype=float)
            if values.shape != (3,) or not np.isfinite(values).all():
                raise RigError(f"{name}: found {getattr(self, name)}, expected three finite numbers")
            object.__setattr__(self, name, tuple(float(value) for value in values))
        if min(self.sensitivity) <= 0:
            raise RigError(
                f"sensitivity: found {min(self.sensitivity)}, expected numbers above zero: turn the axis round"
            )

    @classmethod
    def from_axes(cls, sensitivity: ArrayLike, offset: ArrayLike, axes: ArrayLike) -> Self:
        """From axes (3, 3), one unit vector a row, frame 6, instead of their angles."""
        beta, gamma = angles_from_direction(axes)
        return cls(
            sensitivity=tuple(np.asarray(sensitivity, dtype=float)),
            offset=tuple(np.asarray(offset, dtype=float)),
            beta_deg=tuple(beta),
            gamma_deg=tuple(gamma),
        )

    def turned(self) -> Self:
        """With every axis the other way round: what it reads of a field, this one read of the opposite field."""
        (b1, b2, b3), (g1, g2, g3) = self.beta_deg, np.remainder(np.add(self.gamma_deg, 180.0), 360.0).tolist()
        return replace(self, beta_deg=(-b1, -b2, -b3), gamma_deg=(g1, g2, g3))

    @cached_property
    def axes(self) -> Array:
        """(3, 3) unit vectors P_k as rows, frame 6; Renk (6)."""
        return direction_from_angles(self.beta_deg, self.gamma_deg)

    def components(self, R_base_tool: Array, field: Array) -> Array:
        """The field's component along each axis: P_k . R^T f; Renk (10), (18).

        Args:
            R_base_tool: (n, 3, 3) orientation of frame 6.
            field: (3,) or (n, 3) [field unit], base frame.

        Returns:
            (n, 3) [field unit].
        """
        if field.ndim == 1:  # one product with the matrices as they lie in memory
            return np.asarray(R_base_tool.reshape(-1, 9) @ np.multiply.outer(field, self.axes.T).reshape(9, 3))
        return np.asarray(np.einsum("nij,ni->nj", R_base_tool, field) @ self.axes.T)

    def volts(self, components: Array) -> Array:
        """Readings (n, 3) [V] of components (n, 3) [field unit]; Renk (9), (17)."""
        return np.asarray(np.einsum("nk,k->nk", components, np.asarray(self.sensitivity)) + np.asarray(self.offset))
