"""A calibration for ROS pipelines of IMU and magnetometer: matrix, bias and covariance as the messages hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from estimators.calibration.contract import Calibration, SensorCalibration
from rig.channels import ACCELEROMETER
from rig.errors import RigError
from rig.number_text import number
from rig.units import conversion_factor

_TESLA_PER_GAUSS = 1e-4


def ros_yaml(calibration: Calibration) -> str:
    """YAML with one section a sensor; matrices and covariances are row-major lists of nine, as in ``sensor_msgs``.

    ``sensor_msgs/Imu`` has the specific force a - g (up at rest), in m/s^2: the matrix is that of the calibration, with
    the other sign of one that gives g - a. ``sensor_msgs/MagneticField`` is in tesla, where the calibration says its
    field's unit; where it does not, the file says so.

    Raises:
        RigError: a sensor whose axes do not span space, which has no matrix.
    """
    lines = [
        "# output = matrix * (reading - bias), reading in reading_unit; matrix and covariance row by row.",
        "# covariance: of one output, from the white noise of the readings: matrix * diag(noise^2) * matrix'.",
        "# An orientation is not estimated: its covariance is -1 in the first place, as sensor_msgs/Imu asks for.",
    ]
    for name, sensor in calibration.sensors.items():
        if not np.isfinite(sensor.matrix).all():
            raise RigError(f"{name}: its axes do not span space, so there is no matrix to export")
        lines += _section(name, sensor)
    return "\n".join(lines) + "\n"


def _section(name: str, sensor: SensorCalibration) -> list[str]:
    if name == ACCELEROMETER:
        factor = 1.0 if sensor.reads == "a-g" else -1.0
        unit, message, member = "m/s^2", "sensor_msgs/Imu", "linear_acceleration"
    else:
        factor, unit = 1.0, f"not stated, one in which the field's magnitude is {number(sensor.reference_magnitude)}"
        if sensor.field_unit is not None:
            factor, unit = conversion_factor(sensor.field_unit, "G") * _TESLA_PER_GAUSS, "T"
        message, member = "sensor_msgs/MagneticField", "magnetic_field"
    matrix = factor * sensor.matrix
    noise = np.full(3, np.nan) if sensor.noise is None else np.asarray(sensor.noise, dtype=float)
    covariance = matrix @ np.diag(noise**2) @ matrix.T
    return [
        f"{name}:",
        f"  message: {message}",
        f"  member: {member}",
        f"  unit: {unit}",
        f"  reading_unit: {sensor.unit}",
        f"  frame: {'tool' if sensor.axes else 'sensor'}",
        f"  matrix: {_flow(matrix.ravel())}",
        f"  bias: {_flow(sensor.bias)}",
        f"  {member}_covariance: {_flow(covariance.ravel())}",
        *(
            ["  orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"]
            if name == ACCELEROMETER
            else []
        ),
    ]


def _flow(values: Iterable[float]) -> str:
    """A list on one line, every number with all its digits; zero, ROS's word for not known, where there is none."""
    return f"[{', '.join(number(float(value) if math.isfinite(value) else 0.0) for value in values)}]"
