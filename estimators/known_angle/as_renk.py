"""A recording calibrated as Renk et al. did, beside the optimum: how far their search ends from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimators._json import AsJson
from estimators.calibration import Calibration, SensorCalibration
from estimators.known_angle.from_recording import summarise
from estimators.known_angle.model import Method, SensorParameters
from estimators.known_angle.quasi_newton import QuasiNewton, quasi_newton
from rig.directions import angles_from_direction
from rig.recording import Recording, RecordingScan

if TYPE_CHECKING:
    from rig.arm import Arm


@dataclass(frozen=True)
class SearchEnd(AsJson):
    """Where the paper's search ended for one sensor.

    Attributes:
        iterations, evaluations: of the search, and of its cost.
        cost_ratio: sum of squared residuals over that of the calibration, all channels alike; below one where the
            calibration weighs its channels by their noise.
        parameter, sigmas: the parameter that is farthest from the calibration's, and how far, in its standard
            deviations.
        values: parameter -> value there, named and folded as the calibration's.
        message: how it ended.
    """

    iterations: int
    evaluations: int
    cost_ratio: float
    parameter: str
    sigmas: float
    values: dict[str, float]
    message: str


def as_renk(
    source: Recording | RecordingScan, calibration: Calibration, arm: Arm | None = None
) -> dict[str, SearchEnd]:
    """Sensor -> where quasi-Newton minimisation from the paper's start ends.

    Args:
        source: a recording with a pose. calibration: of it, simultaneous or separate. arm: as of ``calibrate``.

    Raises:
        RigError: as ``estimators.calibrate``.
    """
    names = list(calibration.sensors)
    summed = summarise(source, names, arm)
    found = {}
    for place, name in enumerate(names):
        sensor = calibration.sensors[name]
        method: Method = "separate" if sensor.method == "separate" else "simultaneous"
        own = summed.statistics.select(slice(3 * place, 3 * place + 3))
        end = quasi_newton(own, sensor.reference_magnitude, method)
        found[name] = _compared(end, sensor)
    return found


def _compared(end: QuasiNewton, sensor: SensorCalibration) -> SearchEnd:
    values = _named(end.parameters, sensor)
    std = np.sqrt(sensor.covariance.diagonal())
    off: dict[str, float] = {}
    for name, value, own in zip(sensor.parameters, sensor.values, std, strict=True):
        difference = values[name] - value
        if name.endswith("_deg"):
            difference = (difference + 180.0) % 360.0 - 180.0
        if np.isfinite(difference) and np.isfinite(own) and own > 0.0:
            off[name] = abs(difference) / float(own)
    worst = max(off, key=lambda name: off[name])
    least = float(np.square(sensor.fit_rms).sum() * sensor.samples)
    return SearchEnd(end.iterations, end.evaluations, end.cost / least, worst, off[worst], values, end.message)


def _named(parameters: SensorParameters, sensor: SensorCalibration) -> dict[str, float]:
    """The parameters by the calibration's names, on its side of (f, P) and (-f, -P)."""
    separate = sensor.method == "separate"
    values: dict[str, float] = {}
    for k, axis in enumerate(sensor.axes):
        sign = 1.0 if float(parameters.axes[k] @ axis.axis) >= 0.0 else -1.0
        beta, gamma = angles_from_direction(sign * parameters.axes[k])
        phi, psi = angles_from_direction(sign * parameters.fields[k])
        number = k + 1
        values |= {
            f"sensitivity{number}": float(parameters.sensitivity[k]),
            f"offset{number}": float(parameters.offset[k]),
            f"beta{number}_deg": float(beta),
            f"gamma{number}_deg": float(gamma),
        }
        own = str(number) if separate else ""
        values |= {f"phi{own}_deg": float(phi), f"psi{own}_deg": float(psi)}
    return values
