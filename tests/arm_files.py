"""Arms as URDF text, from the Denavit-Hartenberg numbers that their makers publish."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yourdfpy

from rig.arm import Arm
from rig.arrays import Array

PI = np.pi
ROUNDING = 1e-12

#: The A465, models/a465/README.md, table "Kinematics": a [m], d [m], alpha [rad]; what is added to the joints' angles.
A465 = [
    (0.0, 0.3302, PI / 2),
    (0.3048, 0.0, 0.0),
    (0.0, 0.0, PI / 2),
    (0.0, 0.3302, -PI / 2),
    (0.0, 0.0, PI / 2),
    (0.0, 0.0762, 0.0),
]
A465_OFFSET = np.array([0.0, 0.0, PI / 2, 0.0, 0.0, 0.0])
IMU_M = 0.030  # along z6

#: Universal Robots, "DH parameters for calculations of kinematics and dynamics": a [m], d [m], alpha [rad].
UR5E = [
    (0.0, 0.1625, PI / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, PI / 2),
    (0.0, 0.0997, -PI / 2),
    (0.0, 0.0996, 0.0),
]
UR5E_NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
UR5E_LIMITS = [(-2 * PI, 2 * PI)] * 2 + [(-PI, PI)] + [(-2 * PI, 2 * PI)] * 3
#: KUKA LBR iiwa 14 R820, data sheet: seven hinges, each at right angles to the next; limits 170 and 120 deg by turns.
IIWA = [
    (0.0, 0.36, -PI / 2),
    (0.0, 0.0, PI / 2),
    (0.0, 0.42, PI / 2),
    (0.0, 0.0, -PI / 2),
    (0.0, 0.4, -PI / 2),
    (0.0, 0.0, PI / 2),
    (0.0, 0.126, 0.0),
]
IIWA_LIMITS = [tuple(np.radians([-limit, limit])) for limit in (170, 120, 170, 120, 170, 120, 175)]
#: Franka Research "DH parameters" are Craig's: here the same chain with a, d, alpha of the standard convention.
PANDA = [
    (0.0, 0.333, -PI / 2),
    (0.0, 0.0, PI / 2),
    (0.0825, 0.316, PI / 2),
    (-0.0825, 0.0, -PI / 2),
    (0.0, 0.384, PI / 2),
    (0.088, 0.0, PI / 2),
    (0.0, 0.107, 0.0),
]
PANDA_LIMITS = [
    (-2.8973, 2.8973),
    (-1.7628, 1.7628),
    (-2.8973, 2.8973),
    (-3.0718, -0.0698),
    (-2.8973, 2.8973),
    (-0.0175, 3.7525),
    (-2.8973, 2.8973),
]


def random_angles(count: int, joints: int = 6, seed: int = 1, reach: float = 3.0) -> Array:
    """(count, joints) [rad], evenly within ``reach`` of zero."""
    return np.random.default_rng(seed).uniform(-reach, reach, (count, joints))


def dh_frames(table: list[tuple[float, float, float]], q: Array) -> list[Array]:
    """(4, 4) of each frame in the base, by the product of the standard convention's matrices."""
    poses = [np.eye(4)]
    for (a, d, alpha), angle in zip(table, q, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        poses.append(
            poses[-1]
            @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1.0]])
        )
    return poses[1:]


def as_yourdfpy_has_it(arm: Arm, base: str, q: Array | None = None) -> Arm:
    """An arm whose poses (n, N) [rad, m] are those of another program, which reads its URDF too."""
    oracle = yourdfpy.URDF.load(str(arm.urdf), load_meshes=False)
    q = random_angles(100, arm.dof) if q is None else q
    poses, rotations = arm.poses(q), arm.rotation_map.rotations(q).reshape(-1, 3, 3)
    for row, angles in enumerate(q):
        oracle.update_cfg(dict(zip(arm.joint_names, angles.tolist(), strict=True)))
        expected = oracle.get_transform(arm.tip, base)
        np.testing.assert_allclose(poses.R_base_tool[row], expected[:3, :3], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(rotations[row], expected[:3, :3], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(poses.position[row], expected[:3, 3], rtol=0, atol=ROUNDING)
    return arm


def dh_urdf(
    name: str,
    table: list[tuple[float, float, float]],
    limits: list[tuple[float, float]],
    joints: tuple[str, ...] = (),
    speed: float = 3.0,
) -> str:
    """A URDF of hinges about z; frame j of the convention is where joint j + 1 sits, the last one is ``tool0``."""
    joints = joints or tuple(f"{name}_joint{number}" for number in range(1, len(table) + 1))
    text, origin = '<link name="base_link"/>', ""
    parent = "base_link"
    for number, (joint, (low, high), (a, d, alpha)) in enumerate(zip(joints, limits, table, strict=True), start=1):
        text += f"""<link name="link_{number}"><inertial><mass value="{3.0 / number:.3f}"/>
          <origin xyz="{a / 2} 0 {d / 2}"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
          </inertial></link>
        <joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="link_{number}"/>{origin}
          <axis xyz="0 0 1"/><limit lower="{low}" upper="{high}" velocity="{speed}" effort="100"/></joint>"""
        parent, origin = f"link_{number}", f'<origin xyz="{a} 0 {d}" rpy="{alpha} 0 0"/>'
    flange = f'<joint name="flange" type="fixed"><parent link="{parent}"/><child link="tool0"/>{origin}</joint>'
    return f'<robot name="{name}">{text}<link name="tool0"/>{flange}</robot>'


TEXTS = {
    "ur5e": dh_urdf("ur5e", UR5E, UR5E_LIMITS, tuple(f"{name}_joint" for name in UR5E_NAMES)),
    "panda": dh_urdf("panda", PANDA, PANDA_LIMITS),
    "iiwa": dh_urdf("iiwa", IIWA, IIWA_LIMITS),
}

#: Three upright hinges and a quill that slides: gravity never turns in its tool.
SCARA = """<robot name="scara"><link name="base_link"/><link name="l1"/>
 <link name="l2"/><link name="l3"/><link name="tool0"/>
 <joint name="shoulder" type="revolute"><parent link="base_link"/><child link="l1"/><origin xyz="0 0 0.3"/>
  <axis xyz="0 0 1"/><limit lower="-2.3" upper="2.3" velocity="4" effort="1"/></joint>
 <joint name="elbow" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.25 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-2.5" upper="2.5" velocity="4" effort="1"/></joint>
 <joint name="quill" type="prismatic"><parent link="l2"/><child link="l3"/><origin xyz="0.2 0 0"/><axis xyz="0 0 -1"/>
  <limit lower="0" upper="0.15" velocity="1" effort="1"/></joint>
 <joint name="spin" type="revolute"><parent link="l3"/><child link="tool0"/><axis xyz="0 0 1"/>
  <limit lower="-6" upper="6" velocity="8" effort="1"/></joint></robot>"""


def written(folder: Path, name: str) -> Path:
    """The URDF of one of the arms in a folder."""
    path = folder / f"{name}.urdf"
    path.write_text(SCARA if name == "scara" else TEXTS[name])
    return path
