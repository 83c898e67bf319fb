"""Volts in, answers out.

- ``calibrate(run)``: sensitivities, offsets and axes of the sensors of one recording or several, with their covariance.
- ``is_it_good(..)``, ``judged(..)``: whether a calibration is good, and if not, why.
- ``robust_calibrate(run)``: the same without outliers.
- ``diagnose(run)``: where a recording disagrees with the model, and which unmodelled effects cause it.
- ``noise_floor(locked)``: the noise of a recording at rest.
- ``still_poses(run)``: when the sensor stood still, and what it read.
- ``apply(calibration, run)``: readings as fields.

``estimators.coverage``, ``estimators.ellipsoid`` and ``estimators.stillness`` hold what else a user may want of them.
The diagnosis is imported when it is first asked for: that takes as long as everything else together.
"""

from typing import TYPE_CHECKING, Any

from estimators import coverage, ellipsoid, stillness
from estimators.calibration import Calibration, SensorCalibration
from estimators.coverage import Coverage
from estimators.dispatch import calibrate
from estimators.fields import apply
from estimators.goodness import Goodness, is_it_good, judged, judged_together, robust_calibrate
from estimators.noise import NoiseFloor, noise_floor
from estimators.statistics import Statistics
from estimators.stillness import still_poses

if TYPE_CHECKING:
    from estimators.gap import Diagnosis, diagnose

__all__ = [
    "Calibration",
    "Coverage",
    "Diagnosis",
    "Goodness",
    "NoiseFloor",
    "SensorCalibration",
    "Statistics",
    "apply",
    "calibrate",
    "coverage",
    "diagnose",
    "ellipsoid",
    "is_it_good",
    "judged",
    "judged_together",
    "noise_floor",
    "robust_calibrate",
    "still_poses",
    "stillness",
]


def __getattr__(name: str) -> Any:
    if name in ("Diagnosis", "diagnose"):
        from estimators import gap

        return getattr(gap, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
