"""The known-angle model of one sensor: its parameters, their linear form and their tangent space.

Renk (13), (19): V_k = S_k |f| f^T R P_k + delta_k, R = R_base_tool, f the field's unit direction (base frame) and P_k
the axis's (frame 6). Unit vectors have no singular direction, their angles do; so derivatives are taken in tangent
coordinates: two small rotations (rad) of each unit vector, along ``rig.directions.tangent_basis``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array
from rig.directions import angles_from_direction, elevation_azimuth_basis, tangent_basis
from rig.errors import check_name
from rig.sensor import TriaxialSensor

Method = Literal["simultaneous", "separate"]
METHODS: Final[tuple[Method, ...]] = ("simultaneous", "separate")

Weighting = Literal["likelihood", "equal"]
WEIGHTINGS: Final[tuple[Weighting, ...]] = ("likelihood", "equal")

#: Parameters of a sensor, Renk (15), (21) and three times (14), (20).
PARAMETERS_OF: Final[dict[Method, int]] = {"simultaneous": 14, "separate": 18}
#: Parameters one minimisation looks for: a sensor's, or a channel's.
PARAMETERS_AT_ONCE: Final[dict[Method, int]] = {"simultaneous": 14, "separate": 6}


def check_options(method: str, weighting: str) -> None:
    """Raises: RigError: one of them is unknown."""
    check_name("method", method, METHODS)
    check_name("weighting", weighting, WEIGHTINGS)


@dataclass(frozen=True, eq=False)
class SensorParameters:
    """A point of the parameter space of one sensor; of many sensors, with one more axis before those said here.

    Attributes:
        reference_magnitude: |f| [m/s^2, field unit].
        sensitivity: (3,) S_k [recorded unit per field unit].
        offset: (3,) delta_k [recorded unit].
        axes: (3, 3) unit vectors P_k as rows, frame 6.
        fields: (3, 3) the unit direction of the field as each channel has it, as rows, base frame; equal rows in the
            simultaneous model.
    """

    reference_magnitude: float
    sensitivity: Array
    offset: Array
    axes: Array
    fields: Array

    @classmethod
    def of(cls, sensor: TriaxialSensor, field: ArrayLike) -> Self:
        """The parameters of a simulated sensor in a uniform field (3,) [m/s^2, field unit], base frame."""
        vector = np.asarray(field, dtype=float)
        magnitude = float(np.linalg.norm(vector))
        return cls(
            magnitude,
            np.asarray(sensor.sensitivity, dtype=float),
            np.asarray(sensor.offset, dtype=float),
            sensor.axes,
            np.tile(vector / magnitude, (3, 1)),
        )

    def values(self, method: Method) -> Array:
        """(p,) as a calibration has them, by ``parameter_names``: S, delta [recorded unit], angles [deg]."""
        result = np.empty((*self.sensitivity.shape[:-1], PARAMETERS_OF[method]))
        axes, fields = (np.stack(angles_from_direction(vectors), axis=-1) for vectors in (self.axes, self.fields))
        for k, start, of_field in columns_of_channels(method):
            result[..., start] = self.sensitivity[..., k]
            result[..., start + 1] = self.offset[..., k]
            result[..., start + 2 : start + 4] = axes[..., k, :]
            result[..., of_field] = fields[..., k, :]
        return result

    @property
    def length(self) -> Array:
        """(3,) S_k |f| [recorded unit]."""
        return self.reference_magnitude * self.sensitivity

    @property
    def scaled_axes(self) -> Array:
        """(3, 3) rows m_k = S_k |f| P_k [recorded unit]."""
        return self.length[..., None] * self.axes

    @property
    def coefficients(self) -> Array:
        """(10, 3) theta_k = [vec(f m_k^T), delta_k], so that readings are [vec R, 1] . theta_k [recorded unit]."""
        return np.concatenate(
            [self._turned(self.fields, self.scaled_axes).swapaxes(-1, -2), self.offset[..., None, :]], -2
        )

    @property
    def gain(self) -> Array:
        """(3, 3) rows S_k P_k: readings - offset = gain @ (field in frame 6)."""
        return self.sensitivity[:, None] * self.axes

    @property
    def by_channel(self) -> Array:
        """(3, 10, 6) of theta_k by channel k's own parameters, as of ``jacobian``: S_k, delta_k, P_k, f_k."""
        axis_basis, field_basis = self.bases
        m, length = self.scaled_axes, self.length
        result = np.zeros((*length.shape, 10, 6))
        result[..., :9, 0], result[..., 9, 1] = self._turned(self.fields, m), length
        for a in range(2):
            result[..., :9, 2 + a] = self._turned(self.fields, length[..., None] * axis_basis[..., a, :])
            result[..., :9, 4 + a] = self._turned(field_basis[..., a, :], m)
        return result

    def along_angles(self, method: Method) -> Array:
        """(p, p) from the coordinates of ``jacobian`` to those along growing elevation and azimuth of each unit
        vector."""
        bases = [
            elevation_azimuth_basis(vectors) @ basis.swapaxes(-1, -2)
            for vectors, basis in zip((self.axes, self.fields), self.bases, strict=True)
        ]
        turn = np.eye(PARAMETERS_OF[method])
        for k, start, of_field in columns_of_channels(method):
            turn[start + 2 : start + 4, start + 2 : start + 4], turn[of_field, of_field] = bases[0][k], bases[1][k]
        return turn

    def jacobian(self, method: Method) -> Array:
        """Derivative of theta_k by the parameters in tangent coordinates.

        The parameters are taken in their natural sizes, S_k |f| and the lengths of unit vectors, so all columns are in
        the recorded unit: relative change of S_k, change of delta_k over S_k |f|, two small rotations of P_k (rad) for
        k = 1, 2, 3, then two of f (simultaneous), or the same with f_k's two after each P_k's (separate).

        Returns:
            (3, 10, p), p = 14 or 18 [recorded unit].
        """
        own = self.by_channel
        result = np.zeros((3, 10, PARAMETERS_OF[method]))
        for k, start, of_field in columns_of_channels(method):
            result[k, :, start : start + 4], result[k, :, of_field] = own[k, :, :4], own[k, :, 4:]
        return result

    @staticmethod
    def _turned(fields: Array, axes: Array) -> Array:
        """(3, 9) vec(f m^T) of rows (3, 3) each."""
        return (fields[..., :, None] * axes[..., None, :]).reshape(*fields.shape[:-1], 9)

    @cached_property
    def bases(self) -> tuple[Array, Array]:
        """The tangent bases (3, 2, 3) of the axes and of the fields."""
        both = tangent_basis(np.concatenate([self.axes, self.fields], axis=-2))
        return both[..., :3, :, :], both[..., 3:, :, :]

    @cached_property
    def scales(self) -> Array:
        """(3, 2) what one unit of the first two parameters of ``jacobian`` is: S_k, and S_k |f| for delta_k."""
        return np.stack([self.sensitivity, self.length], axis=1)


