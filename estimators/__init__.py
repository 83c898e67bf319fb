"""Estimators: volts in, answers out."""

from estimators.calibration import Calibration, SensorCalibration
from estimators.fields import apply
from estimators.gap import Diagnosis, diagnose
from estimators.noise import NoiseFloor, noise_floor
from estimators.pipeline import calibrate
from estimators.statistics import Statistics

__all__ = [
    "Calibration",
    "Diagnosis",
    "NoiseFloor",
    "SensorCalibration",
    "Statistics",
    "apply",
    "calibrate",
    "diagnose",
    "noise_floor",
]
