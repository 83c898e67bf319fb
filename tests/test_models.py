"""The arm's MJCF against its Denavit-Hartenberg table, the paper's Table 1 and its URDF; the data sheets' form.

Frames are compared to 1e-12: six or seven products of rotations in double precision leave about 1e-15, and a wrong
sign, offset or dropped digit leaves 1e-9 or more.
"""

from __future__ import annotations

import itertools
import math
import tomllib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yourdfpy
from arm_files import A465, A465_OFFSET, IMU_M, dh_frames

from rig.arrays import Array

MODELS = Path(__file__).parents[1] / "models"
ROUNDING = 1e-12

LIMITS_DEG = ((-175, 175), (0, 180), (-110, 110), (-180, 180), (-105, 105))
LINKS = ("link1", "link2", "link3", "link4", "link5", "link6")
JOINTS = ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")
SWEEP_HOME = np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(MODELS / "a465" / "a465.xml"))


@pytest.fixture(scope="module")
def scene() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(MODELS / "a465" / "scene.xml"))


@pytest.fixture(scope="module")
def urdf() -> yourdfpy.URDF:
    return yourdfpy.URDF.load(str(MODELS / "a465" / "a465.urdf"))


def posed(model: mujoco.MjModel, q: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return data


def pose(rotation: Array, position: Array) -> Array:
    """A (4, 4) homogeneous transform."""
    transform = np.eye(4)
    transform[:3, :3] = rotation.reshape(3, 3)
    transform[:3, 3] = position
    return transform


def random_joints(count: int, seed: int) -> Array:
    """(count, 6) joint values [rad] over the whole ranges, joint 6 over several turns."""
    low = np.radians([limit[0] for limit in LIMITS_DEG] + [-1000])
    high = np.radians([limit[1] for limit in LIMITS_DEG] + [1000])
    return np.random.default_rng(seed).uniform(low, high, (count, 6))


def renk_rotation(theta: float, alpha: float) -> Array:
    """Renk (7): the rotation from joint frame i to joint frame i - 1."""
    c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0.0, sa, ca]])


# --- frames ----------------------------------------------------------------------------------------------------------


def test_table_1_of_the_paper_is_the_arm_in_its_sweep(model: mujoco.MjModel) -> None:
    """Renk (7), (8) with Table 1, at theta1 = q1 + 90, theta5 = q5, theta6 = q6 + 180 deg."""
    half_pi = math.pi / 2
    alphas = (half_pi, 0.0, 0.0, half_pi, -half_pi, 0.0)
    thetas = np.random.default_rng(1).uniform(-math.pi, math.pi, (1000, 3))
    data = mujoco.MjData(model)
    worst = 0.0
    for theta1, theta5, theta6 in thetas:
        expected = np.eye(3)
        for theta, alpha in zip((theta1, half_pi, -math.pi, 0.0, theta5, theta6), alphas, strict=True):
            expected = expected @ renk_rotation(theta, alpha)
        data.qpos[:] = SWEEP_HOME
        data.qpos[[0, 4, 5]] = theta1 - half_pi, theta5, theta6 - math.pi
        mujoco.mj_kinematics(model, data)
        worst = max(worst, np.abs(data.body("link6").xmat.reshape(3, 3) - expected).max())
    assert worst < ROUNDING


def test_bodies_are_the_denavit_hartenberg_frames(model: mujoco.MjModel) -> None:
    for q in random_joints(200, seed=2):
        data = posed(model, q)
        frames = dh_frames(A465, q + A465_OFFSET)
        for number, (link, frame) in enumerate(zip(LINKS, frames, strict=True), start=1):
            body = data.body(link)
            # link2 stays on the axis of joint 2: a_2 short of frame 2 along x2
            origin = frame[:3, 3] - (A465[1][0] * frame[:3, 0] if number == 2 else 0.0)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), frame[:3, :3], rtol=0, atol=ROUNDING)
            np.testing.assert_allclose(body.xpos, origin, rtol=0, atol=ROUNDING)
        site = data.site("imu")
        np.testing.assert_allclose(site.xmat.reshape(3, 3), frames[5][:3, :3], rtol=0, atol=ROUNDING)
        expected = frames[5][:3, 3] + IMU_M * frames[5][:3, 2]
        np.testing.assert_allclose(site.xpos, expected, rtol=0, atol=ROUNDING)