def columns_of_channels(method: Method) -> Iterator[tuple[int, int, slice]]:
    """For each channel k: k, the column of its S_k (delta_k and P_k follow), and the columns of its field."""
    for k in range(3):
        if method == "simultaneous":
            yield k, 4 * k, slice(12, 14)
        else:
            yield k, 6 * k, slice(6 * k + 4, 6 * k + 6)


@cache
def columns_by_name(method: Method) -> Mapping[str, slice]:
    """The columns of the Jacobian that each number or vector has: ``sensitivity1``, ``offset1``, ``axis1``, ..,
    ``field``, or ``field1``, .. of separate fits."""
    found: dict[str, slice] = {}
    for k, start, of_field in columns_of_channels(method):
        found |= {f"sensitivity{k + 1}": slice(start, start + 1), f"offset{k + 1}": slice(start + 1, start + 2)}
        found[f"axis{k + 1}"] = slice(start + 2, start + 4)
        if method == "separate":
            found[f"field{k + 1}"] = of_field
    return found if method == "separate" else {**found, "field": of_field}


def sizes_by_name(squares: Array, method: Method) -> dict[str, Array]:
    """Number or vector of ``columns_by_name`` -> (..,) its length, by the squares (.., p) of its coordinates."""
    return {name: np.sqrt(squares[..., own].sum(axis=-1)) for name, own in columns_by_name(method).items()}


@cache
def parameter_names(method: Method) -> tuple[str, ...]:
    """The names in the order of the Jacobian's columns, with angles in place of tangent coordinates."""
    names: list[str] = []
    for k in (1, 2, 3):
        names += [f"sensitivity{k}", f"offset{k}", f"beta{k}_deg", f"gamma{k}_deg"]
        if method == "separate":
            names += [f"phi{k}_deg", f"psi{k}_deg"]
    return (*names, "phi_deg", "psi_deg") if method == "simultaneous" else tuple(names)
