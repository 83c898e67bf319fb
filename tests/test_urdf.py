"""An arm from a user's URDF, against yourdfpy's and MuJoCo's own readers.

Poses agree to 1e-12: products of half a dozen rotations in double precision leave about 1e-15, a mistake in sign,
offset or frame leaves 1e-3 or more, a dropped digit 1e-9.
"""

from __future__ import annotations

import logging
from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_files import as_yourdfpy_has_it, random_angles

from rig.arm import Arm
from rig.errors import RigError

ROUNDING = 1e-12


LINKS = "".join(f'<link name="{name}"/>' for name in ("root", "a", "b", "c", "tip", "finger"))


def inertial(mass: float, xyz: str) -> str:
    """A lopsided lump."""
    return (
        f'<inertial><origin xyz="{xyz}" rpy="0.3 -0.2 0.5"/><mass value="{mass}"/>'
        '<inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.002" ixz="-0.003" iyz="0.004"/></inertial>'
    )


ODD = f"""<robot name="odd">
  <link name="root"/><link name="a">{inertial(2.0, "0.1 0 0.2")}</link><link name="b">{inertial(1.0, "0 0.2 0")}</link>
  <link name="c"/><link name="tip">{inertial(0.5, "0 0 0.1")}</link><link name="finger"/><link name="wheel"/>
  <joint name="stand" type="fixed"><parent link="root"/><child link="plate"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/></joint>
  <link name="plate"/>
  <joint name="one" type="revolute"><parent link="plate"/><child link="a"/><origin xyz="0 0 0.2" rpy="0.1 0 0.2"/>
    <axis xyz="1 2 -2"/><limit lower="-1.5" upper="2.5" effort="1" velocity="1"/></joint>
  <joint name="bracket" type="fixed"><parent link="a"/><child link="b"/>
    <origin xyz="0.3 0 0" rpy="0 1.1 0"/></joint>
  <joint name="two" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/></joint>
  <joint name="mount" type="fixed"><parent link="c"/><child link="tip"/>
    <origin xyz="0 0.05 0.1" rpy="-0.7 0.2 3.0"/></joint>
  <joint name="grip" type="prismatic"><parent link="tip"/><child link="finger"/>
    <limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
  <joint name="idle" type="continuous"><parent link="a"/><child link="wheel"/><axis xyz="0 1 0"/></joint>
</robot>"""


