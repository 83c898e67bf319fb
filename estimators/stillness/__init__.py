"""Static detection: when the sensor stood still, and what it read in each pose."""

from estimators.stillness.detection import CAMPS_THRESHOLD_V2, Stillness, find_still
from estimators.stillness.poses import StillPoses, average_poses, still_poses
from estimators.stillness.threshold import Threshold, choose_threshold
from estimators.stillness.variance import windowed_variance

__all__ = [
    "CAMPS_THRESHOLD_V2",
    "StillPoses",
    "Stillness",
    "Threshold",
    "average_poses",
    "choose_threshold",
    "find_still",
    "still_poses",
    "windowed_variance",
]
