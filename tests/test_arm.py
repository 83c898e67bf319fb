"""The arm: poses, accelerations and limits; arms from MJCF.

Poses agree to 1e-12: products of half a dozen rotations in double precision leave about 1e-15, a mistake in sign,
offset or frame leaves 1e-3 or more, a dropped digit 1e-9.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_files import A465, A465_OFFSET, IMU_M, dh_frames, random_angles

from rig.arm import Arm
from rig.arrays import Array
from rig.assets import model_path
from rig.errors import RigError

ROUNDING = 1e-12


def smooth_motion(t: Array, joints: int = 6) -> tuple[Array, Array, Array]:
    """All joints swinging, each at its own frequency: q, qd, qdd (n, N)."""
    rate = np.linspace(1.0, 2.5, joints)
    phase = rate * t[:, None] + np.arange(joints)
    return np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)


# --- the A465 --------------------------------------------------------------------------------------------------------


def test_a465_is_the_denavit_hartenberg_chain(arm: Arm) -> None:
    q = random_angles(200)
    poses = arm.poses(q)
    for angles, rotation, position in zip(q, poses.R_base_tool, poses.position, strict=True):
        last = dh_frames(A465, angles + A465_OFFSET)[-1]
        np.testing.assert_allclose(rotation, last[:3, :3], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(position, last[:3, 3] + IMU_M * last[:3, 2], rtol=0, atol=ROUNDING)


def test_a465_names_limits_and_identity(arm: Arm) -> None:
    assert (arm.name, arm.dof, arm.site) == ("a465", 6, "imu")
    assert arm.joint_names == tuple(f"joint{number}" for number in range(1, 7))
    np.testing.assert_allclose(np.degrees(arm.lower), [-175, 0, -110, -180, -105, -np.inf])
    np.testing.assert_allclose(np.degrees(arm.upper), [175, 180, 110, 180, 105, np.inf])
    np.testing.assert_allclose(arm.roll_range, np.radians(arm.model.numeric("joint6_range_deg").data))
    assert arm.urdf is not None
    assert arm.urdf.is_file()
    assert Arm.a465() is arm


def test_many_configurations_equal_one_at_a_time(arm: Arm) -> None:
    """Blocks, threads and the ragged last block change nothing, not even the last bit."""
    q = random_angles(9001)
    poses, links = arm.poses(q), arm.link_poses(q)
    for row in (0, 4095, 4096, 8191, 8192, 9000):
        one, one_links = arm.poses(q[row]), arm.link_poses(q[row])
        np.testing.assert_array_equal(poses.R_base_tool[row], one.R_base_tool[0])
        np.testing.assert_array_equal(poses.position[row], one.position[0])
        np.testing.assert_array_equal(links.rotation[row], one_links.rotation[0])
        np.testing.assert_array_equal(links.position[row], one_links.position[0])
    assert arm.poses(np.empty((0, 6))).R_base_tool.shape == (0, 3, 3)


def test_link_poses_are_the_full_models_bodies(arm: Arm) -> None:
    q = random_angles(20)
    links = arm.link_poses(q)
    data = mujoco.MjData(arm.model)
    for row, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_kinematics(arm.model, data)
        for number in range(6):
            body = data.body(f"link{number + 1}")
            np.testing.assert_allclose(links.rotation[row, number].ravel(), body.xmat, rtol=0, atol=ROUNDING)
            np.testing.assert_allclose(links.position[row, number], body.xpos, rtol=0, atol=ROUNDING)


def test_link_maps_are_the_links_rotations(arm: Arm) -> None:
    q = random_angles(50)
    links = arm.link_poses(q)
    for link, turned in enumerate(arm.link_maps):
        rotation = turned.rotations(q).reshape(-1, 3, 3)
        np.testing.assert_allclose(rotation, links.rotation[:, link], rtol=0, atol=ROUNDING)


def test_poses_are_in_the_base_frame_wherever_the_base_stands(arm: Arm, tmp_path: Path) -> None:
    moved = moved_base(tmp_path, quaternion=(0.5, 0.5, -0.5, 0.5), position=(1.0, -2.0, 3.0))
    q = random_angles(50)
    np.testing.assert_allclose(moved.poses(q).R_base_tool, arm.poses(q).R_base_tool, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(moved.poses(q).position, arm.poses(q).position, rtol=0, atol=ROUNDING)
    qs, qd, qdd = smooth_motion(np.linspace(0, 1, 20))
    np.testing.assert_allclose(
        moved.site_acceleration(qs, qd, qdd), arm.site_acceleration(qs, qd, qdd), rtol=0, atol=1e-10
    )


def moved_base(folder: Path, quaternion: tuple[float, ...], position: tuple[float, ...]) -> Arm:
    """The A465 with its base turned and shifted in the world."""
    spec = mujoco.MjSpec.from_file(str(model_path("a465/a465.xml")))
    spec.body("base").quat, spec.body("base").pos = quaternion, position
    spec.compile()
    path = folder / "moved.xml"
    path.write_text(spec.to_xml())
    return Arm.from_mjcf(path)


# --- acceleration ----------------------------------------------------------------------------------------------------


def test_acceleration_is_the_second_difference_of_the_path(arm: Arm) -> None:
    """Central differences are off by h^2/12 times the fourth derivative: half the step, a quarter of the error.

    At h = 4 ms the truncation is about 1e-4 m/s^2 and the rounding about 4e-16/h^2 = 3e-11; the next term of the series
    changes the quarter by a share of h^2 rate^2/30, under 1e-4 with room for the products of six rates.
    """
    t = np.linspace(0.0, 5.0, 40)
    exact = arm.site_acceleration(*smooth_motion(t))
    errors = []
    for h in (4e-3, 2e-3):
        before, here, after = (arm.poses(smooth_motion(t + shift)[0]).position for shift in (-h, 0.0, h))
        errors.append((after - 2 * here + before) / h**2 - exact)
    assert np.abs(errors[0]).max() < 1e-3  # of accelerations of some m/s^2
    assert np.abs(exact).max() > 2
    assert np.linalg.norm(errors[0]) / np.linalg.norm(errors[1]) == pytest.approx(4.0, rel=1e-2)
    richardson = (4 * errors[1] - errors[0]) / 3
    assert np.abs(richardson).max() < 1e-3 * np.abs(errors[0]).max()


def test_acceleration_is_what_the_models_accelerometer_feels_less_gravity(arm: Arm) -> None:
    """MuJoCo's accelerometer reads R'(a - g) in the tool frame."""
    q, qd, qdd = smooth_motion(np.linspace(0, 3, 15))
    acceleration, rotation = arm.site_acceleration(q, qd, qdd), arm.poses(q).R_base_tool
    data = mujoco.MjData(arm.model)
    for row in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(arm.model, data)
        felt = rotation[row].T @ (acceleration[row] - arm.model.opt.gravity)
        np.testing.assert_allclose(data.sensor("imu_accelerometer").data, felt, rtol=0, atol=1e-11)


def test_acceleration_of_many_equals_one_at_a_time(arm: Arm) -> None:
    motion = smooth_motion(np.linspace(0, 50, 5001))
    many = arm.site_acceleration(*motion)
    for row in (0, 2500, 2501, 5000):
        np.testing.assert_array_equal(many[row], arm.site_acceleration(*(values[row] for values in motion))[0])


def test_a_circle_at_constant_speed(arm: Arm) -> None:
    """Joint 1 alone: centripetal acceleration r w^2 towards the axis."""
    q = np.radians([[30.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    w = 0.7
    acceleration = arm.site_acceleration(q, [[w, 0, 0, 0, 0, 0]], np.zeros((1, 6)))[0]
    expected = -(w**2) * arm.poses(q).position[0] * [1, 1, 0]
    np.testing.assert_allclose(acceleration, expected, rtol=0, atol=ROUNDING)


# --- limits and shapes -----------------------------------------------------------------------------------------------


def test_limits_are_inclusive_and_the_last_joint_rolls_on(arm: Arm) -> None:
    q = np.radians([[175.0, 180.0, -110.0, 180.0, -105.0, 23000.0], [-175.0, 0.0, 110.0, -180.0, 105.0, -23000.0]])
    arm.check_limits(q, "edge")


def test_a_joint_beyond_its_limit_is_named(arm: Arm) -> None:
    q = np.zeros((9, 6))
    q[4:, 1] = np.radians(-3.0)
    with pytest.raises(RigError, match=r"^run: joint2 is at -3 deg in sample 4, expected 0 to 180 deg$"):
        arm.check_limits(q, "run")


def test_wrong_shapes_are_refused(arm: Arm) -> None:
    with pytest.raises(RigError, match=r"shape \(2, 5\), expected \(n, 6\)"):
        arm.poses(np.zeros((2, 5)))
    with pytest.raises(RigError, match="differ in shape"):
        arm.site_acceleration(np.zeros((2, 6)), np.zeros((2, 6)), np.zeros((3, 6)))


# --- MJCF ------------------------------------------------------------------------------------------------------------

HINGE = '<joint type="hinge" name="a" axis="0 0 1"/><geom size="0.1"/>'


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<body><joint type="ball" name="b"/><geom size="0.1"/>{site}</body>', "'b' is of type ball: expected hinge"),
        ('<body><freejoint name="f"/><geom size="0.1"/>{site}</body>', "'f' is of type free: expected hinge"),
        ("<body>{site}</body>", "the site is fixed to the base"),
        (f'<body>{HINGE}<site name="imuu"/></body>', r"no site 'imu': expected one of imuu \(nearest: 'imuu'\)"),
        (f"<body>{HINGE}</body>", r"no site 'imu': expected one of \(none\)"),
    ],
)
def test_mjcf_that_is_no_serial_arm_is_refused(tmp_path: Path, body: str, message: str) -> None:
    path = tmp_path / "arm.xml"
    body = body.format(site='<site name="imu"/>')
    path.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(RigError, match=message):
        Arm.from_mjcf(path)


@pytest.mark.parametrize("content", ["", "<mujoco><worldbody>", "<mujoco><nonsense/></mujoco>"])
def test_broken_mjcf_is_one_line(tmp_path: Path, content: str) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(content)
    with pytest.raises(RigError, match="not a valid MJCF model") as caught:
        Arm.from_mjcf(path)
    assert "\n" not in str(caught.value)


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body quat="1 0 inf 0"><joint name="j" axis="0 0 1"/><geom size="1"/><site name="imu"/>'
        "</body></worldbody></mujoco>"
    )
    with pytest.raises(RigError, match=r"body quat holds a number that is not finite|not a valid MJCF model"):
        Arm.from_mjcf(path)


def test_missing_mjcf(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="no such file"):
        Arm.from_mjcf(tmp_path / "none.xml")


def test_mjcf_with_reference_angles_fixed_bodies_and_offset_axes(tmp_path: Path) -> None:
    """Everything a chain may have, against MuJoCo's kinematics of the model itself."""
    path = tmp_path / "arm.xml"
    path.write_text(
        """<mujoco model="odd"><compiler angle="radian"/><worldbody>
        <body pos="1 2 3" euler="0.1 0.2 0.3"><geom size="0.1"/>
          <body pos="0 0 0.5" euler="0.3 0 0"><joint name="a" axis="0 1 1" pos="0.1 0 0" ref="0.4" range="-2 2"/>
            <geom size="0.1"/>
            <body pos="0.2 0 0.1" euler="0 0.5 0"><geom size="0.1"/>
              <body pos="0 0.3 0"><joint name="b" axis="1 0.2 0"/><geom size="0.1"/>
                <body pos="0 0 0.1" euler="1 0 0"><site name="imu" pos="0.1 0.2 0" euler="0 0 1"/></body>
              </body></body></body></body>
        </worldbody></mujoco>"""
    )
    arm = Arm.from_mjcf(path)
    assert (arm.name, arm.joint_names) == ("odd", ("a", "b"))
    np.testing.assert_array_equal(arm.lower, [-2, -np.inf])
    q = random_angles(30, 2)
    poses, data = arm.poses(q), mujoco.MjData(arm.model)
    for row, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_kinematics(arm.model, data)
        base = data.xmat[1].reshape(3, 3)
        expected = base.T @ data.site("imu").xmat.reshape(3, 3)
        np.testing.assert_allclose(poses.R_base_tool[row], expected, rtol=0, atol=ROUNDING)
        expected = base.T @ (data.site("imu").xpos - data.xpos[1])
        np.testing.assert_allclose(poses.position[row], expected, rtol=0, atol=ROUNDING)
        rotation = arm.rotation_map.rotations(angles[None]).reshape(3, 3)
        np.testing.assert_allclose(rotation, poses.R_base_tool[row], rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("method", ["poses", "link_poses"])
def test_results_are_the_callers_own(arm: Arm, method: str) -> None:
    """Blocks are computed in buffers that are used again; a result must not change when another is asked for."""
    evaluate: Callable[[Array], object] = getattr(arm, method)
    q = random_angles(3)
    first = vars(evaluate(q))
    kept = {name: values.copy() for name, values in first.items()}
    evaluate(q + 1)
    for name, values in kept.items():
        np.testing.assert_array_equal(first[name], values)
