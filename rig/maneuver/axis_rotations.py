"""Turns about three axes, one after the other: the least that the attitude-free calibration asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rig.arrays import Array
from rig.maneuver._checks import number
from rig.maneuver.profile import quintic
from rig.trajectory import PoseTrajectory, sample_times


@dataclass(frozen=True)
class AxisRotations:
    """A full turn about the sensor's x, then y, then z axis, each back where it began; Camps et al., Figure 3.

    Each turn begins and ends without speed or acceleration. Before the first, the sensor is level but for its tilt:
    turned from level, gravity runs along two circles and stays put while the sensor turns about the third axis, which
    leaves one of nine parameters open; a tilt tells it.

    Attributes:
        turn_s: time of one turn [s].
        tilt_deg: of the sensor before each turn, about the base's axis (1, 1, 0).
        rate_Hz: of the samples.

    Raises:
        RigError: a value out of its range.
    """

    turn_s: float = 40.0
    tilt_deg: float = 0.0
    rate_Hz: float = 5.0

    def __post_init__(self) -> None:
        for name in ("turn_s", "rate_Hz"):
            number(f"maneuver.{name}", getattr(self, name), 0.0, above=True)
        number("maneuver.tilt_deg", self.tilt_deg, -180.0, 180.0)

    @property
    def duration_s(self) -> float:
        """Of all three turns [s]."""
        return 3.0 * self.turn_s

    def trajectory(self, t: Array | None = None) -> PoseTrajectory:
        """The sensor at times ``t`` (n,) [s], by default the maneuver's own samples; it stays where it is."""
        times = sample_times(self.duration_s, self.rate_Hz) if t is None else np.asarray(t, dtype=float)
        axis = np.clip(np.floor(times / self.turn_s), 0, 2).astype(int)
        angle = 2.0 * np.pi * quintic(times / self.turn_s - axis)[0]
        turned = Rotation.from_rotvec(angle[:, None] * np.eye(3)[axis])
        tilt = Rotation.from_rotvec(np.radians(self.tilt_deg) * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
        still = np.zeros((len(times), 3))
        return PoseTrajectory(times, (tilt * turned).as_matrix(), still, still)