def test_upper_arm_up_and_forearm_forward_at_sweep_home(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("sweep_home").id)
    np.testing.assert_array_equal(data.qpos, SWEEP_HOME)
    np.testing.assert_array_equal(data.ctrl, SWEEP_HOME)
    mujoco.mj_kinematics(model, data)
    shoulder, elbow, wrist = (data.body(name).xpos for name in ("link2", "link3", "link4"))
    np.testing.assert_allclose(shoulder, [0.0, 0.0, 0.3302], atol=ROUNDING)
    np.testing.assert_allclose(elbow - shoulder, [0.0, 0.0, 0.3048], atol=ROUNDING)
    np.testing.assert_allclose(wrist - elbow, [0.3302, 0.0, 0.0], atol=ROUNDING)
    np.testing.assert_allclose(data.site("imu").xpos - wrist, [0.0762 + 0.030, 0.0, 0.0], atol=ROUNDING)


def test_straight_up_at_q2_90_q3_0(model: mujoco.MjModel) -> None:
    data = posed(model, np.radians([0.0, 90.0, 0.0, 0.0, 0.0, 0.0]))
    height = sum(a + d for a, d, _ in A465) + IMU_M
    np.testing.assert_allclose(data.site("imu").xpos, [0.0, 0.0, height], atol=ROUNDING)


def test_limits(model: mujoco.MjModel) -> None:
    for name, limit in zip(JOINTS, LIMITS_DEG, strict=False):
        assert model.joint(name).limited[0] == 1
        np.testing.assert_allclose(np.degrees(model.joint(name).range), limit, rtol=1e-15)
        np.testing.assert_array_equal(model.actuator(name).ctrlrange, model.joint(name).range)
        assert model.actuator(name).ctrllimited[0] == 1
    assert model.joint("joint6").limited[0] == 0  # rolls on, as in the paper
    assert model.actuator("joint6").ctrllimited[0] == 0
    np.testing.assert_array_equal(model.numeric("joint6_range_deg").data, [-180, 180])


# --- URDF against MJCF -----------------------------------------------------------------------------------------------


def test_urdf_has_the_same_poses(model: mujoco.MjModel, urdf: yourdfpy.URDF) -> None:
    assert tuple(urdf.actuated_joint_names) == JOINTS
    for q in random_joints(200, seed=3):
        data = posed(model, q)
        urdf.update_cfg(q)
        for link in LINKS:
            body = data.body(link)
            found = urdf.get_transform(link, "base")
            np.testing.assert_allclose(found, pose(body.xmat, body.xpos), rtol=0, atol=ROUNDING)
        site = data.site("imu")
        np.testing.assert_allclose(urdf.get_transform("imu", "base"), pose(site.xmat, site.xpos), rtol=0, atol=ROUNDING)


def test_urdf_has_the_same_joints(model: mujoco.MjModel, urdf: yourdfpy.URDF) -> None:
    speed = np.radians(model.numeric("joint_speed_limit_deg_s").data)
    for index, name in enumerate(JOINTS):
        joint, limit = urdf.joint_map[name], urdf.joint_map[name].limit
        assert joint.type == ("revolute" if model.jnt_limited[index] else "continuous")
        if model.jnt_limited[index]:
            np.testing.assert_allclose([limit.lower, limit.upper], model.jnt_range[index], rtol=1e-15)
        np.testing.assert_array_equal([-limit.effort, limit.effort], model.actuator(name).forcerange)
        np.testing.assert_allclose(limit.velocity, speed[index], rtol=1e-15)
        assert float(joint.dynamics.damping) == model.joint(name).damping[0]  # yourdfpy leaves it a string


