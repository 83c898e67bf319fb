"""A calibration laid over its recording: residuals, the noise they are held against, the directions seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.calibration import Calibration, SensorCalibration
from rig.arm import Arm
from rig.channels import ACCELEROMETER, CHANNELS_OF
from rig.errors import RigError
from rig.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Overlay:
    """One sensor's part of a recording with its calibration.

    Attributes:
        sensor: "accelerometer" or "magnetometer".
        names: the k series of residuals: the three channels, or the field's magnitude where the attitude is not known.
        unit: theirs; millivolts for volts.
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
    known = recording.tool_quaternion is not None or (recording.q is not None and arm is not None)
    R = recording.rotations(arm).reshape(-1, 3, 3) if known else None
    found = {}
    for sensor in recording.sensors:
        if sensor not in calibration.sensors:
            continue
        part = calibration[sensor]
        if part.unit != recording.unit(sensor):
            raise RigError(
                f"{recording.origin or recording.name}: the {sensor} is recorded in {recording.unit(sensor)},"
                f" found a calibration in {part.unit}, expected the same unit"
            )
        readings = recording.readings(sensor)
        if R is None or not part.axes or part.field_direction is None:
            found[sensor] = _by_magnitude(sensor, readings, part, recording.metadata.field_unit(sensor))
        else:
            found[sensor] = _by_attitude(sensor, readings, R, part, part.field_direction.vector)
    return found


def _by_attitude(sensor: str, readings: Array, R: Array, part: SensorCalibration, field: Array) -> Overlay:
    """Renk (13), (19): V_k = S_k P_k . R^T f + delta_k."""
    seen = np.matmul(field, R)  # R^T f, (n, 3)
    residuals = np.empty_like(readings)
    for k, axis in enumerate(part.axes):
        own = seen if axis.field is None else np.matmul(axis.field.vector, R)  # separate fits have a field each
        scale = axis.sensitivity * part.reference_magnitude
        residuals[:, k] = readings[:, k] - (scale * (own @ axis.axis) + axis.offset)
    unit, factor = ("mV", 1e3) if part.unit == "V" else (part.unit, 1.0)
    largest = factor * float(np.abs(readings).max())
    sigma = factor * (part.fit_rms if part.noise is None else part.noise)
    return Overlay(
        sensor,
        CHANNELS_OF[sensor],
        unit,
        factor * residuals,
        _above_rounding(sigma, largest),
        seen,
        part.axis_vectors,
        field,
        field_name(sensor, part.reads),
    )


def field_name(sensor: str, reads: str | None) -> str:
    """What a sensor's field is, in words."""
    if sensor != ACCELEROMETER:
        return "magnetic field"
    return "minus gravity" if reads == "a-g" else "gravity"


def _by_magnitude(sensor: str, readings: Array, part: SensorCalibration, unit: str) -> Overlay:
    """|matrix (V - bias)| against the reference; its noise is the readings' noise along the field."""
    fields = (readings - part.bias) @ part.matrix.T
    magnitude = np.linalg.norm(fields, axis=1)
    directions = fields / magnitude[:, None]
    residuals = magnitude - part.reference_magnitude
    noise = part.fit_rms if part.noise is None else part.noise
    along = np.square(directions @ part.matrix) @ np.square(noise)
    sigma = float(np.sqrt(along.mean()))
    if not np.isfinite(sigma):
        sigma = float(np.sqrt(np.square(residuals).mean()))
    rows = np.linalg.inv(part.matrix)  # readings - bias = inverse @ field: its rows are S_k P_k
    axes = rows / np.linalg.norm(rows, axis=1)[:, None]
    name = f"{sensor}_magnitude"
    return Overlay(
        sensor,
        (name,),
        unit,
        residuals[:, None],
        _above_rounding(np.array([sigma]), part.reference_magnitude),
        directions,
        axes,
        None,
        field_name(sensor, part.reads),
    )


def _above_rounding(sigma: Array, largest: float) -> Array:
    """A fit without noise may leave nothing at all: then it is the rounding of the largest number that counts."""
    return np.maximum(sigma, np.finfo(float).eps * max(largest, 1.0))
