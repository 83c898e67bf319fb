"""A calibration beside the truth of the scenario that made its recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimators.calibration import Calibration, SensorCalibration
from rig.channels import ACCELEROMETER
from scenarios.scenario import Truth


@dataclass(frozen=True)
class Compared:
    """One parameter: what it is, what was found, and how far apart the two are.

    Attributes:
        sensor, parameter, unit: what it is.
        truth, estimate: [unit].
        sigma: standard deviation of the estimate [unit]; None where it cannot be told, for the reason ``why``.
        error_sigmas: (estimate - truth) / sigma, angles by the shorter way round; None likewise.
    """

    sensor: str
    parameter: str
    unit: str
    truth: float
    estimate: float
    sigma: float | None
    error_sigmas: float | None
    why: str = ""


def compare(truth: Truth, calibration: Calibration) -> tuple[Compared, ...]:
    """Every parameter that the calibration and the truth both have, sensor by sensor.

    The truth is turned to the calibration's side of the ambiguity (f, P), (-f, -P): where its field points.
    """
    return tuple(
        row
        for sensor, found in calibration.sensors.items()
        if sensor in truth.sensors
        for row in _rows(sensor, truth, found)
    )


def units(sensor: str, calibration: SensorCalibration, magnetic_field_unit: str | None) -> Mapping[str, str]:
    """The unit of each parameter of a sensor's calibration."""
    field = "m/s²" if sensor == ACCELEROMETER else magnetic_field_unit or "field"
    reading = calibration.unit.replace("_", "/")
    per_field = f"{reading}/({field})" if "/" in field else f"{reading}/{field}"
    kinds = {"sensitivity": per_field, "offset": reading}
    return {name: kinds.get(name.rstrip("0123456789"), "deg") for name in calibration.parameters}


def _rows(sensor: str, truth: Truth, found: SensorCalibration) -> list[Compared]:
    down = found.field_direction is None or found.field_direction.vector[2] <= 0.0
    true_values = truth.values(sensor, "down" if down else "up")
    sigmas = np.sqrt(np.diagonal(found.covariance))
    unit = units(sensor, found, truth.magnetic_field_unit)
    rows = []
    for index, name in enumerate(found.parameters):
        stem = name if name in true_values else f"{name.removesuffix('_deg')[:-1]}_deg"  # phi1_deg of a separate fit
        if stem not in true_values:
            continue
        estimate, true = float(found.values[index]), true_values[stem]
        error = estimate - true
        if name.endswith("_deg"):
            error = (error + 180.0) % 360.0 - 180.0
        sigma = float(sigmas[index])
        told = math.isfinite(sigma) and sigma > 0.0
        why = found.identifiable.get(name, True)
        rows.append(
            Compared(
                sensor=sensor,
                parameter=name,
                unit=unit[name],
                truth=true,
                estimate=estimate,
                sigma=sigma if told else None,
                error_sigmas=error / sigma if told else None,
                why="" if why is True else str(why),
            )
        )
    return rows