@pytest.mark.parametrize("link", ["base", *LINKS])
def test_urdf_has_the_same_mass_and_inertia(model: mujoco.MjModel, urdf: yourdfpy.URDF, link: str) -> None:
    body, inertial = model.body(link), urdf.link_map[link].inertial
    assert inertial.mass == body.mass[0]
    np.testing.assert_array_equal(inertial.origin, pose(np.eye(3), body.ipos))
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    principal = rotation.reshape(3, 3)
    np.testing.assert_allclose(principal @ np.diag(body.inertia) @ principal.T, inertial.inertia, rtol=1e-14)


@pytest.mark.parametrize("link", ["base", *LINKS])
def test_urdf_has_the_same_shapes_and_colours(model: mujoco.MjModel, urdf: yourdfpy.URDF, link: str) -> None:
    visuals = {visual.name: visual for visual in urdf.link_map[link].visuals}
    colours = {material.name: material.color.rgba for material in urdf.robot.materials}
    body = model.body(link)
    geoms = [model.geom(index) for index in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0])]
    assert [geom.name for geom in geoms] == list(visuals)
    for geom in geoms:
        visual = visuals[geom.name]
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, geom.quat)
        origin = np.eye(4) if visual.origin is None else visual.origin
        np.testing.assert_allclose(origin, pose(rotation, geom.pos), rtol=0, atol=1e-14, err_msg=geom.name)
        if geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX:
            np.testing.assert_allclose(visual.geometry.box.size, 2 * geom.size, rtol=1e-14, err_msg=geom.name)
        else:
            assert geom.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER, geom.name
            cylinder = visual.geometry.cylinder
            found = [cylinder.radius, cylinder.length]
            np.testing.assert_allclose(found, [geom.size[0], 2 * geom.size[1]], rtol=1e-14, err_msg=geom.name)
        material = model.mat(geom.matid[0])
        assert visual.material.name == material.name
        # MuJoCo keeps colours in single precision
        np.testing.assert_allclose(colours[material.name], material.rgba, rtol=1e-6)


def test_rerun_loads_the_urdf_with_every_shape(model: mujoco.MjModel) -> None:
    """Its transforms are single precision: 1e-6."""
    rerun = pytest.importorskip("rerun", reason="the viewer's library is not installed")
    tree = rerun.urdf.UrdfTree.from_file_path(MODELS / "a465" / "a465.urdf")
    assert tree.root_link().name == "base"
    shown = sum(len(tree.get_visual_geometry_paths(link)) for link in ("base", *LINKS))
    assert shown == model.ngeom
    # a continuous joint must not be clamped: 1,000 deg is -80 deg
    transform = tree.get_joint_by_name("joint6").compute_transform(math.radians(1000))
    quaternion = np.asarray(transform.quaternion.as_arrow_array().to_pylist()[0])
    half = math.radians(-40)
    assert abs(quaternion @ [0.0, 0.0, math.sin(half), math.cos(half)]) == pytest.approx(1, abs=1e-6)


# --- the scene -------------------------------------------------------------------------------------------------------


def drive_at_14_degrees_a_second(scene: mujoco.MjModel, seconds: float) -> tuple[mujoco.MjData, Array]:
    """All joints at once, 0.2 s of acceleration first; the data and the largest tracking error of each joint [rad].

    14 deg/s is the sweep's fastest joint (the roll, 13.9).
    """
    data = mujoco.MjData(scene)
    mujoco.mj_resetDataKeyframe(scene, data, scene.key("sweep_home").id)
    direction = np.array([1, -1, 1, 1, 1, 1]) * math.radians(14)
    worst = np.zeros(6)
    for _ in range(round(seconds / scene.opt.timestep)):
        time = data.time
        data.ctrl[:] = SWEEP_HOME + direction * (time**2 / 0.4 if time < 0.2 else time - 0.1)
        worst = np.maximum(worst, np.abs(data.qpos - data.ctrl))
        mujoco.mj_step(scene, data)
    return data, worst


