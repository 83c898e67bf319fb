"""The other of the two calibrations that give the same readings: (-field, -axes) in place of (field, axes)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.calibration.contract import SensorCalibration
from estimators.calibration.parts import AxisCalibration, FieldDirection
from rig.channels import READS

_ELEVATIONS = ("beta", "phi")
_AZIMUTHS = ("gamma", "psi")
_VECTORS = ("axis", "field")


def turned(sensor: SensorCalibration) -> SensorCalibration:
    """A calibration that knows the attitude, of a sensor that reads the opposite field; the readings are the same."""
    signs = np.where([name.startswith(_ELEVATIONS) for name in sensor.parameters], -1.0, 1.0)
    of_vectors = np.where([name.startswith(_VECTORS) for name in sensor.vector_parameters], -1.0, 1.0)
    azimuths = np.array([name.startswith(_AZIMUTHS) for name in sensor.parameters], dtype=bool)
    values = signs * sensor.values
    values[azimuths] = (values[azimuths] + 180.0) % 360.0
    return replace(
        sensor,
        reads=None if sensor.reads is None else READS[1 - READS.index(sensor.reads)],
        matrix=-sensor.matrix,
        values=values,
        covariance=signs[:, None] * sensor.covariance * signs,
        axes=tuple(_axis(axis) for axis in sensor.axes),
        field_direction=None if sensor.field_direction is None else _field(sensor.field_direction),
        convention=None if sensor.convention is None else f"turned round, {sensor.convention}",
        vector_values=of_vectors * sensor.vector_values,
        vector_covariance=of_vectors[:, None] * sensor.vector_covariance * of_vectors,
    )


def _axis(axis: AxisCalibration) -> AxisCalibration:
    return replace(
        axis,
        beta_deg=-axis.beta_deg,
        gamma_deg=(axis.gamma_deg + 180.0) % 360.0,
        axis=-axis.axis,
        field=None if axis.field is None else _field(axis.field),
    )


def _field(field: FieldDirection) -> FieldDirection:
    return replace(field, phi_deg=-field.phi_deg, psi_deg=(field.psi_deg + 180.0) % 360.0, vector=-field.vector)
