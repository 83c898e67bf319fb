"""Arms of the user's own: from the file to a calibration, by the arm's own joints, limits and names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_files import IIWA, PANDA, UR5E, UR5E_NAMES, as_yourdfpy_has_it, dh_frames, written
from cli_support import Rig

import estimators
import scenarios
from rig.arm import Arm
from rig.effects import EFFECTS, make_effect
from rig.errors import RefusedFit, RigError
from rig.maneuver import LockedPoses, StaticPoses, TorusSweep
from rig.maneuver.fitting import fitted, locked_poses_deg
from rig.recording import read_recording
from rig.signals import Signals
from scenarios.bound import bound_of
from scenarios.comparison import compare
from scenarios.loader import from_toml

ROUNDING = 1e-12  # of a chain of seven matrices
ARMS = {"ur5e": UR5E, "panda": PANDA, "iiwa": IIWA}
SHORT = TorusSweep(duration_s=240.0, yaw_passes=5, pitch_passes=3)


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> Arm:
    return Arm.from_file(written(tmp_path, request.param))


def random_values(arm: Arm, count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(arm.lower, arm.upper, (count, arm.dof))


def test_an_arm_is_its_published_chain(arm: Arm) -> None:
    assert arm.tip == "tool0"  # the only flange
    q = random_values(arm, 20)
    expected = np.array([dh_frames(ARMS[arm.name], angles)[-1] for angles in q])
    np.testing.assert_allclose(arm.poses(q).R_base_tool, expected[:, :3, :3], atol=ROUNDING)
    np.testing.assert_allclose(arm.poses(q).position, expected[:, :3, 3], atol=ROUNDING)
    np.testing.assert_allclose(arm.speed, 3.0)


def test_a_torus_is_swept_by_the_arms_own_joints(arm: Arm) -> None:
    """Right angles between yaw and tilt, tilt and roll: gravity is seen all around the tool."""
    sweep = fitted(SHORT, arm)
    motion = sweep.trajectory()
    arm.check_limits(motion.q, "sweep")
    arm.check_speeds(motion.qd, "sweep")
    assert sweep.joints == (1, arm.dof - 1, arm.dof)
    down = -arm.rotation_map.rotations(motion.q).reshape(-1, 3, 3)[:, 2]
    assert np.linalg.eigvalsh(down.T @ down / len(down))[0] > 0.15  # a third each if seen evenly, zero on a circle


def test_locked_poses_show_every_axis_other_fields(arm: Arm) -> None:
    poses = LockedPoses(poses_deg=locked_poses_deg(arm), hold_s=1.0, rate_Hz=1.0).trajectory().q
    arm.check_limits(poses, "locked")
    down = -arm.rotation_map.rotations(poses).reshape(-1, 3, 3)[:, 2]
    apart = np.degrees(np.arccos(np.abs(down @ down.T)[np.triu_indices(len(down), 1)]))
    assert apart.min() > 60.0


def test_a_sweep_keeps_to_limits_that_are_no_round_numbers(tmp_path: Path) -> None:
    arm = Arm.from_file(written(tmp_path, "ur5e"))
    for low, high in np.random.default_rng(4).uniform((-3.0, 0.4), (-0.4, 3.0), (20, 2)):
        lower, upper = arm.lower.copy(), arm.upper.copy()
        lower[[0, 5]], upper[[0, 5]] = low, high
        narrow = replace(arm, lower=lower, upper=upper)
        narrow.check_limits(fitted(SHORT, narrow).trajectory().q, "sweep")


def test_a_sweep_of_any_arm_is_calibrated(arm: Arm) -> None:
    """Twenty-eight parameters within five sigma on three arms: fails by chance once in 20,000 runs."""
    scenario = replace(scenarios.load("ann-arbor"), maneuver=SHORT).with_arm(arm)
    calibration = estimators.calibrate(scenario.simulate(seed=1), arm=arm)
    rows = compare(scenario.truth, calibration)
    assert len(rows) == 28
    assert max(abs(row.error_sigmas or 0.0) for row in rows) < 5.0


def test_what_does_the_same_at_several_joints_has_the_size_of_the_one_that_is_named(tmp_path: Path) -> None:
    """Joint 2's axis is turned about: some of joints 2, 4 and 6 point against each other, so offsets differ in sign."""
    path = written(tmp_path, "iiwa")
    first, second, rest = path.read_text().split('<axis xyz="0 0 1"/>', 2)
    path.write_text(f'{first}<axis xyz="0 0 1"/>{second}<axis xyz="0 0 -1"/>{rest}')
    arm = Arm.from_file(path)
    truth = make_effect("joint_offset", {"where": "joint6", "offset_rad": 0.007})
    scenario = replace(scenarios.load("ann-arbor"), maneuver=SHORT).with_arm(arm).with_effects([truth])
    others = [name for name in EFFECTS if name not in ("joint_offset", "backlash")]
    found = estimators.diagnose(scenario.simulate(1), scenario.simulate_locked(1), without=others, arm=arm)
    (cause,) = found.causes
    assert (cause.effect, cause.where) == ("joint_offset", "joint6")
    assert {each["where"] for each in cause.equivalent} >= {"joint2", "joint4"}
    size = cause.parameters["offset_rad"]
    assert abs(size.value - 0.007) < 5.0 * size.std  # fails by chance once in a million