def write_urdf(folder: Path, content: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(content)
    return path


def test_the_a465s_urdf_is_the_same_arm(arm: Arm) -> None:
    assert arm.urdf is not None
    read = as_yourdfpy_has_it(Arm.from_urdf(arm.urdf, "imu"), "base")
    q = random_angles(50)
    np.testing.assert_allclose(read.poses(q).R_base_tool, arm.poses(q).R_base_tool, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(read.poses(q).position, arm.poses(q).position, rtol=0, atol=ROUNDING)


def test_urdf_with_fixed_joints_and_skew_axes(tmp_path: Path) -> None:
    arm = as_yourdfpy_has_it(Arm.from_urdf(write_urdf(tmp_path, ODD), "tip"), "root")
    assert (arm.name, arm.joint_names) == ("odd", ("one", "two"))
    np.testing.assert_allclose(arm.lower, [-1.5, -np.inf])
    np.testing.assert_allclose(arm.upper, [2.5, np.inf])
    assert arm.urdf == tmp_path / "arm.urdf"


def test_urdf_tip_may_be_a_moving_link(tmp_path: Path) -> None:
    assert as_yourdfpy_has_it(Arm.from_urdf(write_urdf(tmp_path, ODD), "a"), "root").dof == 1


def test_urdf_masses_load_the_joints_as_in_mujocos_own_reader(tmp_path: Path) -> None:
    """Gravity's torques and the inertia matrix, with the masses of fixed links folded in."""
    content = ODD.replace('type="prismatic"', 'type="fixed"').replace(
        'name="idle" type="continuous"', 'name="idle" type="fixed"'
    )
    path = write_urdf(tmp_path, content)
    arm, reader = Arm.from_urdf(path, "tip"), mujoco.MjModel.from_xml_path(str(path))
    ours, theirs = mujoco.MjData(arm.model), mujoco.MjData(reader)
    inertia = np.zeros((2, 2, 2))
    for angles in random_angles(10, 2):
        for model, data, matrix in ((arm.model, ours, inertia[0]), (reader, theirs, inertia[1])):
            data.qpos[:], data.qvel[:] = angles, [0.3, -0.4]
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, matrix)
        np.testing.assert_allclose(ours.qfrc_bias, theirs.qfrc_bias, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(inertia[0], inertia[1], rtol=0, atol=ROUNDING)


def test_urdf_without_masses_still_moves(tmp_path: Path) -> None:
    joint = '<joint name="one" type="continuous"><parent link="root"/><child link="a"/><axis xyz="0 0 1"/></joint>'
    arm = Arm.from_urdf(write_urdf(tmp_path, f"<robot>{LINKS}{joint}</robot>"), "a")  # nor a name
    assert arm.model.body_mass.sum() < 1e-6
    np.testing.assert_allclose(arm.poses([[np.pi / 2]]).R_base_tool[0] @ [1, 0, 0], [0, 1, 0], atol=ROUNDING)


def joints(*parts: str) -> str:
    """A robot of the links above and the joints given as "name type parent child inside"."""
    text = ""
    for part in parts:
        name, kind, parent, child, inside = part.split(" ", 4)
        text += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'
    return f'<robot name="r">{LINKS}{text}</robot>'


AXIS = '<axis xyz="0 0 1"/>'


@pytest.mark.parametrize(
    ("content", "tip", "message"),
    [
        (ODD, "tipp", r"no link 'tipp': expected one of root, .*\(nearest: 'tip'\)"),
        (ODD, "root", "link 'root' is fixed to the root"),
        (ODD, "plate", "link 'plate' is fixed to the root"),
        (joints(f"j floating root a {AXIS}"), "a", "joint 'j' is of type 'floating'"),
        (joints(f"j bendy root a {AXIS}"), "a", "joint 'j' is of type 'bendy'"),
        (joints(f"k continuous root a {AXIS}", f"j continuous b a {AXIS}"), "a", "link 'a' hangs on 2 joints"),
        (joints(f"k continuous b a {AXIS}", f"j continuous a b {AXIS}"), "a", "form a loop"),
        (joints(f"k continuous nowhere a {AXIS}"), "a", "joint 'k' has parent 'nowhere', which is no link"),
        (joints('k continuous root a <axis xyz="0 0 0"/>'), "a", "axis is .* not all zero"),
        (joints('k continuous root a <axis xyz="0 1"/>'), "a", "axis is .* three numbers"),
        (joints('k continuous root a <axis xyz="nan 0 1"/>'), "a", "axis has a value that is not finite"),
        (joints(f'k continuous root a {AXIS}<origin xyz="inf 0 0"/>'), "a", "origin has a value that is not finite"),
        (joints(f'k revolute root a {AXIS}<limit lower="2" upper="1"/>'), "a", "limits are 2 to 1 rad"),
        (joints(f'k continuous root a {AXIS}<origin xyz="one 0 0"/>'), "a", "not a valid URDF"),
        (joints(f"k continuous root a {AXIS}").replace('<parent link="root"/>', ""), "a", "not a valid URDF"),
        (ODD.replace("</link>", "<visual><geometry><sphere/></geometry></visual></link>"), "tip", "attribute 'radius'"),
        (ODD.replace('<mass value="2.0"/>', '<mass value="-2"/>'), "tip", "link 'a': <inertial> needs a mass"),
        (ODD.replace('ixx="0.03"', 'ixx="-3"'), "tip", "not a valid arm"),
        ("", "tip", "not well-formed XML"),
        ("<robot name='r'><link name='tip'>", "tip", "not well-formed XML"),
        ("<mujoco/>", "tip", "the root element is <mujoco>, expected <robot>"),
    ],
)
def test_urdf_that_is_no_serial_arm_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: str, tip: str, message: str
) -> None:
    path = write_urdf(tmp_path, content)
    with caplog.at_level(logging.WARNING), pytest.raises(RigError, match=message) as caught:
        Arm.from_urdf(path, tip)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert not caplog.records  # the message is all there is to read


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (["root a", "a b", "b c", "c tip", "tip finger", "finger root"], "form a loop"),
        (["root root", "a a", "b b", "c c", "tip tip", "finger finger"], "form a loop"),
        (["root a", "a b", "b c", "c a"], "link 'a' hangs on 2 joints"),
    ],
    ids=["a ring", "each link its own", "a ring at the end of an arm"],
)
def test_a_loop_has_no_end(tmp_path: Path, pairs: list[str], message: str) -> None:
    path = write_urdf(tmp_path, joints(*(f"j{number} continuous {pair} {AXIS}" for number, pair in enumerate(pairs))))
    with pytest.raises(RigError, match=message):
        Arm.from_urdf(path)


def test_a_urdf_without_a_link(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="has no link: expected a tree with one root link"):
        Arm.from_urdf(write_urdf(tmp_path, "<robot name='r'/>"))


def test_missing_urdf(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="no such file"):
        Arm.from_urdf(tmp_path / "none.urdf", "tip")
