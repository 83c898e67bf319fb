"""Coverage: which directions of the field a sensor has seen, which are missing, and when it has seen enough."""

from estimators.coverage.attitude_free_information import AttitudeFreeInformation
from estimators.coverage.cells import SphereCells
from estimators.coverage.direction_names import direction_name
from estimators.coverage.enough import Enough, Targets, enough_attitude_free, enough_known_angles
from estimators.coverage.seen import Coverage, coverage

__all__ = [
    "AttitudeFreeInformation",
    "Coverage",
    "Enough",
    "SphereCells",
    "Targets",
    "coverage",
    "direction_name",
    "enough_attitude_free",
    "enough_known_angles",
]
