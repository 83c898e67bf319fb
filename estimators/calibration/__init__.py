"""What was found out about each sensor, how to use it, and how to export it: ``rig-calibration/1``."""

from estimators.calibration.contract import FORMAT, Calibration, SensorCalibration

__all__ = ["FORMAT", "Calibration", "SensorCalibration"]
