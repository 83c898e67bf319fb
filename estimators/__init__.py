"""Estimators: volts in, answers out.

``estimators.coverage``, ``estimators.ellipsoid`` and ``estimators.stillness`` hold what else a user may want of them.
"""

from estimators import coverage, ellipsoid, stillness
from estimators.calibration import Calibration, SensorCalibration
from estimators.coverage import Coverage
from estimators.fields import apply
from estimators.gap import Diagnosis, diagnose
from estimators.goodness import Goodness, is_it_good, judged, robust_calibrate
from estimators.noise import NoiseFloor, noise_floor
from estimators.pipeline import calibrate
from estimators.statistics import Statistics
from estimators.stillness import still_poses

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
    "noise_floor",
    "robust_calibrate",
    "still_poses",
    "stillness",
]
