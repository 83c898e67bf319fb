"""A calibration laid over its recording: residuals, the noise they are held against, the directions seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.calibration import Calibration, SensorCalibration
from estimators.goodness.residuals import Residuals, residuals_of
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS_OF
from rig.recording import Recording
from scenarios.shown_units import shown_unit


@dataclass(frozen=True)
class Overlay:
    """One sensor's part of a recording with its calibration.

    Attributes:
        sensor: "accelerometer" or "magnetometer".
        names: the k series of residuals: the three channels, or the field's magnitude where the attitude is not known.
        unit: theirs, as it is shown; millivolts for volts.
        residuals: (n, k) reading less the model's reading, or magnitude less the reference [unit].
        sigma: (k,) the noise that the calibration rests on, else the fit's RMS [unit]; above zero.
        directions: (n, 3) unit vectors: the field in frame 6.
        axes: (3, 3) unit vectors P_k as rows, frame 6; those of the matrix where the calibration has no axes.
        field: (3,) unit vector, the field in the base frame; None where the attitude is not known.
        field_name: what that is: gravity, the magnetic field or, of an accelerometer that reads a - g, its opposite.
    """

    sensor: str
    names: tuple[str, ...]
    unit: str
    residuals: Array
    sigma: Array
    directions: Array
    axes: Array
    field: Array | None
    field_name: str

    @property
    def frame_name(self) -> str:
        """In which frame its directions are."""
        return "frame 6" if self.field is not None else "the sensor's own frame"


def overlays(recording: Recording, calibration: Calibration | None, arm: Arm | None) -> dict[str, Overlay]:
    """Lay a calibration over a recording, sensor by sensor; sensors that are not in both are left out.

    Args:
        arm: for recorded joint angles.

    Raises:
        RigError: a sensor's calibration is in another unit than its readings, or the arm has another number of joints.
    """
    if calibration is None:
        return {}
    if calibration.arm is None and recording.tool_quaternion is not None:
        arm = None  # it comes from the tool's poses, and is held against the same
    return {
        sensor: _overlay(residuals_of(recording, sensor, own, arm), own, recording.metadata.field_unit(sensor))
        for sensor, own in calibration.sensors.items()
        if sensor in recording.sensors
    }


def _overlay(left: Residuals, calibration: SensorCalibration, field_unit: str) -> Overlay:
    posed = left.names == CHANNELS_OF[left.sensor]
    shown = shown_unit(calibration.unit if posed else field_unit)
    # readings - bias = inverse @ field: its rows are S_k P_k
    rows = calibration.axis_vectors if posed else np.linalg.inv(calibration.matrix)
    field = calibration.field_direction.vector if posed and calibration.field_direction is not None else None
    sigma = np.sqrt(np.square(np.broadcast_to(left.sigma, left.values.shape)).mean(axis=0))
    return Overlay(
        left.sensor,
        left.names,
        shown.name,
        shown.factor * left.values,
        shown.factor * sigma,
        left.directions,
        rows / np.linalg.norm(rows, axis=1)[:, None],
        field,
        field_name(left.sensor, calibration.reads),
    )


def field_name(sensor: str, reads: str | None) -> str:
    """What a sensor's field is, in words."""
    if sensor != ACCELEROMETER:
        return "magnetic field"
    return "minus gravity" if reads == "a-g" else "gravity"
