"""A calibration for use elsewhere: as YAML, JSON, a C header or parameters of ROS, with the formula that applies it.

    field = matrix (reading - bias)

Every number is written with the fewest digits that give it back to the last bit.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from estimators._json import dump
from estimators.calibration.contract import Calibration, SensorCalibration
from rig.channels import ACCELEROMETER, CHANNELS_OF, MAGNETOMETER
from rig.errors import RigError, check_name
from rig.number_text import number
from rig.units import conversion_factor

#: The format of an export, version included.
FORMAT: Final = "rig-export/1"
TARGETS: Final = ("yaml", "json", "c", "ros")
FORMULA: Final = "field = matrix * (reading - bias)"
_TESLA_PER_GAUSS: Final = 1e-4


def export(calibration: Calibration, target: str, field_unit: str | None = None) -> str:
    """The text of a file that applies a calibration.

    Args:
        calibration: to be used elsewhere.
        target: "yaml", "json", "c" or "ros".
        field_unit: unit of the calibration's magnetic field, G, uT or nT, where it does not say it itself.

    Raises:
        RigError: an unknown target, another unit than the calibration says, or a sensor whose axes do not span space,
            which has no matrix.
    """
    check_name("export", target, TARGETS)
    if target == "ros":
        return _ros_yaml(in_field_unit(calibration, field_unit))
    content = contents(calibration, field_unit)
    if target == "json":
        return dump(content)
    return _yaml(content) if target == "yaml" else _c_header(content)


def contents(calibration: Calibration, field_unit: str | None = None) -> dict[str, Any]:
    """What every export holds; arguments and errors as of ``export``."""
    stated = in_field_unit(calibration, field_unit)
    return {
        "format": FORMAT,
        "recording": calibration.recording,
        "formula": FORMULA,
        "sensors": {name: _sensor(name, sensor) for name, sensor in stated.sensors.items()},
    }


def in_field_unit(calibration: Calibration, unit: str | None) -> Calibration:
    """The calibration with the unit of its magnetic field; arguments and errors as of ``export``."""
    own = calibration.sensors.get(MAGNETOMETER)
    said = None if own is None else own.field_unit
    if unit is not None and said is not None and unit != said:
        raise RigError(f"field_unit: found {unit}, expected {said}, which the calibration says its field is in")
    return calibration.with_field_unit(unit)


def _sensor(name: str, sensor: SensorCalibration) -> dict[str, Any]:
    numbers = (*sensor.matrix.ravel(), *sensor.bias)
    if not all(math.isfinite(value) for value in numbers):
        raise RigError(f"{name}: its axes do not span space, so there is no matrix to export")
    force = "a - g, the specific force" if sensor.reads == "a-g" else "g - a, minus the specific force"
    about = force if name == ACCELEROMETER else "the magnetic field"
    frame = "the tool frame" if sensor.axes else "the sensor's own frame"
    unit = "m/s^2" if name == ACCELEROMETER else sensor.field_unit or "that of reference_magnitude"
    return {
        "field": f"{about}, in {frame}",
        "field_unit": unit,
        "reading_unit": sensor.unit,
        "channels": list(CHANNELS_OF[name]),
        "reference_magnitude": float(sensor.reference_magnitude),
        "matrix": [[float(value) for value in row] for row in sensor.matrix],
        "bias": [float(value) for value in sensor.bias],
        "bias_std": [_std(sensor, k) for k in (1, 2, 3)],
        "noise": None if sensor.noise is None else [float(value) for value in sensor.noise],
        "method": sensor.method,
        "samples": int(sensor.samples),
        "warnings": list(sensor.quality.warnings),
    }


def _std(sensor: SensorCalibration, k: int) -> float | None:
    """Of an offset, where the calibration tells it."""
    name = f"offset{k}"
    std = sensor.std(name) if name in (*sensor.parameters, *sensor.vector_parameters) else math.nan
    return std if math.isfinite(std) else None


# --- YAML ------------------------------------------------------------------------------------------------------------


def _yaml(content: Mapping[str, Any]) -> str:
    """Block mappings with flow sequences; what YAML 1.1 and 1.2 both read as the same."""
    lines = [
        f"# {content['formula']}",
        "# With numpy: field = (reading - bias) @ matrix.T for readings (n, 3) in reading_unit.",
    ]
    for key, value in content.items():
        if key != "sensors":
            lines.append(f"{key}: {_flow(value)}")
    lines.append("sensors:")
    for name, sensor in content["sensors"].items():
        lines.append(f"  {name}:")
        for key, value in sensor.items():
            if key == "matrix":
                lines.append("    matrix:")
                lines += [f"      - {_flow(row)}" for row in value]
            else:
                lines.append(f"    {key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """A scalar or a list on one line."""
    if isinstance(value, list):
        return f"[{', '.join(_flow(item) for item in value)}]"
    if isinstance(value, float):
        return number(value)
    return json.dumps(value)  # JSON's texts, whole numbers, true, false and null are YAML's as well


# --- C ---------------------------------------------------------------------------------------------------------------


def _c_header(content: Mapping[str, Any]) -> str:
    """A C99 header, which is C++ too: constants and a function for each sensor."""
    names = "_".join(content["sensors"])
    guard = f"RIG_CALIBRATION_{names.upper()}_H"
    title = f"Calibration from {content['recording']}" if content["recording"] else "Calibration"
    parts = [
        f"/* {_comment(title)}.\n *\n *     {content['formula']}\n */",
        f"#ifndef {guard}\n#define {guard}",
        *(_c_sensor(name, sensor) for name, sensor in content["sensors"].items()),
        f"#endif /* {guard} */",
    ]
    return "\n\n".join(parts) + "\n"


def _c_sensor(name: str, sensor: Mapping[str, Any]) -> str:
    prefix = f"rig_{name}"
    rows = ",\n".join(f"    {{{', '.join(number(value) for value in row)}}}" for row in sensor["matrix"])
    bias = ", ".join(number(value) for value in sensor["bias"])
    warnings = "".join(f"\n * Warning: {_comment(text)}" for text in sensor["warnings"])
    return f"""\
