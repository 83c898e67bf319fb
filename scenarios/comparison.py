"""A calibration beside the truth of the scenario that made its recording, or beside another calibration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc

from estimators.calibration import Calibration, SensorCalibration
from estimators.calibration.turned import turned
from rig.channels import MAGNETOMETER
from rig.directions import difference_of
from rig.errors import RigError
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

    Raises:
        RigError: the calibration's magnetic field is in another unit than the truth's.
    """
    stated = calibration.with_field_unit(truth.magnetic_field_unit)
    magnetic = stated.sensors.get(MAGNETOMETER)
    if magnetic is not None and truth.magnetic_field_unit not in (None, magnetic.field_unit):
        raise RigError(
            f"magnetometer.field_unit: found {magnetic.field_unit} and {truth.magnetic_field_unit}, expected the same"
        )
    return tuple(
        row
        for sensor, found in stated.sensors.items()
        if sensor in truth.sensors
        for row in _rows(sensor, truth, found)
    )


@dataclass(frozen=True)
class Apart:
    """How far apart the two are, all parameters of a sensor together.

    Attributes:
        chi_square: squared distance in their joint covariance. degrees_of_freedom: how many parameters that is of.
        p_value: the probability of that distance, or more, by chance.
    """

    chi_square: float
    degrees_of_freedom: int
    p_value: float


def compare_two(first: Calibration, second: Calibration) -> tuple[Compared, ...]:
    """Every parameter that two calibrations of independent recordings both have: ``truth`` is the first's value.

    The second is turned to the first's side of the ambiguity (f, P), (-f, -P).

    Raises:
        RigError: no sensor in common, different units or reference magnitudes, or no parameter in common.
    """
    rows: list[Compared] = []
    shared = [sensor for sensor in first.sensors if sensor in second.sensors]
    if not shared:
        raise RigError(
            f"{first.recording} and {second.recording}: found calibrations of {' and '.join(first.sensors)} and of"
            f" {' and '.join(second.sensors)}, expected the same sensor"
        )
    for sensor in shared:
        one, two = first[sensor], second[sensor]
        known = one.field_unit is not None and two.field_unit is not None  # what an old file does not say may be so
        for what, pair in (
            ("unit", (one.unit, two.unit)),
            ("field_unit", (one.field_unit, two.field_unit) if known else (None, None)),
            ("reference_magnitude", (one.reference_magnitude, two.reference_magnitude)),
        ):
            if pair[0] != pair[1]:
                raise RigError(f"{sensor}.{what}: found {pair[0]} and {pair[1]}, expected the same")
        names = [name for name in one.parameters if name in two.parameters]
        if not names:
            raise RigError(f"{sensor}: found methods {one.method} and {two.method}, expected a parameter in common")
        of_units = one if one.field_unit is not None else two
        beside = turned(two) if _opposed(one, two) else two
        for name in names:
            value, sigma = one.value(name), math.hypot(one.std(name), two.std(name))
            error = difference_of(name, beside.value(name), value)
            told = [each.identifiable.get(name, True) for each in (one, two)]
            rows.append(_row(sensor, name, of_units.unit_of(name), value, value + error, error, sigma, told))
    return tuple(rows)


def _row(
    sensor: str, name: str, unit: str, truth: float, estimate: float, error: float, sigma: float, told: Iterable[Any]
) -> Compared:
    """``told``: of each calibration, True or the reason why the parameter cannot be told."""
    known = math.isfinite(sigma) and sigma > 0.0
    return Compared(
        sensor=sensor,
        parameter=name,
        unit=unit,
        truth=truth,
        estimate=estimate,
        sigma=sigma if known else None,
        error_sigmas=error / sigma if known else None,
        why=str(next((why for why in told if why is not True), "")),
    )


def _opposed(one: SensorCalibration, two: SensorCalibration) -> bool:
    """Whether their fields point to opposite sides."""
    first, second = one.field_direction, two.field_direction
    return first is not None and second is not None and float(first.vector @ second.vector) < 0.0


def apart(rows: Sequence[Compared], *calibrations: Calibration) -> dict[str, Apart]:
    """Sensor -> how far its rows are apart in the sum of the calibrations' covariances, of parameters that are told."""
    found = {}
    for sensor in dict.fromkeys(row.sensor for row in rows):
        own = [row for row in rows if row.sensor == sensor and row.error_sigmas is not None]
        names = [row.parameter for row in own]
        sigma = np.array([row.sigma for row in own], dtype=float)
        total = np.zeros((len(own), len(own)))
        for each in calibrations:
            one = turned(each[sensor]) if _opposed(calibrations[0][sensor], each[sensor]) else each[sensor]
            index = [one.parameters.index(name) for name in names]
            total += one.covariance[np.ix_(index, index)] / sigma[:, None] / sigma
        errors = np.array([row.error_sigmas for row in own], dtype=float)
        square = float(errors @ np.linalg.pinv(total, hermitian=True) @ errors)
        found[sensor] = Apart(square, len(own), float(chdtrc(len(own), square)) if own else 1.0)
    return found


def _rows(sensor: str, truth: Truth, found: SensorCalibration) -> list[Compared]:
    down = found.field_direction is None or found.field_direction.vector[2] <= 0.0
    true_values = truth.values(sensor, "down" if down else "up")
    sigmas = np.sqrt(np.diagonal(found.covariance))
    rows = []
    for index, name in enumerate(found.parameters):
        stem = name if name in true_values else f"{name.removesuffix('_deg')[:-1]}_deg"  # phi1_deg of a separate fit
        if stem not in true_values:
            continue
        estimate, true = float(found.values[index]), true_values[stem]
        error = difference_of(name, estimate, true)
        told = [found.identifiable.get(name, True)]
        rows.append(_row(sensor, name, found.unit_of(name), true, estimate, error, float(sigmas[index]), told))
    return rows
