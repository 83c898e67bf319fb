"""Bags with transforms: the tool's pose is that of the chain of frames, each at its own times."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from arm_files import UR5E_NAMES, written
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import RigidTransform, Rotation

import scenarios
from rig.arm import Arm
from rig.errors import RigError
from rig.maneuver import TorusSweep
from rig.recording import Recording
from scenarios.importing import Imported, Mapping, import_logs
from scenarios.importing.mapping import Conventions, Stated

TYPES = get_typestore(Stores.ROS2_HUMBLE)
IMU = "sensor_msgs/msg/Imu"
BASE_TURN = Rotation.from_euler("ZYX", [3.0, 0.2, -0.1])
TABLE = RigidTransform.from_components([0.5, -0.2, 0.7], Rotation.from_euler("ZYX", [0.4, 0.1, 0.3]))
BOLTED = RigidTransform.from_components([0.0, 0.01, 0.02], Rotation.from_euler("ZYX", [1.0, 0.5, -0.4]))


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return Arm.from_file(written(tmp_path_factory.mktemp("arm"), "ur5e"))


@pytest.fixture(scope="module")
def run(arm: Arm) -> Recording:
    sweep = TorusSweep(duration_s=120.0, yaw_passes=3, pitch_passes=3)
    swept = replace(scenarios.load("ann-arbor"), maneuver=sweep).with_arm(arm).simulate(seed=4)
    return replace(swept, units={"accelerometer": "m_s2", "magnetometer": "uT"})


def links(arm: Arm, q: np.ndarray) -> list[RigidTransform]:
    """Each link in the one before it, by the arm's own kinematics, (m,) each; the sensor is in the last one."""
    poses = arm.link_poses(q)
    turns = [Rotation.from_matrix(R) for R in np.swapaxes(poses.rotation, 0, 1)]
    own = [RigidTransform.from_components(poses.position[:, j], turn) for j, turn in enumerate(turns)]
    return [own[0], *(one.inv() * two for one, two in pairwise(own))]


