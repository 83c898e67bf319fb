"""Recursive estimators: a calibration, its coverage and a monitor, brought up to date with every sample."""

from estimators.live.calibrator import Calibrator, Options, SensorState
from estimators.live.cloud import Cloud
from estimators.live.estimate import SensorEstimate
from estimators.live.guide import PROCEDURES, Guide, Procedure, procedure
from estimators.live.stillness import StillStream
from estimators.live.window import SlidingSum

__all__ = [
    "PROCEDURES",
    "Calibrator",
    "Cloud",
    "Guide",
    "Options",
    "Procedure",
    "SensorEstimate",
    "SensorState",
    "SlidingSum",
    "StillStream",
    "procedure",
]
