"""The kinematic maneuver of Renk et al.: yaw and pitch back and forth while the roll joint turns, along a torus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rig.arrays import Array
from rig.errors import RigError, check_name
from rig.maneuver._checks import A465_LIMITS_DEG, limits, number, numbers, whole, within
from rig.maneuver.profile import BackAndForth
from rig.trajectory import JointTrajectory, sample_times

Roll = Literal["continuous", "sweep"]

_ROLLS = ("continuous", "sweep")
_ALONG = 300  # instants at which its way is shown


@dataclass(frozen=True)
class TorusSweep:
    """Yaw, pitch and roll at once, the other joints locked; Renk et al., "Robot Kinematic Maneuver" and Figure 2.

    The defaults are the paper's: joint 1 over 340 deg 15 times, joint 5 over 180 deg seven times, joint 6 turning at
    13.9 deg/s, for 1,664 s at 100 Hz (166,400 samples). Fifteen and seven have no common divisor, so no pose repeats.
    Where the paper is silent: both back-and-forth motions are centred on zero, begin at their low end at rest, and
    turn round in ``corner_s``, with continuous acceleration. The ranges are met exactly, peak to peak.

    Attributes:
        duration_s: of the whole maneuver.
        rate_Hz: of the samples.
        yaw_range_deg: of the yaw joint, from peak to peak.
        yaw_passes: how often the yaw joint goes over its range.
        yaw_centre_deg: centre of the yaw joint's range.
        pitch_range_deg: of the pitch joint, from peak to peak.
        pitch_passes: how often the pitch joint goes over its range.
        pitch_centre_deg: centre of the pitch joint's range.
        roll: "continuous" turns one way for ever, as in the paper; "sweep" goes back and forth over ``roll_range_deg``,
            for an arm whose last joint cannot, with as many whole passes as come nearest to ``roll_deg_per_s``.
        roll_deg_per_s: speed of the roll joint; the average one in a sweep.
        roll_start_deg: where a continuous roll starts.
        roll_range_deg: of a sweeping roll, from peak to peak.
        roll_centre_deg: centre of a sweeping roll's range.
        locked_deg: the angles of the joints that do not move, in their order; [m] of those that slide.
        corner_s: time from full speed to full speed the other way.
        joints: the numbers of the yaw, pitch and roll joints, from 1.
        limits_deg: (low, high) of each joint, checked here; None leaves that to the arm. A continuous roll is free.
        slides: the numbers of the joints that slide, from 1.

    Raises:
        RigError: a value out of its range, or a joint beyond its limit.
    """

    duration_s: float = 1664.0
    rate_Hz: float = 100.0
    yaw_range_deg: float = 340.0
    yaw_passes: int = 15
    yaw_centre_deg: float = 0.0
    pitch_range_deg: float = 180.0
    pitch_passes: int = 7
    pitch_centre_deg: float = 0.0
    roll: Roll = "continuous"
    roll_deg_per_s: float = 13.9
    roll_start_deg: float = 0.0
    roll_range_deg: float = 360.0
    roll_centre_deg: float = 0.0
    locked_deg: tuple[float, ...] = (90.0, -90.0, 0.0)
    corner_s: float = 0.5
    joints: tuple[int, int, int] = (1, 5, 6)
    limits_deg: tuple[tuple[float, float], ...] | None = A465_LIMITS_DEG
    slides: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("duration_s", "rate_Hz", "corner_s"):
            number(f"maneuver.{name}", getattr(self, name), 0.0, above=True)
        for name in ("yaw_range_deg", "pitch_range_deg", "roll_range_deg"):
            number(f"maneuver.{name}", getattr(self, name), 0.0)
        for name in ("yaw_centre_deg", "pitch_centre_deg", "roll_deg_per_s", "roll_start_deg", "roll_centre_deg"):
            number(f"maneuver.{name}", getattr(self, name))
        whole("maneuver.yaw_passes", self.yaw_passes, 1)
        whole("maneuver.pitch_passes", self.pitch_passes, 1)
        check_name("maneuver.roll", self.roll, _ROLLS)
        object.__setattr__(self, "locked_deg", numbers("maneuver.locked_deg", self.locked_deg))
        dof = 3 + len(self.locked_deg)
        joints = tuple(int(joint) for joint in numbers("maneuver.joints", self.joints, 3))
        if joints != tuple(self.joints) or len(set(joints) & {*range(1, dof + 1)}) != 3:
            raise RigError(f"maneuver.joints: found {self.joints!r}, expected three different joints of 1 to {dof}")
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "limits_deg", limits("maneuver.limits_deg", self.limits_deg, dof))
        self._check_motion()

    def _check_motion(self) -> None:
        locked = self._locked_joints
        for joint, angle in zip(locked, self.locked_deg, strict=True):
            within("maneuver.locked_deg", joint, angle, angle, self.limits_deg)
        for name, joint, law in zip(("yaw", "pitch", "roll"), self.joints, self._laws, strict=True):
            if law is None:
                continue
            within(f"maneuver.{name}_range_deg", joint, law.low, law.high, self.limits_deg)
            if self.corner_s > law.duration / law.passes:
                longest = law.duration / law.passes
                raise RigError(
                    f"maneuver.corner_s: found {self.corner_s:g}, expected at most {longest:.6g}, "
                    f"the time of one {name} pass"
                )

    @property
    def _locked_joints(self) -> list[int]:
        return [joint for joint in range(1, len(self.locked_deg) + 4) if joint not in self.joints]

    @property
    def roll_passes(self) -> int:
        """The number of passes of a sweeping roll."""
        wanted = abs(self.roll_deg_per_s) * self.duration_s / self.roll_range_deg if self.roll_range_deg else 1.0
        return max(1, round(wanted))

    @property
    def _laws(self) -> tuple[BackAndForth, BackAndForth, BackAndForth | None]:
        """The motions of yaw, pitch and roll [deg]; None for a continuous roll."""

        def law(centre: float, extent: float, passes: int) -> BackAndForth:
            return BackAndForth(centre - extent / 2, centre + extent / 2, passes, self.duration_s, self.corner_s)

        return (
            law(self.yaw_centre_deg, self.yaw_range_deg, self.yaw_passes),
            law(self.pitch_centre_deg, self.pitch_range_deg, self.pitch_passes),
            law(self.roll_centre_deg, self.roll_range_deg, self.roll_passes) if self.roll == "sweep" else None,
        )

    def peaks(self) -> tuple[Array, Array]:
        """(N,) the greatest speed [rad/s] and acceleration [rad/s^2] of each joint."""
        speed, acceleration = np.zeros((2, 3 + len(self.locked_deg)))
        for joint, law in zip(self.joints, self._laws, strict=True):
            speed[joint - 1] = abs(self.roll_deg_per_s if law is None else law.speed)
            acceleration[joint - 1] = 0.0 if law is None else law.peak_acceleration
        return np.radians(speed), np.radians(acceleration)

    def way(self) -> Array:
        """(m, N) joint values along it [rad, m], ends of passes among them."""
        ends = [np.linspace(0.0, self.duration_s, law.passes + 1) for law in self._laws if law is not None]
        return self.trajectory(np.concatenate([np.linspace(0.0, self.duration_s, _ALONG), *ends])).q

    def trajectory(self, t: Array | None = None) -> JointTrajectory:
        """The joints at times ``t`` (n,) [s], by default the maneuver's own samples; exact at any time.

        Before the start and after the end the joints hold still, but for a continuous roll, which goes on.
        """
        times = sample_times(self.duration_s, self.rate_Hz) if t is None else np.asarray(t, dtype=float)
        motion = np.zeros((3, len(times), 3 + len(self.locked_deg)))  # q, qd, qdd
        for joint, angle in zip(self._locked_joints, self.locked_deg, strict=True):
            motion[0, :, joint - 1] = angle if joint in self.slides else np.radians(angle)
        for joint, law in zip(self.joints, self._laws, strict=True):
            if law is not None:
                for derivative, values in enumerate(law.evaluate(times)):
                    np.radians(values, out=motion[derivative, :, joint - 1])
            else:
                speed = np.radians(self.roll_deg_per_s)
                motion[0, :, joint - 1] = np.radians(self.roll_start_deg) + speed * times
                motion[1, :, joint - 1] = speed
        return JointTrajectory(times, *motion)