def test_scene_steps_a_second_without_a_warning_and_tracks(scene: mujoco.MjModel) -> None:
    """MuJoCo's own warnings are counted in mjData, not raised.  0.05 deg: README's 0.040 and 0.005 deg of droop."""
    data, worst = drive_at_14_degrees_a_second(scene, seconds=1.0)
    assert [warning.number for warning in data.warning] == [0] * len(data.warning)
    assert data.time == pytest.approx(1.0)
    assert np.degrees(worst).max() < 0.05
    assert np.degrees(worst).min() > 0.03  # the lag is there: README's (kv + damping) v / kp, not a joint that is glued


def test_held_arm_comes_to_rest_with_little_droop(scene: mujoco.MjModel) -> None:
    data = mujoco.MjData(scene)
    mujoco.mj_resetDataKeyframe(scene, data, scene.key("sweep_home").id)
    mujoco.mj_step(scene, data, nstep=2000)
    # the sagging pose is an equilibrium: what is left of the start is below 1e-9 rad/s, far below any sensor's noise
    assert np.abs(data.qvel).max() < 1e-9
    assert np.degrees(np.abs(data.qpos - SWEEP_HOME)).max() < 0.005


def test_sensors_have_the_stated_signs(scene: mujoco.MjModel) -> None:
    """At rest R^T (a - g) and R^T B, with the paper's g = 9.8 m/s^2 and |B| = 1; phi, psi of Table 10 in (12)."""
    phi, psi = math.radians(59.4127), math.radians(81.402)
    field = np.array([math.cos(psi) * math.cos(phi), math.sin(psi) * math.cos(phi), -math.sin(phi)])
    np.testing.assert_allclose(scene.opt.magnetic, field, atol=1e-15)
    np.testing.assert_array_equal(scene.opt.gravity, [0, 0, -9.8])
    assert (scene.opt.timestep, scene.opt.integrator) == (0.001, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    data = mujoco.MjData(scene)
    for q in random_joints(20, seed=4):
        data.qpos[:] = q
        mujoco.mj_inverse(scene, data)  # qvel = qacc = 0
        rotation = data.body("link6").xmat.reshape(3, 3)
        accelerometer, gyro, magnetometer = (
            data.sensor(f"imu_{kind}").data for kind in ("accelerometer", "gyro", "magnetometer")
        )
        np.testing.assert_allclose(accelerometer, -rotation.T @ scene.opt.gravity, atol=9.8 * ROUNDING)
        np.testing.assert_allclose(magnetometer, rotation.T @ field, atol=ROUNDING)
        np.testing.assert_array_equal(gyro, 0.0)


def test_nothing_collides_and_nothing_touches_in_the_sweep(scene: mujoco.MjModel) -> None:
    """No geometry takes part in contact; links that are not neighbours stay 5 mm apart, and clear of the table."""
    assert not scene.geom_contype.any()
    assert not scene.geom_conaffinity.any()
    bodies = ("base", *LINKS)
    geoms = [range(b.geomadr[0], b.geomadr[0] + b.geomnum[0]) for b in map(scene.body, bodies)]
    pairs = [
        pair
        for (i, first), (j, second) in itertools.combinations(enumerate(geoms), 2)
        if j - i >= 2
        for pair in itertools.product(first, second)
    ]
    data = mujoco.MjData(scene)
    fromto = np.zeros(6)
    reach = 0.005
    for q1, q5, q6 in itertools.product((-170, -60, 50, 170), (-105, -60, 0, 45, 105), (0, 60, 120)):
        data.qpos[:] = SWEEP_HOME
        data.qpos[[0, 4, 5]] = np.radians([q1, q5, q6])
        mujoco.mj_kinematics(scene, data)
        for first, second in pairs:
            apart = np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second])
            if apart > scene.geom_rbound[first] + scene.geom_rbound[second] + reach:
                continue
            distance = mujoco.mj_geomDistance(scene, data, first, second, reach, fromto)
            assert distance >= reach, f"{scene.geom(first).name} and {scene.geom(second).name} at {(q1, q5, q6)}"
        lowest = min((data.geom_xpos[g] - scene.geom_rbound[g])[2] for link in geoms[2:] for g in link)
        assert lowest > 0.1


