"""MCAP files and ROS 2 bags: every topic with poses or readings as a table of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from scenarios.importing.text_log import Log

_Row = dict[str, float]


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a folder with its metadata, or a single file of one."""
    return path.suffix in (".mcap", ".db3", ".bag") or (path.is_dir() and (path / "metadata.yaml").is_file())


def read_bag(path: Path) -> list[Log]:
    """The topics of a bag that hold poses or readings, each as a table; times in s, of the messages' own headers.

    Times are counted from the first message, so that seconds since 1970 lose no digits.

    Raises:
        RigError: it cannot be read, or holds none of the messages that are known.
    """
    from rosbags.highlevel import AnyReader

    times: dict[str, list[int]] = {}
    rows: dict[str, list[_Row]] = {}
    met: dict[str, str] = {}
    try:
        with AnyReader([path]) as reader:
            for connection in reader.connections:
                met[connection.topic] = connection.msgtype
            known = [connection for connection in reader.connections if connection.msgtype in _READERS]
            for connection, logged, raw in reader.messages(known) if known else ():
                message: Any = reader.deserialize(raw, connection.msgtype)
                for part, stamp, row in _READERS[connection.msgtype](message, logged):
                    topic = f"{connection.topic}{part}"
                    times.setdefault(topic, []).append(stamp)
                    rows.setdefault(topic, []).append(row)
    except RigError:
        raise
    except Exception as error:  # a damaged bag fails in as many ways as there are storages
        raise RigError(f"{path}: not a whole bag: {' '.join(str(error).split())[:140]}") from error
    if not rows:
        listed = ", ".join(f"{topic} ({kind})" for topic, kind in list(met.items())[:6])
        expected = ", ".join(sorted(kind.split("/")[-1] for kind in _READERS))
        raise RigError(f"{path}: found {listed or 'no topic'}, expected messages of {expected}")
    start = min(min(stamps) for stamps in times.values())
    logs = []
    for topic, stamps in times.items():
        order = np.argsort(stamps, kind="stable")
        seconds = np.asarray((np.array(stamps, dtype=np.int64)[order] - start) * 1e-9, dtype=np.float64)
        columns: dict[str, NDArray[np.float64]] = {"stamp_s": seconds}
        for name in dict.fromkeys(name for row in rows[topic] for name in row):
            columns[name] = np.array([rows[topic][index].get(name, np.nan) for index in order])
        logs.append(Log(f"{path.name}:{topic}", columns, f"{len(stamps)} messages"))
    return logs


def _stamp(header: Any, logged: int) -> int:
    """[ns]; of the header, where it has been filled in."""
    own = int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
    return own or logged


def _imu(message: Any, logged: int) -> Iterator[tuple[str, int, _Row]]:
    a = message.linear_acceleration
    row = {"accel_x_m_s2": a.x, "accel_y_m_s2": a.y, "accel_z_m_s2": a.z}
    yield "", _stamp(message.header, logged), row


def _magnetic(message: Any, logged: int) -> Iterator[tuple[str, int, _Row]]:
    b = message.magnetic_field
    yield "", _stamp(message.header, logged), {"mag_x_T": b.x, "mag_y_T": b.y, "mag_z_T": b.z}


def _joints(message: Any, logged: int) -> Iterator[tuple[str, int, _Row]]:
    positions = np.asarray(message.position, dtype=float)
    row = {f"position {name}": float(value) for name, value in zip(message.name, positions, strict=False)}
    yield "", _stamp(message.header, logged), row


def _pose(position: Any, turn: Any) -> _Row:
    names = dict(zip(("qw", "qx", "qy", "qz"), (turn.w, turn.x, turn.y, turn.z), strict=True))
    return {**names, "x_m": position.x, "y_m": position.y, "z_m": position.z}


def _pose_stamped(message: Any, logged: int) -> Iterator[tuple[str, int, _Row]]:
    pose = message.pose
    yield "", _stamp(message.header, logged), _pose(pose.position, pose.orientation)


def _transforms(message: Any, logged: int) -> Iterator[tuple[str, int, _Row]]:
    for each in message.transforms:
        part = f" {each.header.frame_id} -> {each.child_frame_id}"
        yield part, _stamp(each.header, logged), _pose(each.transform.translation, each.transform.rotation)


def _transform(message: Any, logged: int) -> Iterator[tuple[str, int, _Row]]:
    yield "", _stamp(message.header, logged), _pose(message.transform.translation, message.transform.rotation)


_READERS: Final[dict[str, Callable[[Any, int], Iterator[tuple[str, int, _Row]]]]] = {
    "sensor_msgs/msg/Imu": _imu,
    "sensor_msgs/msg/MagneticField": _magnetic,
    "sensor_msgs/msg/JointState": _joints,
    "geometry_msgs/msg/PoseStamped": _pose_stamped,
    "geometry_msgs/msg/TransformStamped": _transform,
    "tf2_msgs/msg/TFMessage": _transforms,
}
