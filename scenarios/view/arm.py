"""The arm in the viewer: its URDF moved by the recorded joint angles, or a stick figure where there is no URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from rig.arm import Arm
from rig.errors import RigError, one_line
from rig.files import scratch_folder
from rig.urdf_file import drawable_urdf
from scenarios.colours import GREY, rgb
from scenarios.view.timeline import at

Array = NDArray[np.float64]

ARM: Final = "arm"
TRANSFORMS: Final = "transforms"

#: The base frame's name in a view without a URDF, whose root link names it otherwise.
BASE: Final = "base"

_STICK_RADIUS_M = 0.012


class ArmView:
    """An arm in a view.

    Attributes:
        base: the name of the base frame, in which everything fixed to the base is to be logged.
    """

    def __init__(self, stream: rr.RecordingStream, arm: Arm) -> None:
        """Log what does not move.

        Args:
            stream: to log to.
            arm: to be shown.

        Raises:
            RigError: the arm's URDF cannot be read, or lacks one of its joints.
        """
        self.base = BASE
        self._stream, self._arm = stream, arm
        self._joints: dict[str, Any] = {}
        if arm.urdf is None:
            stream.log(ARM, rr.CoordinateFrame(BASE), static=True)
            stream.log(ARM, rr.LineStrips3D.from_fields(radii=_STICK_RADIUS_M, colors=[rgb(GREY)]), static=True)
            return
        tree = _log_urdf(stream, arm.urdf)
        for name in arm.joint_names:
            joint = tree.get_joint_by_name(name)
            if joint is None:
                raise RigError(f"{arm.urdf}: has no joint {name!r}, which arm {arm.name!r} has")
            self._joints[name] = joint
        self.base = tree.root_link().name

    def move(self, t: Array, q: Array) -> None:
        """The arm moving through m samples: times (m,) [s] and joint angles (m, N) [rad]."""
        if self._arm.urdf is None:
            self._move_sticks(t, q)
        for (name, joint), angles in zip(self._joints.items(), q.T, strict=False):
            within_a_turn = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi  # it computes in single precision
            columns = joint.compute_transform_columns(within_a_turn.tolist(), clamp=False)
            self._stream.send_columns(f"{TRANSFORMS}/{name}", indexes=at(t), columns=columns)

    def _move_sticks(self, t: Array, q: Array) -> None:
        """A line from the base through the origins of the links to the sensor."""
        base = np.zeros((len(t), 1, 3))
        own = self._arm
        strips = np.concatenate([base, own.link_poses(q).position, own.poses(q).position[:, None]], axis=1)
        self._stream.send_columns(ARM, indexes=at(t), columns=rr.LineStrips3D.columns(strips=strips))


def log_arm(stream: rr.RecordingStream, arm: Arm, t: Array, q: Array) -> str:
    """The arm moving through m samples.

    Args:
        t: (m,) [s].
        q: (m, N) [rad].

    Returns:
        The name of the base frame.

    Raises:
        RigError: as of ``ArmView``.
    """
    shown = ArmView(stream, arm)
    shown.move(t, q)
    return shown.base


def _log_urdf(stream: rr.RecordingStream, urdf: Path) -> rr.urdf.UrdfTree:
    """The links as they are drawn; the viewer's library would read any file, and any URL, that a URDF names."""
    content, _ = drawable_urdf(urdf)
    with scratch_folder("rig-urdf") as folder:
        copy = folder / "arm.urdf"
        copy.write_bytes(content)
        try:
            tree = rr.urdf.UrdfTree.from_file_path(copy, entity_path_prefix=ARM)
            tree.log_urdf_to_recording(stream)
        except Exception as error:
            raise RigError(f"{urdf}: the viewer cannot read it: {one_line(str(error), 120)}") from error
    return tree