@pytest.mark.parametrize("camera", ["overview", "side"])
def test_camera_looks_at_the_arm(scene: mujoco.MjModel, camera: str) -> None:
    """The sensor and the base are inside the picture (4:3) over the whole sweep."""
    data = mujoco.MjData(scene)
    half_height = math.tan(math.radians(scene.camera(camera).fovy[0]) / 2)
    for q1, q5 in itertools.product((-170, -85, 0, 85, 170), (-90, 0, 90)):
        data.qpos[:] = SWEEP_HOME
        data.qpos[[0, 4]] = np.radians([q1, q5])
        mujoco.mj_kinematics(scene, data)
        mujoco.mj_camlight(scene, data)
        view = data.camera(camera)
        for point in (data.site("imu").xpos, data.body("base").xpos):
            x, y, z = view.xmat.reshape(3, 3).T @ (point - view.xpos)
            assert z < 0  # a camera looks along its own -z
            assert abs(y / z) < half_height
            assert abs(x / z) < half_height * 4 / 3


# --- data sheets -----------------------------------------------------------------------------------------------------

SHEETS = sorted((MODELS / "sensors").glob("*.toml"))


def sheet(name: str) -> dict[str, Any]:
    return tomllib.loads((MODELS / "sensors" / f"{name}.toml").read_text(encoding="utf-8"))


def test_the_data_sheets_are_there() -> None:
    assert {path.stem for path in SHEETS} >= {"3dm", "adxl330", "hmc2003", "q8"}


@pytest.mark.parametrize("path", SHEETS, ids=lambda path: path.stem)
def test_every_number_of_a_data_sheet_has_unit_tag_and_source(path: Path) -> None:
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    about = content.pop("sensor")
    assert set(about) == {"name", "maker", "kind"}
    assert set(content) == set(about["kind"]) <= {"accelerometer", "magnetometer", "acquisition"}
    for kind, quantities in content.items():
        assert quantities, kind
        for name, quantity in quantities.items():
            assert set(quantity) == {"value", "unit", "tag", "source"}, name
            values = quantity["value"] if isinstance(quantity["value"], list) else [quantity["value"]]
            assert len(values) in (1, 3), name
            assert all(type(value) in (int, float) and math.isfinite(value) for value in values), name
            assert quantity["tag"] in ("S", "D", "G"), name
            for text in (quantity["unit"], quantity["source"]):
                assert isinstance(text, str), name
                assert text.strip(), name
            assert ("recalled" in quantity["source"]) <= (quantity["tag"] == "G"), name


def test_derived_numbers_follow_from_the_stated_ones() -> None:
    for kind in ("accelerometer", "magnetometer"):
        quantities = {name: np.asarray(entry["value"]) for name, entry in sheet("3dm")[kind].items()}
        span = quantities["output_high"] - quantities["output_low"]
        decibels = 20 * np.log10(span / (quantities["noise_rms"] * 1e-3))
        np.testing.assert_allclose(decibels, quantities["dynamic_range"], rtol=0, atol=0.05)  # printed to 0.1 dB
        assert quantities["nominal_offset"] == (quantities["output_high"] + quantities["output_low"]) / 2
        if "full_scale" in quantities:
            assert quantities["nominal_sensitivity"] == span / (2 * quantities["full_scale"])
    board = {name: entry["value"] for name, entry in sheet("q8")["acquisition"].items()}
    assert board["step"] == 1e3 * 2 * board["range"] / 2 ** board["resolution"]
