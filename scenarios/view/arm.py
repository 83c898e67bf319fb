"""The arm in the viewer: its URDF moved by the recorded joint angles, or a stick figure where there is no URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Final

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


def log_arm(stream: rr.RecordingStream, arm: Arm, t: Array, q: Array) -> str:
    """The arm moving through m samples.

    Args:
        t: (m,) [s].
        q: (m, N) [rad].

    Returns:
        The name of the base frame, in which everything fixed to the base is to be logged.

    Raises:
        RigError: the arm's URDF cannot be read, or lacks one of its joints.
    """
    if arm.urdf is None:
        _log_sticks(stream, arm, t, q)
        return BASE
    tree = _log_urdf(stream, arm.urdf)
    for name, angles in zip(arm.joint_names, q.T, strict=True):
        joint = tree.get_joint_by_name(name)
        if joint is None:
            raise RigError(f"{arm.urdf}: has no joint {name!r}, which arm {arm.name!r} has")
        within_a_turn = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi  # it computes in single precision
        columns = joint.compute_transform_columns(within_a_turn.tolist(), clamp=False)
        stream.send_columns(f"{TRANSFORMS}/{name}", indexes=at(t), columns=columns)
    return tree.root_link().name


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


def _log_sticks(stream: rr.RecordingStream, arm: Arm, t: Array, q: Array) -> None:
    """A line from the base through the origins of the links to the sensor."""
    base = np.zeros((len(t), 1, 3))
    strips = np.concatenate([base, arm.link_poses(q).position, arm.poses(q).position[:, None]], axis=1)
    stream.log(ARM, rr.CoordinateFrame(BASE), static=True)
    stream.log(ARM, rr.LineStrips3D.from_fields(radii=_STICK_RADIUS_M, colors=[rgb(GREY)]), static=True)
    stream.send_columns(ARM, indexes=at(t), columns=rr.LineStrips3D.columns(strips=strips))