def test_a_scenario_names_its_arm_and_keeps_what_its_author_decides(tmp_path: Path) -> None:
    path = written(tmp_path, "ur5e")
    text = scenarios.load("ann-arbor").to_toml().replace('model = "a465"', f'file = "{path.name}"')
    left_open = from_toml(text, str(tmp_path / "mine.toml"))
    assert isinstance(left_open.maneuver, TorusSweep)
    assert left_open.maneuver.joints == (1, 5, 6)
    again = from_toml(left_open.to_toml(), "elsewhere.toml")
    assert again.maneuver == left_open.maneuver
    assert again.locked == left_open.locked
    decided = text.replace('kind = "torus-sweep"', 'kind = "torus-sweep"\njoints = [1, 4, 6]\nlocked_deg = [0, -90, 0]')
    assert from_toml(decided, str(tmp_path / "mine.toml")).maneuver.joints == (1, 4, 6)


def test_a_joint_goes_by_its_own_name(tmp_path: Path) -> None:
    arm = Arm.from_file(written(tmp_path, "ur5e"))
    assert arm.place_names == {f"joint{n}": f"{name}_joint" for n, name in enumerate(UR5E_NAMES, start=1)}
    assert make_effect("backlash", {"where": "wrist_2_joint"}, arm).where == "joint5"
    with pytest.raises(RigError, match="elbow_joint is at 200 deg in sample 0, expected -180 to 180 deg"):
        arm.check_limits(np.radians([[0, 0, 200.0, 0, 0, 0]]), "mine")
    with pytest.raises(RigError, match="wrist_1_joint goes at 200 deg/s, expected at most 171"):
        arm.check_speeds(np.radians([[0, 0, 0, -200.0, 0, 0]]), "mine")


def test_effects_act_on_every_joint_and_link_of_the_arm(tmp_path: Path) -> None:
    arm = Arm.from_file(written(tmp_path, "iiwa"))
    motion = fitted(SHORT, arm).trajectory(np.linspace(0.0, 240.0, 50))
    signals = Signals(t=motion.t, arm=arm, q_encoder=motion.q)
    assert EFFECTS["joint_offset"].places_on(signals) == tuple(f"joint{n}" for n in range(1, 8))
    assert EFFECTS["backlash"].places_on(signals) == ("joint1", "joint6", "joint7")
    assert EFFECTS["link_hard_iron"].places_on(signals) == tuple(f"link{n}" for n in range(1, 7))
    assert EFFECTS["mains_hum"].places_on(signals) == ("acquisition",)
    assert "joint1" not in EFFECTS["joint_compliance"].places_on(signals)  # upright: gravity does not load it
    with pytest.raises(RigError, match=r"the arm has 7 joints, expected joint1 to joint7 \(nearest: 'joint8'|joint8"):
        make_effect("backlash", {"where": "joint8"}, arm)


def test_a_scara_cannot_sweep_and_says_what_stays_open(tmp_path: Path) -> None:
    arm = Arm.from_file(written(tmp_path, "scara"))
    assert arm.slides == (False, False, True, False)
    with pytest.raises(RigError, match=r"no joint between shoulder and spin tilts .* static-poses suits any arm"):
        fitted(TorusSweep(), arm)
    scenario = scenarios.load("ann-arbor").with_arm(arm, "static-poses")
    assert isinstance(scenario.maneuver, StaticPoses)
    found = bound_of(scenario).to_json()["sensors"]["accelerometer"]
    assert all(parameter["std"] is None for parameter in found["parameters"].values()), found
    run = scenario.simulate(seed=0)
    with pytest.raises(RefusedFit, match="cannot determine sensitivity"):
        estimators.calibrate(run, arm=arm)
    with pytest.raises(RigError, match="joint3 slides, expected a joint that turns"):
        make_effect("backlash", {"where": "quill"}, arm)
    run.write(tmp_path / "run.csv")
    again = read_recording(tmp_path / "run.csv", joints=4)
    assert again.columns.names[1:5] == ("q1_rad", "q2_rad", "q3_m", "q4_rad")
    np.testing.assert_array_equal(again.q, run.q)


