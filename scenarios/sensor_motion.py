"""Where the sensor was during a recording, at some of its samples: what the pictures of the sweep are drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from rig.arm import Arm
from rig.arrays import Array, Rows
from rig.recording import Recording

#: Length [m] of a bristle where no wrist is known: about that of the A465's, from wrist to sensor.
BRISTLE_M = 0.1


@dataclass(frozen=True)
class SensorMotion:
    """The sensor at m samples.

    Attributes:
        rows: (m,) their row numbers in the recording.
        R_base_tool: (m, 3, 3).
        tip: (m, 3) [m] the sensor, base frame; where only its attitude was recorded, on a sphere about the origin.
        root: (m, 3) [m] the wrist, or a point behind the sensor on the tool axis; the bristle of Renk et al., Figure 2,
            is the segment from root to tip.
    """

    rows: Rows
    R_base_tool: Array
    tip: Array
    root: Array

    @classmethod
    def of_joints(cls, arm: Arm, q: Array, rows: Rows) -> Self:
        """From the rows of joint angles ``q`` (n, N) [rad]; the wrist is the origin of the last link but one."""
        angles = q[rows]
        poses = arm.poses(angles)
        root = arm.link_poses(angles).position[:, max(arm.dof - 2, 0)]
        return cls(rows, poses.R_base_tool, poses.position, root)

    def reach(self, from_base: bool) -> Array:
        """(k, 3) [m] points that a view of the motion must hold, base frame; the base's origin among them, or not."""
        return np.vstack([self.tip, self.root, *([np.zeros(3)] if from_base else [])])


def arm_of(recording: Recording) -> Arm | None:
    """The arm that a recording's joint angles belong to, where its metadata name one that is known without a file."""
    return Arm.a465() if recording.q is not None and recording.metadata.arm == "a465" else None


def motion(recording: Recording, arm: Arm | None, rows: Rows) -> SensorMotion | None:
    """The sensor at some samples of a recording; None where its attitude was not recorded.

    Joint angles are used where there is an arm for them, the tool's pose otherwise.

    Raises:
        RigError: an arm with another number of joints than were recorded.
    """
    if recording.q is not None and arm is not None:
        return SensorMotion.of_joints(arm, recording.q, rows)
    if recording.tool_quaternion is None:
        return None
    part = recording.select(rows)
    R_base_tool = part.rotations(None).reshape(-1, 3, 3)
    along = BRISTLE_M * R_base_tool[:, :, 2]
    if part.tool_position is None:
        return SensorMotion(rows, R_base_tool, along, np.zeros_like(along))
    return SensorMotion(rows, R_base_tool, part.tool_position, part.tool_position - along)
