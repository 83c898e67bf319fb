"""The tool's pose out of ROS transforms: the chain of frames from the base to the tool, each at its own times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from rig.arrays import Array
from rig.errors import RigError, nearest
from scenarios.importing.text_log import Log

#: Frames where something is bolted on, by the names that arms' makers give them, the usual one first.
_TOOLS: Final = ("imu", "imu_link", "tool0", "flange", "ee_link", "tcp", "tool", "end_effector")
_BASES: Final = ("base_link", "base")
_NAMED: Final = 8
_LEAST: Final = 2  # messages of a transform that moves


@dataclass
class Transforms:
    """The transforms of a bag, child by child.

    Attributes:
        parents: child -> its parent. times: child -> stamps [ns]. poses: child -> (qw, qx, qy, qz, x, y, z).
        sensors: the frames that the readings are stamped with, in the order met.
    """

    parents: dict[str, str] = field(default_factory=dict)
    times: dict[str, list[int]] = field(default_factory=dict)
    poses: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    sensors: list[str] = field(default_factory=list)

    def add(self, message: Any, stamp: int, where: str) -> None:
        """One ``geometry_msgs/TransformStamped``.

        Raises:
            RigError: the child hangs on two parents.
        """
        parent, child = message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/")
        if self.parents.setdefault(child, parent) != parent:
            raise RigError(
                f"{where}: tf: frame {child!r} hangs on {self.parents[child]!r} and on {parent!r}: expected one parent"
            )
        turn, place = message.transform.rotation, message.transform.translation
        self.times.setdefault(child, []).append(stamp)
        self.poses.setdefault(child, []).append((turn.w, turn.x, turn.y, turn.z, place.x, place.y, place.z))

    def chain(self, base: str | None, tool: str | None, readings: list[Array], start: int, where: str) -> Log | None:
        """The tool's pose in the base, as a log; None where nothing moves and no frames were asked for.

        Every transform is interpolated between its own stamps, at the readings' instants and at its own.

        Args:
            base, tool: frames; None: the frame named as a base, else the last one before something moves; the frame of
                the readings, or a flange's.
            readings: their instants [s].
            start: of the bag's time [ns].
            where: for messages.

        Raises:
            RigError: no such frame, frames that are not connected, or no one end of the moving frames.
        """
        if not self.parents or (not self._moving() and base is None and tool is None):
            return None
        tool = self._tool(tool, where)
        base = self._base(base, tool, where)
        up, down = self._between(base, tool, where)
        moving = [child for child in (*up, *down) if child in self._moving()]
        said = f"transforms {base} -> {tool}, {len(moving)} of {len(up) + len(down)} of them moving"
        stamps = [self._stamps(child, start) for child in moving]
        t = np.unique(np.concatenate([*stamps, *readings]))
        for own in stamps:
            t = t[(t >= own[0]) & (t <= own[-1])]
        if len(t) < _LEAST:
            raise RigError(f"{where}: tf: the transforms {', '.join(moving[:_NAMED])} have no time in common")
        pose = RigidTransform.identity(len(t))
        for child in up:
            pose = pose * self._at(child, t, start, where).inv()
        for child in down:
            pose = pose * self._at(child, t, start, where)
        turns, places = pose.rotation.as_quat(scalar_first=True), pose.translation
        columns = {"stamp_s": t, **dict(zip(("qw", "qx", "qy", "qz"), turns.T, strict=True))}
        columns |= dict(zip(("x_m", "y_m", "z_m"), places.T, strict=True))
        apart = [own for own in stamps if not all(np.isin(each, own).all() for each in readings)]
        rate = min((1.0 / float(np.median(np.diff(own))) for own in apart), default=np.inf)
        return Log(f"{where}:tf {base} -> {tool}", columns, said, rate)

    def _moving(self) -> set[str]:
        """The children that were sent more than once, and not always alike."""
        return {
            child for child, poses in self.poses.items() if len(poses) >= _LEAST and bool(np.ptp(poses, axis=0).any())
        }

    def _stamps(self, child: str, start: int) -> Array:
        return np.unique((np.array(self.times[child], dtype=np.int64) - start) * 1e-9)

    def _at(self, child: str, t: Array, start: int, where: str) -> RigidTransform:
        """A transform at times (m,) [s]: the rotation along the shortest way, the place on a line."""
        values = np.array(self.poses[child])
        if not np.all(np.abs(np.linalg.norm(values[:, :4], axis=1) - 1.0) < 0.05):
            raise RigError(f"{where}: tf: a rotation of frame {child!r} is no unit quaternion, expected the norm 1")
        turns, places = Rotation.from_quat(values[:, :4], scalar_first=True), values[:, 4:]
        if child not in self._moving():
            return RigidTransform.from_components(np.tile(places[0], (len(t), 1)), turns[[0] * len(t)])
        own, rows = np.unique((np.array(self.times[child], dtype=np.int64) - start) * 1e-9, return_index=True)
        there = np.stack([np.interp(t, own, places[rows, axis]) for axis in range(3)], axis=1)
        return RigidTransform.from_components(there, Slerp(own, turns[rows])(t))

    def _root_way(self, frame: str) -> Iterator[str]:
        """A frame, its parent, and so on to the root; a loop ends where it closes."""
        seen: set[str] = set()
        while frame not in seen:
            seen.add(frame)
            yield frame
            if frame not in self.parents:
                return
            frame = self.parents[frame]

    def _frames(self) -> list[str]:
        return list(dict.fromkeys([*self.parents.values(), *self.parents]))

    def _known(self, frame: str, option: str, where: str) -> str:
        frame = frame.lstrip("/")
        frames = self._frames()
        if frame not in frames:
            listed = ", ".join(frames[:_NAMED])
            raise RigError(f"{where}: {option}: no transform of {frame!r}: found {listed}{nearest(frame, frames)}")
        return frame

    def _tool(self, stated: str | None, where: str) -> str:
        if stated is not None:
            return self._known(stated, "tool_frame", where)
        moving = self._moving()
        depth = {frame: sum(each in moving for each in self._root_way(frame)) for frame in self._frames()}
        for sensor in self.sensors:
            if depth.get(sensor):
                return sensor
        most = max(depth.values())
        ends = [frame for frame, count in depth.items() if count == most]
        for name in _TOOLS:
            for frame in ends:
                if frame == name or frame.endswith(f"_{name}"):
                    return frame
        leaves = [frame for frame in ends if frame not in self.parents.values()]
        if len(leaves) == 1:
            return leaves[0]
        raise RigError(
            f"{where}: tf: found no one tool among {', '.join(ends[:_NAMED])}, expected --tool-frame FRAME, the one"
            " that carries the sensor"
        )

    def _base(self, stated: str | None, tool: str, where: str) -> str:
        if stated is not None:
            return self._known(stated, "base_frame", where)
        way, moving = list(self._root_way(tool))[::-1], self._moving()
        still = way[: next((index for index, frame in enumerate(way) if frame in moving), len(way))]
        exact = [frame for name in _BASES for frame in way if frame == name]
        alike = [frame for name in _BASES for frame in still if frame.endswith(f"_{name}")]
        return (exact or alike or still[-1:] or way)[0]

    def _between(self, base: str, tool: str, where: str) -> tuple[list[str], list[str]]:
        """The children from the base up to the common ancestor, base first; and from there down to the tool."""
        from_base, from_tool = list(self._root_way(base)), list(self._root_way(tool))
        common = next((frame for frame in from_base if frame in from_tool), None)
        if common is None:
            raise RigError(
                f"{where}: tf: no chain of transforms from {base!r} to {tool!r}: their roots are {from_base[-1]!r} and"
                f" {from_tool[-1]!r}"
            )
        return from_base[: from_base.index(common)], from_tool[: from_tool.index(common)][::-1]
