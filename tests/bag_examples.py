"""A recording as a ROS 2 bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from rig.recording import Recording

TYPES = get_typestore(Stores.ROS2_HUMBLE)


def write_bag(path: Path, run: Recording, storage: StoragePlugin, clock_s: float, joints: list[str]) -> Path:
    """The run as a ROS 2 bag: joints in an order of their own, at half the rate, on a clock that is off."""
    types = TYPES.types
    Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    Vector, Quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    Imu, Field = types["sensor_msgs/msg/Imu"], types["sensor_msgs/msg/MagneticField"]
    Joints, none = types["sensor_msgs/msg/JointState"], np.zeros(9)
    order = [2, 1, 0, 3, 4, 5]  # as a driver sorts them by name

    def header(t: float) -> object:
        nanoseconds = round((1.7e9 + t) * 1e9)
        return Header(Time(nanoseconds // 10**9, nanoseconds % 10**9), "")

    with Writer(path, version=9, storage_plugin=storage) as writer:
        topics = {
            name: writer.add_connection(name, kind.__msgtype__, typestore=TYPES)
            for name, kind in (("/imu", Imu), ("/mag", Field), ("/joint_states", Joints))
        }

        def put(topic: str, t: float, message: object) -> None:
            raw = TYPES.serialize_cdr(message, topics[topic].msgtype)
            writer.write(topics[topic], round((1.7e9 + t) * 1e9), raw)

        for row, t in enumerate(run.t):
            acceleration = Vector(*(9.80665 * run.accelerometer[row]))
            put("/imu", t, Imu(header(t), Quaternion(0, 0, 0, 1), none, Vector(0, 0, 0), none, acceleration, none))
            put("/mag", t, Field(header(t), Vector(*(1e-6 * run.magnetometer[row])), none))
            if row % 2 == 0:
                names, q = [joints[joint] for joint in order], run.q[row, order]
                put("/joint_states", t, Joints(header(t + clock_s), names, q, np.zeros(6), np.zeros(6)))
    return path