def write_bag(
    path: Path,
    arm: Arm,
    run: Recording,
    late_s: float = 0.0,
    joints: bool = False,
    clock_s: float = 0.0,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
) -> Path:
    """A bag as a robot_state_publisher and a second one make it: the last three links sent later by ``late_s``.

    The clock of the transforms' stamps is ahead of the sensors' by ``clock_s``.
    """
    kinds = TYPES.types
    Header, Time = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    Vector, Quaternion = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    Transform, Stamped = kinds["geometry_msgs/msg/Transform"], kinds["geometry_msgs/msg/TransformStamped"]
    Imu, Field, Joints = (kinds[f"sensor_msgs/msg/{name}"] for name in ("Imu", "MagneticField", "JointState"))
    Tf, none = kinds["tf2_msgs/msg/TFMessage"], np.zeros(9)
    assert run.q is not None

    def stamp(t: float) -> int:
        return round((1.7e9 + t) * 1e9)

    def header(t: float, frame: str) -> object:
        return Header(Time(stamp(t) // 10**9, stamp(t) % 10**9), frame)

    def transform(t: float, parent: str, child: str, pose: RigidTransform) -> object:
        turn = Quaternion(*(float(part) for part in pose.rotation.as_quat()))
        return Stamped(header(t, parent), child, Transform(Vector(*map(float, pose.translation)), turn))

    names = [f"{name}_link" for name in UR5E_NAMES]
    parents = ["base_inertia", *names]
    halves = ((0, 1, 2), 0.0), ((3, 4, 5), late_s)
    sent = {shift: links(arm, _at(run, run.t[::2] + shift)) for _, shift in halves}
    last, tip = arm.link_poses(run.q[:1]), arm.poses(run.q[:1])
    wrist = RigidTransform.from_components(last.position[0, 5], Rotation.from_matrix(last.rotation[0, 5]))
    end = wrist.inv() * RigidTransform.from_components(tip.position[0], Rotation.from_matrix(tip.R_base_tool[0]))
    with Writer(path, version=9, storage_plugin=storage) as writer:
        kinds_of = {"/imu": Imu, "/mag": Field, "/tf": Tf, "/tf_static": Tf, "/joint_states": Joints}
        topics = {
            name: writer.add_connection(name, kind.__msgtype__, typestore=TYPES) for name, kind in kinds_of.items()
        }

        def put(topic: str, t: float, message: object) -> None:
            writer.write(topics[topic], stamp(t), TYPES.serialize_cdr(message, topics[topic].msgtype))

        still = RigidTransform.identity()
        turned = RigidTransform.from_components(np.zeros(3), BASE_TURN)
        fixed = [("world", "table", TABLE), ("world", "base_link", still), ("base_link", "base_inertia", turned)]
        fixed += [(names[-1], "tool0", end * BOLTED), ("tool0", "imu_link", BOLTED.inv())]
        put("/tf_static", 0.0, Tf([transform(0.0, *each) for each in fixed]))
        for row, t in enumerate(run.t):
            acceleration = Vector(*map(float, run.accelerometer[row]))
            imu = Imu(header(t, "imu_link"), Quaternion(0, 0, 0, 1), none, Vector(0, 0, 0), none, acceleration, none)
            put("/imu", t, imu)
            put("/mag", t, Field(header(t, "imu_link"), Vector(*map(float, 1e-6 * run.magnetometer[row])), none))
            if row % 2 == 0:
                for moved, shift in halves:
                    poses = [(parents[j], names[j], sent[shift][j][row // 2]) for j in moved]
                    stamped = t + shift + clock_s
                    put("/tf", stamped, Tf([transform(stamped, *each) for each in poses]))
                if joints:
                    own = [f"{name}_joint" for name in UR5E_NAMES]
                    put("/joint_states", t, Joints(header(t, ""), own, run.q[row].copy(), np.zeros(6), np.zeros(6)))
    return path


def _at(run: Recording, t: np.ndarray) -> np.ndarray:
    """Joints between the samples, on straight lines."""
    assert run.q is not None
    return np.stack([np.interp(t, run.t, run.q[:, joint]) for joint in range(6)], axis=1)


def imported(path: Path, arm: Arm | None = None, **conventions: object) -> Imported:
    base = Mapping({}, Conventions(**conventions), Stated(gravity_m_s2=9.8, magnetic_field=1.0))  # type: ignore[arg-type]
    return import_logs([path], None, arm, base)


def turned_off(found: Imported, run: Recording, arm: Arm, base: RigidTransform) -> tuple[float, float]:
    """The largest angle [rad] and distance [m] between the imported poses and the arm's, which is seen from a base."""
    recording = found.recording
    assert recording.tool_quaternion is not None
    assert recording.tool_position is not None
    first = int(np.argmin(np.abs(run.accelerometer - recording.accelerometer[0]).sum(axis=1)))
    poses = arm.poses(run.q[first : first + len(recording)])
    expected = base * RigidTransform.from_components(poses.position, Rotation.from_matrix(poses.R_base_tool))
    own = RigidTransform.from_components(
        recording.tool_position, Rotation.from_quat(recording.tool_quaternion, scalar_first=True)
    )
    off = expected.inv() * own
    return float(off.rotation.magnitude().max()), float(np.linalg.norm(off.translation, axis=1).max())


def bent(run: Recording) -> float:
    """The largest error of joints that are interpolated between every second sample, all joints together [rad].

    A line through points 2 dt apart is off by at most (2 dt)^2 / 8 of the second derivative, half a second difference;
    where the second half is sent in between, the line is drawn between points that lie on lines themselves: as much
    again.
    """
    return float(np.abs(np.diff(run.q, 2, axis=0)).max(axis=0).sum())


@pytest.mark.parametrize("late_s", [0.0, 0.11], ids=["one publisher", "two"])
def test_a_chain_of_transforms_is_the_pose(tmp_path: Path, run: Recording, arm: Arm, late_s: float) -> None:
    path = write_bag(tmp_path / "bag", arm, run, late_s)
    found = imported(path)
    assert any("transforms base_link -> imu_link, 6 of 9 of them moving" in line for line in found.said), found.said
    assert found.recording.metadata.arm == "none"
    assert found.recording.metadata.pose_rate_Hz == pytest.approx(2.0)
    assert len(found.recording) >= len(run) - 2
    angle, distance = turned_off(found, run, arm, RigidTransform.from_components(np.zeros(3), BASE_TURN))
    assert angle < bent(run) + 1e-7  # stamps are rounded to nanoseconds
    assert distance < bent(run) * 1.3 + 1e-7  # the arm's reach [m]


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["bag", "mcap"])
def test_transforms_on_another_clock_are_put_on_the_sensors(
    tmp_path: Path, run: Recording, arm: Arm, storage: StoragePlugin
) -> None:
    """The logs overlap for two thirds: that the clocks are two is seen from what the readings follow alone."""
    path = write_bag(tmp_path / "bag", arm, run, clock_s=40.0, storage=storage)
    found = imported(next(path.glob("*.mcap")) if storage is StoragePlugin.MCAP else path)
    words = next(line for line in found.findings if line.startswith("two clocks: "))
    offset, std = float(words.split()[2]), float(words.split()[4])
    assert abs(offset + 40.0) < 5.0 * std < 0.1, words
    angle, _ = turned_off(found, run, arm, RigidTransform.from_components(np.zeros(3), BASE_TURN))
    fastest = np.abs(np.diff(run.q, axis=0)).max(axis=0).sum() * 4.0
    assert angle < bent(run) + abs(offset + 40.0) * fastest


def test_frames_that_are_asked_for_are_taken_also_across_a_branch(tmp_path: Path, run: Recording, arm: Arm) -> None:
    path = write_bag(tmp_path / "bag", arm, run)
    found = imported(path, base_frame="table", tool_frame="/imu_link")
    seen = TABLE.inv() * RigidTransform.from_components(np.zeros(3), BASE_TURN)
    assert turned_off(found, run, arm, seen)[0] < bent(run) + 1e-7
    with pytest.raises(RigError, match=r"tool_frame: no transform of 'tool1'.*nearest: 'tool0'"):
        imported(path, tool_frame="tool1")


def test_joint_states_are_taken_where_their_arm_is_known(tmp_path: Path, run: Recording, arm: Arm) -> None:
    path = write_bag(tmp_path / "bag", arm, run, joints=True)
    assert imported(path, arm).recording.pose == "joints"
    without = imported(path)
    assert without.recording.pose == "tool"
    assert any("passed over: without --arm" in line for line in without.said)


def test_joints_with_names_are_not_taken_for_the_rigs_own_arm(tmp_path: Path, run: Recording) -> None:
    columns = {"t": run.t, **{f"{name}_joint": run.q[:, j] for j, name in enumerate(UR5E_NAMES)}}
    columns |= {f"accel_{axis}": run.accelerometer[:, k] for k, axis in enumerate("xyz")}
    path = tmp_path / "log.csv"
    rows = [",".join(columns), *(",".join(map(repr, row)) for row in np.column_stack(list(columns.values())).tolist())]
    path.write_text("\n".join(rows))
    mapping = Mapping({"t": "t", **{f"{name}_joint": f"q{j}_rad" for j, name in enumerate(UR5E_NAMES, 1)}})
    mapping.columns.update({f"accel_{axis}": f"accel{k}_m_s2" for k, axis in enumerate("xyz", 1)})
    assert import_logs([path], mapping, None).recording.metadata.arm == "unknown"


def test_a_frame_that_hangs_on_two_parents_is_refused(tmp_path: Path, run: Recording, arm: Arm) -> None:
    from types import SimpleNamespace as Name

    from scenarios.importing.transforms import Transforms

    pose = Name(rotation=Name(w=1.0, x=0.0, y=0.0, z=0.0), translation=Name(x=0.0, y=0.0, z=0.0))
    found = Transforms()
    found.add(Name(header=Name(frame_id="a"), child_frame_id="c", transform=pose), 0, "bag")
    with pytest.raises(RigError, match=r"frame 'c' hangs on 'a' and on 'b': expected one parent"):
        found.add(Name(header=Name(frame_id="b"), child_frame_id="c", transform=pose), 1, "bag")
    assert found.chain(None, None, [], 0, "bag") is None  # nothing moves
    found.add(Name(header=Name(frame_id="y"), child_frame_id="x", transform=pose), 1, "bag")
    with pytest.raises(RigError, match="no chain of transforms from 'x' to 'c'"):
        found.chain("x", "c", [np.arange(3.0)], 0, "bag")


@pytest.mark.parametrize("kind", ["PoseStamped", "TransformStamped"])
def test_the_tools_pose_may_be_a_topic_of_its_own(tmp_path: Path, arm: Arm, run: Recording, kind: str) -> None:
    kinds = TYPES.types
    Header, Time, Imu = (kinds[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", IMU))
    Vector, Quaternion, Point, Pose, Transform, Stamped = (
        kinds[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion", "Point", "Pose", "Transform", kind)
    )
    few = run.select(slice(0, 40))
    poses, none = arm.poses(few.q), np.zeros(9)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topics = {
            name: writer.add_connection(name, of.__msgtype__, typestore=TYPES)
            for name, of in (("/imu", Imu), ("/tool", Stamped))
        }
        for t, reading, turn, place in zip(few.t, few.accelerometer, poses.R_base_tool, poses.position, strict=True):
            at = round((1.7e9 + t) * 1e9)
            header = Header(Time(at // 10**9, at % 10**9), "imu_link")
            turned = Quaternion(*Rotation.from_matrix(turn).as_quat().tolist())
            acceleration, still = Vector(*reading.tolist()), Vector(0, 0, 0)
            imu = Imu(header, Quaternion(0, 0, 0, 1), none, still, none, acceleration, none)
            tool = (
                Stamped(header, Pose(Point(*place.tolist()), turned))
                if kind == "PoseStamped"
                else Stamped(header, "tool", Transform(Vector(*place.tolist()), turned))
            )
            for topic, message in (("/imu", imu), ("/tool", tool)):
                writer.write(topics[topic], at, TYPES.serialize_cdr(message, topics[topic].msgtype))
    found = imported(tmp_path / "bag", None).recording
    np.testing.assert_allclose(found.rotations(None), poses.R_base_tool.reshape(-1, 9), atol=1e-6)
    np.testing.assert_allclose(found.tool_position, poses.position, atol=1e-6)