/* {name}, {_comment(sensor["method"])}, {sensor["samples"]} samples
 * reading[3]: {", ".join(sensor["channels"])} [{_comment(sensor["reading_unit"])}]
 * field[3]: {sensor["field"]} [{_comment(sensor["field_unit"])}]
 * reference magnitude: {number(sensor["reference_magnitude"])}{warnings}
 */
static const double {prefix}_matrix[3][3] = {{
{rows}
}};
static const double {prefix}_bias[3] = {{{bias}}};

static inline void {prefix}_field(const double reading[3], double field[3])
{{
    const double x = reading[0] - {prefix}_bias[0];
    const double y = reading[1] - {prefix}_bias[1];
    const double z = reading[2] - {prefix}_bias[2];
    for (int i = 0; i < 3; ++i)
        field[i] = {prefix}_matrix[i][0] * x
                 + {prefix}_matrix[i][1] * y
                 + {prefix}_matrix[i][2] * z;
}}"""


def _comment(text: str) -> str:
    """A text that cannot end a comment, or hold what a compiler warns of: printable ASCII on one line."""
    plain = re.sub(r"[^ -~]", "?", " ".join(text.split()))
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "?")


# --- ROS --------------------------------------------------------------------------------------------------------------


def _ros_yaml(calibration: Calibration) -> str:
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
        lines += _ros_section(name, sensor)
    return "\n".join(lines) + "\n"


def _ros_section(name: str, sensor: SensorCalibration) -> list[str]:
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
        f"  matrix: {_ros_flow(matrix.ravel())}",
        f"  bias: {_ros_flow(sensor.bias)}",
        f"  {member}_covariance: {_ros_flow(covariance.ravel())}",
        *(
            ["  orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"]
            if name == ACCELEROMETER
            else []
        ),
    ]


def _ros_flow(values: Iterable[float]) -> str:
    """A list on one line, every number with all its digits; zero, ROS's word for not known, where there is none."""
    return f"[{', '.join(number(float(value) if math.isfinite(value) else 0.0) for value in values)}]"
