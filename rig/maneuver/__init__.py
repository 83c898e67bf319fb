"""Maneuvers: joint angles or poses over time, each one small class."""

from __future__ import annotations

from typing import Final, Protocol

from rig.arrays import Array
from rig.maneuver.axis_rotations import AxisRotations
from rig.maneuver.fourier_sweep import FourierSweep
from rig.maneuver.hand_tumble import HandTumble
from rig.maneuver.locked_poses import LockedPoses
from rig.maneuver.static_poses import StaticPoses
from rig.maneuver.torus_sweep import TorusSweep
from rig.trajectory import JointTrajectory, PoseTrajectory


class Maneuver(Protocol):
    """A prescribed motion, known at any time."""

    @property
    def rate_Hz(self) -> float:
        """The rate of its own samples."""
        ...

    @property
    def duration_s(self) -> float:
        """From the first sample to the one after the last."""
        ...

    def trajectory(self, t: Array | None = None) -> JointTrajectory | PoseTrajectory:
        """The motion at times (n,) [s], by default at its own samples 0, 1/rate, .."""
        ...


#: What a scenario's [maneuver] table may name.
MANEUVERS: Final[
    dict[str, type[TorusSweep | FourierSweep | LockedPoses | HandTumble | StaticPoses | AxisRotations]]
] = {
    "torus-sweep": TorusSweep,
    "fourier-sweep": FourierSweep,
    "locked-poses": LockedPoses,
    "static-poses": StaticPoses,
    "hand-tumble": HandTumble,
    "axis-rotations": AxisRotations,
}

__all__ = [
    "MANEUVERS",
    "AxisRotations",
    "FourierSweep",
    "HandTumble",
    "LockedPoses",
    "Maneuver",
    "StaticPoses",
    "TorusSweep",
]
