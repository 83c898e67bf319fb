"""The estimator of Renk et al.: quasi-Newton minimisation with numerical gradients from one start, for comparison.

MATLAB's ``fminunc`` as the paper uses it on (14), (15), (20), (21); here SciPy's BFGS and its finite differences. Axes
start along +i of frame 6, sensitivities at 1 V per unit and offsets at 2.5 V; where the field starts the paper leaves
open. The cost is that of all samples, from their sufficient statistics as a sum of squares, so that no digits are lost.
``as_renk`` says how far the search ends from a calibration's optimum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.optimize import minimize

from estimators._json import AsJson
from estimators.calibration import Calibration, SensorCalibration
from estimators.known_angle.from_recording import summarise
from estimators.known_angle.model import Method, SensorParameters, parameter_names
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array
from rig.directions import difference_of, direction_from_angles
from rig.recording import Recording, RecordingScan
from rig.recording.repeated_poses import evenly_posed
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm

#: beta, gamma, S, delta of a channel, and phi, psi [rad, V per unit, V]; the field straight down.
CHANNEL_START: Final = (0.0, 0.0, 1.0, 2.5)
FIELD_START: Final = (0.5 * np.pi, 0.0)


@dataclass(frozen=True, eq=False)
class QuasiNewton:
    """Where the minimisation ended.

    Attributes:
        parameters: there, with positive sensitivities.
        angles: (3, 2) phi, psi of each channel's field as the search has them, not folded [rad].
        cost: sum of squared residuals of all channels [recorded unit squared].
        iterations, evaluations: of the search, and of the cost.
        message: how it ended, as the minimiser says it.
    """

    parameters: SensorParameters
    angles: Array
    cost: float
    iterations: int
    evaluations: int
    message: str


def quasi_newton(
    statistics: Statistics,
    reference_magnitude: float,
    method: Method = "simultaneous",
    field_start: tuple[float, float] = FIELD_START,
    relative_fall: float | None = None,
) -> QuasiNewton:
    """Minimise the sum of squared residuals as Renk et al. did.

    Args:
        statistics: of three channels. reference_magnitude: of the field [m/s^2, field unit].
        method: all channels at once, or one by one.
        field_start: phi, psi at the start [rad].
        relative_fall: end with the first iteration that lowers the cost by a smaller share; None: only where the
            gradient is that of rounding.
    """
    groups = [[0, 1, 2]] if method == "simultaneous" else [[0], [1], [2]]
    with one_blas_thread():
        ends = [
            _minimised(_Residuals.of(statistics, group, reference_magnitude), field_start, relative_fall)
            for group in groups
        ]
    four = np.concatenate([end.x[:-2].reshape(-1, 4) for end in ends])
    angles = np.concatenate([np.tile(end.x[-2:], (len(group), 1)) for end, group in zip(ends, groups, strict=True)])
    sign = np.where(four[:, 2] < 0.0, -1.0, 1.0)
    parameters = SensorParameters(
        reference_magnitude,
        np.abs(four[:, 2]),
        four[:, 3],
        sign[:, None] * direction_from_angles(*np.degrees(four[:, :2].T)),
        direction_from_angles(*np.degrees(angles.T)),
    )
    return QuasiNewton(
        parameters,
        angles,
        sum(float(end.fun) for end in ends),
        sum(int(end.nit) for end in ends),
        sum(int(end.nfev) for end in ends),
        str(ends[-1].message),
    )


@dataclass(frozen=True, eq=False)
class _Residuals:
    """Residuals of some channels up to a rotation: w @ root - targets, and the squares that no w explains."""

    root: Array
    targets: Array
    rest: float
    magnitude: float

    @classmethod
    def of(cls, statistics: Statistics, channels: list[int], magnitude: float) -> _Residuals:
        values, vectors = np.linalg.eigh(statistics.gram)
        kept = values > 1e-12 * values[-1]
        root = vectors[:, kept] * np.sqrt(values[kept])
        targets = (statistics.cross[:, channels].T @ vectors[:, kept]) / np.sqrt(values[kept])
        squares = statistics.square[channels, channels] - np.square(targets).sum(axis=1)
        return cls(root, targets, float(np.maximum(squares, 0.0).sum()), magnitude)

    def cost(self, x: Array) -> float:
        """Of beta, gamma, S, delta of each channel, then phi, psi of the field [rad]."""
        four = x[:-2].reshape(-1, 4)
        axes = four[:, 2, None] * _direction(four[:, 0], four[:, 1])
        field = self.magnitude * _direction(x[-2], x[-1])
        w = np.column_stack([(field[:, None] * axes[:, None, :]).reshape(-1, 9), four[:, 3]])
        away = (w @ self.root - self.targets).ravel()
        return float(away @ away) + self.rest


def _direction(elevation: Array, azimuth: Array) -> Array:
    """(..., 3) Renk (6), (12) [rad]."""
    level = np.cos(elevation)
    return np.stack([np.cos(azimuth) * level, np.sin(azimuth) * level, -np.sin(elevation)], axis=-1)


def _minimised(residuals: _Residuals, field_start: tuple[float, float], relative_fall: float | None) -> Any:
    last = np.inf

    def enough(intermediate_result: Any) -> None:
        nonlocal last
        if relative_fall is not None and last - intermediate_result.fun < relative_fall * intermediate_result.fun:
            raise StopIteration
        last = intermediate_result.fun

    start = np.array([*CHANNEL_START * len(residuals.targets), *field_start])
    return minimize(residuals.cost, start, method="BFGS", callback=enough)


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
    summed = summarise(evenly_posed(source)[0], names, arm)
    found = {}
    for place, name in enumerate(names):
        sensor = calibration.sensors[name]
        method: Method = "separate" if sensor.method == "separate" else "simultaneous"
        own = summed.statistics.select(slice(3 * place, 3 * place + 3))
        end = quasi_newton(own, sensor.reference_magnitude, method)
        found[name] = _compared(end, sensor, method)
    return found


def _compared(end: QuasiNewton, sensor: SensorCalibration, method: Method) -> SearchEnd:
    values = _named(end.parameters, sensor, method)
    std = np.sqrt(sensor.covariance.diagonal())
    off: dict[str, float] = {}
    for name, value, own in zip(sensor.parameters, sensor.values, std, strict=True):
        difference = difference_of(name, values[name], float(value))
        if np.isfinite(difference) and np.isfinite(own) and own > 0.0:
            off[name] = abs(difference) / float(own)
    worst = max(off, key=lambda name: off[name])
    least = float(np.square(sensor.fit_rms).sum() * sensor.samples)
    return SearchEnd(end.iterations, end.evaluations, end.cost / least, worst, off[worst], values, end.message)


def _named(parameters: SensorParameters, sensor: SensorCalibration, method: Method) -> dict[str, float]:
    """The parameters by the calibration's names, on its side of (f, P) and (-f, -P)."""
    sides = np.where((parameters.axes * sensor.axis_vectors).sum(axis=1, keepdims=True) >= 0.0, 1.0, -1.0)
    turned = replace(parameters, axes=sides * parameters.axes, fields=sides * parameters.fields)
    return dict(zip(parameter_names(method), turned.values(method).tolist(), strict=True))
