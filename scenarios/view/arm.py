"""The arm in the viewer, moved by the recorded joint angles: its URDF, else its model's shapes, else a stick figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import rerun as rr

from rig.arm import Arm
from rig.arm.urdf_file import drawable_urdf
from rig.arrays import Array, Rows
from rig.errors import RigError, one_line
from rig.files import scratch_folder
from rig.recording import Recording
from scenarios.colours import GREY, rgb
from scenarios.view.geoms import Shapes, painted
from scenarios.view.stream import at

ARM: Final = "arm"
TRANSFORMS: Final = "transforms"

#: The base frame's name in a view without a URDF, whose root link names it otherwise.
BASE: Final = "base"

_STICK_RADIUS_M = 0.012


#: What the viewer draws a shape as, by its name in a URDF.
_ARCHETYPES: Final = {"box": rr.Boxes3D, "cylinder": rr.Cylinders3D, "sphere": rr.Ellipsoids3D, "mesh": rr.Asset3D}


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
        self._model: Shapes | None = None
        self._stream, self._arm = stream, arm
        self._joints: dict[str, Any] = {}
        self._tree: Any = None
        self._shapes: dict[str, list[str]] = {}
        if arm.urdf is None:
            own = Shapes(stream, arm, BASE, ARM)
            if own.drawn:
                self._model = own
                return
            stream.log(ARM, rr.CoordinateFrame(BASE), static=True)
            stream.log(ARM, rr.LineStrips3D.from_fields(radii=_STICK_RADIUS_M, colors=[rgb(GREY)]), static=True)
            return
        self._tree = tree = _log_urdf(stream, arm.urdf)
        self._shapes = _shapes(drawable_urdf(arm.urdf)[0])
        for name in arm.joint_names:
            joint = tree.get_joint_by_name(name)
            if joint is None:
                raise RigError(f"{arm.urdf}: has no joint {name!r}, which arm {arm.name!r} has")
            self._joints[name] = joint
        self.base = tree.root_link().name

    def move(self, t: Array, q: Array) -> None:
        """The arm moving through m samples: times (m,) [s] and joint angles (m, N) [rad]."""
        if self._model is not None:
            self._model.move(t, q, TRANSFORMS)
        elif self._arm.urdf is None:
            self._move_sticks(t, q)
        for (name, joint), angles in zip(self._joints.items(), q.T, strict=False):
            within_a_turn = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi  # it computes in single precision
            columns = joint.compute_transform_columns(within_a_turn.tolist(), clamp=False)
            self._stream.send_columns(f"{TRANSFORMS}/{name}", indexes=at(t), columns=columns)

    def colour(self, number: int, colour: tuple[int, int, int]) -> None:
        """Paint the link that a joint moves, counted from zero; a stick figure has no links to paint."""
        if number >= len(self._arm.joint_names):
            return
        if self._model is not None:
            self._model.colour(number, colour)
        if self._tree is None:
            return
        link = self._joints[self._arm.joint_names[number]].child_link
        for path, shape in zip(self._tree.get_visual_geometry_paths(link), self._shapes.get(link, ()), strict=False):
            self._stream.log(path, painted(_ARCHETYPES[shape], colour), static=True)

    def _move_sticks(self, t: Array, q: Array) -> None:
        """A line from the base through the origins of the links to the sensor."""
        base = np.zeros((len(t), 1, 3))
        own = self._arm
        strips = np.concatenate([base, own.link_poses(q).position, own.poses(q).position[:, None]], axis=1)
        self._stream.send_columns(ARM, indexes=at(t), columns=rr.LineStrips3D.columns(strips=strips))


def log_arm(stream: rr.RecordingStream, recording: Recording, arm: Arm | None, rows: Rows) -> ArmView | None:
    """The arm moving through some samples of a recording; None without joint angles, or without their arm.

    Raises:
        RigError: as of ``ArmView``.
    """
    if arm is None or recording.q is None:
        return None
    shown = ArmView(stream, arm)
    shown.move(recording.t[rows], recording.q[rows])
    return shown


def _shapes(urdf: bytes) -> dict[str, list[str]]:
    """Link -> what each of its visuals is, of a URDF that may be drawn."""
    found: dict[str, list[str]] = {}
    for link in ElementTree.fromstring(urdf).iter("link"):
        geometries = [visual.find("geometry") for visual in link.iter("visual")]
        found[str(link.get("name"))] = [each[0].tag for each in geometries if each is not None and len(each)]
    return found


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