TIED = """<robot name="tied"><link name="base_link"/><link name="a"/><link name="b"/><link name="c"/><link name="tip"/>
 <joint name="one" type="revolute"><parent link="base_link"/><child link="a"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
 <joint name="lift" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0.2" rpy="0.3 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-0.1" upper="0.3" velocity="1" effort="1"/></joint>
 <joint name="follower" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0.2 0" rpy="0 0.7 0"/>
  <axis xyz="1 0 1"/><limit lower="-4" upper="4" velocity="1" effort="1"/>
  <mimic joint="one" multiplier="-1.5" offset="0.2"/></joint>
 <joint name="last" type="continuous"><parent link="c"/><child link="tip"/><origin xyz="0 0 0.1" rpy="1 0 0"/>
  <axis xyz="0 0 1"/></joint></robot>"""


def test_sliding_and_mimicking_joints_against_another_program(tmp_path: Path) -> None:
    path = tmp_path / "tied.urdf"
    path.write_text(TIED)
    arm = Arm.from_file(path)
    assert (arm.tip, arm.joint_names) == ("tip", ("one", "lift", "last"))
    q = np.random.default_rng(0).uniform([-2, -0.1, -3], [2, 0.3, 3], (30, 3))
    as_yourdfpy_has_it(arm, "base_link", q)
    links = arm.link_poses(q)
    for link, turn in enumerate(arm.link_maps):
        np.testing.assert_allclose(turn.rotations(q).reshape(-1, 3, 3), links.rotation[:, link], atol=ROUNDING)


MJCF = """<mujoco model="bench"><asset><mesh name="hull" file="hull.stl"/></asset><worldbody><body name="base">
 <geom type="mesh" mesh="hull"/>
 <body name="a" pos="0 0 .3"><joint name="pan" axis="0 0 1" range="-170 170"/><geom size=".05"/>
 <body name="b" pos="0 0 .1"><joint name="tilt" axis="0 1 0" range="-100 100"/><joint name="turn" axis="1 0 0"/>
  <geom size=".05"/><body name="wrist" pos=".3 0 0"><joint name="roll" axis="0 0 1"/><geom size=".05"/>
  <site name="attachment_site" pos="0 0 .1" euler="0 90 0"/></body></body></body></body></worldbody></mujoco>"""


def test_a_folder_with_a_model_and_its_scene(tmp_path: Path) -> None:
    folder = tmp_path / "maker_bench"
    folder.mkdir()
    (folder / "scene.xml").write_text('<mujoco><include file="bench.xml"/></mujoco>')
    (folder / "bench.xml").write_text(MJCF)
    with pytest.warns(UserWarning, match=r"meshes are missing, the arm is drawn without: .*hull\.stl"):
        arm = Arm.from_file(folder)
    assert (arm.joint_names, arm.site) == (("pan", "tilt", "turn", "roll"), "attachment_site")
    with pytest.warns(UserWarning, match="meshes"):
        body = Arm.from_file(folder, "wrist")
    turn = arm.poses(np.zeros((1, 4))).R_base_tool[0]
    np.testing.assert_allclose(body.poses(np.zeros((1, 4))).R_base_tool[0], np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose(turn @ [0, 0, 1], [1, 0, 0], atol=ROUNDING)
    q = np.ones((1, 4))
    np.testing.assert_allclose(arm.rotation_map.rotations(q)[0], arm.poses(q).R_base_tool.ravel(), atol=ROUNDING)
    (folder / "another.xml").write_text(MJCF)
    (folder / "bench.xml").rename(folder / "third.xml")
    with pytest.raises(RigError, match=r"found 2 models, expected the path of one of another\.xml, third\.xml"):
        Arm.from_file(folder)


def test_a_clipped_motion_and_a_moving_noise_recording_are_told(tmp_path: Path, rig: Rig) -> None:
    """Two and a half times the sensitivity leaves the board's 5 V; a tumble is no noise."""
    text = scenarios.load("renk2005-accelerometer").to_toml()
    loud = scenarios.load("renk2005-accelerometer").rig.accelerometer
    assert loud is not None
    text = text.replace(f"{loud.sensitivity[0]!r}", f"{2.5 * loud.sensitivity[0]!r}", 1)
    (tmp_path / "loud.toml").write_text(text)
    assert "! accel1: the motion leaves the board's range in" in rig.done(
        "sweep", tmp_path / "loud.toml", "-o", tmp_path / "run.parquet"
    )
    run = read_recording(tmp_path / "run.parquet")
    replace(run, q=None).write(tmp_path / "moving.parquet")
    assert "it moves, expected a recording held still" in rig.refused("noise", tmp_path / "moving.parquet")
