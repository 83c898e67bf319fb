"""MCAP files and ROS 2 bags: every topic with poses or readings as a table of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from rig.arrays import Array
from rig.documents import check_ordinary
from rig.errors import RigError
from scenarios.importing.text_log import Log
from scenarios.importing.transforms import Transforms

_Row = dict[str, float]


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a folder with its metadata, or a single file of one."""
    return path.suffix in (".mcap", ".db3", ".bag") or (path.is_dir() and (path / "metadata.yaml").is_file())


def read_bag(path: Path, base_frame: str | None = None, tool_frame: str | None = None) -> list[Log]:
    """The topics of a bag that hold poses or readings, each as a table; times in s, of the messages' own headers.

    Times are counted from the first message, so that seconds since 1970 lose no digits. Transforms (/tf, /tf_static)
    are one table: the pose of ``tool_frame`` in ``base_frame``, see ``Transforms.chain``.

    Raises:
        RigError: it cannot be read, holds none of the messages that are known, or no such frames.
    """
    from rosbags.highlevel import AnyReader

    if not path.is_dir():
        check_ordinary(path, "a bag")
    times: dict[str, list[int]] = {}
    rows: dict[str, list[_Row]] = {}
    met: dict[str, str] = {}
    transforms = Transforms()
    try:
        with AnyReader([path]) as reader:
            for connection in reader.connections:
                met[connection.topic] = connection.msgtype
            known = [each for each in reader.connections if each.msgtype in (*_READERS, _TF)]
            for connection, logged, raw in reader.messages(known) if known else ():
                message: Any = reader.deserialize(raw, connection.msgtype)
                if connection.msgtype == _TF:
                    for each in message.transforms:
                        transforms.add(each, _stamp(each.header, logged), str(path))
                    continue
                times.setdefault(connection.topic, []).append(_stamp(message.header, logged))
                rows.setdefault(connection.topic, []).append(_READERS[connection.msgtype](message))
                if connection.msgtype in _SENSORS and message.header.frame_id not in transforms.sensors:
                    transforms.sensors.append(message.header.frame_id)
    except RigError:
        raise
    except Exception as error:  # a damaged bag fails in as many ways as there are storages
        raise RigError(f"{path}: not a whole bag: {' '.join(str(error).split())[:140]}") from error
    if not rows and not transforms.parents:
        listed = ", ".join(f"{topic} ({kind})" for topic, kind in list(met.items())[:6])
        expected = ", ".join(sorted(kind.split("/")[-1] for kind in (*_READERS, _TF)))
        raise RigError(f"{path}: found {listed or 'no topic'}, expected messages of {expected}")
    start = min(min(stamps) for stamps in (*times.values(), *transforms.times.values()))
    logs = []
    for topic, stamps in times.items():
        order = np.argsort(stamps, kind="stable")
        seconds = np.asarray((np.array(stamps, dtype=np.int64)[order] - start) * 1e-9, dtype=np.float64)
        columns: dict[str, Array] = {"stamp_s": seconds}
        for name in dict.fromkeys(name for row in rows[topic] for name in row):
            columns[name] = np.array([rows[topic][index].get(name, np.nan) for index in order])
        logs.append(Log(f"{path.name}:{topic}", columns, f"{len(stamps)} messages"))
    readings = [log.columns["stamp_s"] for log in logs if met[log.name.partition(":")[2]] in _SENSORS]
    pose = transforms.chain(base_frame, tool_frame, readings, start, path.name)
    if pose is None:
        return logs
    return [pose, *logs] if base_frame is not None or tool_frame is not None else [*logs, pose]


def _stamp(header: Any, logged: int) -> int:
    """[ns]; of the header, where it has been filled in."""
    own = int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
    return own or logged


def _vector(stem: str, vector: Any, unit: str) -> _Row:
    return {f"{stem}_{axis}_{unit}": getattr(vector, axis) for axis in "xyz"}


def _joints(message: Any) -> _Row:
    positions = np.asarray(message.position, dtype=float)
    return {f"position {name}": float(value) for name, value in zip(message.name, positions, strict=False)}


def _pose(position: Any, turn: Any) -> _Row:
    names = dict(zip(("qw", "qx", "qy", "qz"), (turn.w, turn.x, turn.y, turn.z), strict=True))
    return {**names, "x_m": position.x, "y_m": position.y, "z_m": position.z}


_TF: Final = "tf2_msgs/msg/TFMessage"
_SENSORS: Final = ("sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField")
_READERS: Final[dict[str, Callable[[Any], _Row]]] = {
    "sensor_msgs/msg/Imu": lambda message: _vector("accel", message.linear_acceleration, "m_s2"),
    "sensor_msgs/msg/MagneticField": lambda message: _vector("mag", message.magnetic_field, "T"),
    "sensor_msgs/msg/JointState": _joints,
    "geometry_msgs/msg/PoseStamped": lambda message: _pose(message.pose.position, message.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda message: _pose(
        message.transform.translation, message.transform.rotation
    ),
}
