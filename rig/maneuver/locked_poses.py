"""The noise procedure's recording: the arm locked in a few poses, sampled fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.arrays import Array
from rig.joint_values import joint_values
from rig.maneuver._checks import number, poses
from rig.trajectory import JointTrajectory, sample_times


@dataclass(frozen=True)
class LockedPoses:
    """Poses held one after the other; the way between them is not recorded.

    Renk et al. held three orientations for 200 s at 1 kHz and took the mean of the three RMS values. They do not say
    which; these differ by a quarter turn about two axes, so that every sensor axis is seen at different fields.

    Attributes:
        poses_deg: k poses of N joint angles [deg], or [m] of joints that slide.
        slides: the numbers of the joints that slide, from 1.
        hold_s: time in each.
        rate_Hz: of the samples.

    Raises:
        RigError: a value out of its range, or poses of different lengths.
    """

    poses_deg: tuple[tuple[float, ...], ...] = (
        (0.0, 90.0, -90.0, 0.0, 0.0, 0.0),
        (0.0, 90.0, -90.0, 0.0, 0.0, 90.0),
        (0.0, 90.0, -90.0, 0.0, 90.0, 0.0),
    )
    hold_s: float = 200.0
    rate_Hz: float = 1000.0
    slides: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "poses_deg", poses("maneuver.poses_deg", self.poses_deg))
        number("maneuver.hold_s", self.hold_s, 0.0, above=True)
        number("maneuver.rate_Hz", self.rate_Hz, 0.0, above=True)

    @property
    def duration_s(self) -> float:
        """All poses together [s]."""
        return self.hold_s * len(self.poses_deg)

    def trajectory(self, t: Array | None = None) -> JointTrajectory:
        """The joints at times ``t`` (n,) [s], by default the maneuver's own samples; velocity zero throughout."""
        times = sample_times(self.duration_s, self.rate_Hz) if t is None else np.asarray(t, dtype=float)
        # Sample k n of the k-th pose may be stamped an ulp early: the small shift keeps it in its own pose.
        pose = np.floor(times / self.hold_s + 1e-9).astype(int)
        q = joint_values(self.poses_deg, self.slides)[np.clip(pose, 0, len(self.poses_deg) - 1)]
        return JointTrajectory(times, q, np.zeros_like(q), np.zeros_like(q))
