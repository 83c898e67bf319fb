"""The dynamic engine: the servos' errors are those of the model, and the accelerations those of the path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_files import written

from rig.arm import Arm
from rig.arrays import Array
from rig.assets import model_path
from rig.engine_dynamic import follow
from rig.errors import RigError
from rig.maneuver import HandTumble, LockedPoses, Maneuver, StaticPoses, TorusSweep
from rig.maneuver.fitting import fitted
from rig.trajectory import JointTrajectory

#: Fifteen seconds at the paper's speeds: two yaw passes, one pitch pass.
SWEEP = TorusSweep(duration_s=15.0, yaw_passes=2, yaw_range_deg=23.0, pitch_passes=1, pitch_range_deg=13.0)
POSE = (20.0, 60.0, -40.0, 30.0, 50.0, 70.0)


@pytest.fixture(scope="module")
def followed(arm: Arm) -> JointTrajectory:
    return follow(arm, SWEEP)


def behind(maneuver: Maneuver, path: JointTrajectory) -> Array:
    """(n, N) [rad], commanded minus true."""
    commanded = maneuver.trajectory(path.t)
    assert isinstance(commanded, JointTrajectory)
    return commanded.q - path.q


def felt(arm: Arm, path: JointTrajectory) -> Array:
    """(n, 3) [m/s^2] of the sensor along a path, base frame."""
    return arm.site_acceleration(path.q, path.qd, path.qdd)


def gains(arm: Arm) -> tuple[Array, Array]:
    """Stiffness [N m/rad] and damping [N m s/rad], servo and joint together."""
    return arm.model.actuator_gainprm[:, 0], -arm.model.actuator_biasprm[:, 2] + arm.model.dof_damping


def gravity_torque(arm: Arm, q: Array, gravity: Array) -> Array:
    """(N,) [N m] that holds the arm still at q (N,)."""
    data = mujoco.MjData(arm.model)
    before = arm.model.opt.gravity.copy()
    arm.model.opt.gravity = gravity
    data.qpos[:] = q
    mujoco.mj_forward(arm.model, data)
    arm.model.opt.gravity = before
    return data.qfrc_bias.copy()


# --- following -------------------------------------------------------------------------------------------------------


def test_the_path_has_the_maneuvers_own_samples(followed: JointTrajectory) -> None:
    np.testing.assert_array_equal(followed.t, SWEEP.trajectory().t)


def test_the_arm_follows_with_the_lag_of_its_servos(arm: Arm, followed: JointTrajectory) -> None:
    """At constant speed v the error is (damping v + gravity's torque)/stiffness; 1 % is left for gravity's change."""
    stiffness, damping = gains(arm)
    middle = len(followed.t) // 4  # half way through the first yaw pass
    velocity = SWEEP.trajectory(followed.t[middle : middle + 1]).qd[0]
    load = gravity_torque(arm, followed.q[middle], np.array([0.0, 0.0, -9.8]))
    expected = (damping * velocity + load) / stiffness
    np.testing.assert_allclose(behind(SWEEP, followed)[middle], expected, rtol=0.01, atol=1e-9)
    error = np.abs(behind(SWEEP, followed))
    assert np.isfinite(followed.q).all()
    assert (error[:, [0, 4, 5]].max(axis=0) > 1e-5).all()
    assert error.max() < 1e-3


def test_it_begins_settled(arm: Arm, followed: JointTrajectory) -> None:
    """Roll already turns with its final lag, the others stand with gravity's droop: no transient at the start."""
    stiffness, damping = gains(arm)
    load = gravity_torque(arm, followed.q[0], np.array([0.0, 0.0, -9.8]))
    velocity = np.array([0, 0, 0, 0, 0, np.radians(13.9)])
    np.testing.assert_allclose(
        behind(SWEEP, followed)[0], (damping * velocity + load) / stiffness, rtol=1e-6, atol=1e-10
    )
    np.testing.assert_allclose(followed.qd[0], velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(felt(arm, followed)[0], 0.0, atol=1e-6)


def test_the_last_joint_rolls_on(followed: JointTrajectory) -> None:
    assert np.degrees(followed.q[-1, 5]) == pytest.approx(13.9 * followed.t[-1], abs=0.1)
    assert np.degrees(followed.q[-1, 5]) > 180


def test_progress_rises_to_one(arm: Arm) -> None:
    seen: list[float] = []
    follow(arm, replace(SWEEP, duration_s=25.0), progress=seen.append)
    assert seen == sorted(seen)
    assert len(seen) == 3
    assert seen[-1] == 1.0


def test_blocks_leave_no_seam(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut elsewhere, the simulation is the same to the last bit."""
    maneuver = replace(SWEEP, duration_s=3.0)
    whole = follow(arm, maneuver)
    monkeypatch.setattr("rig.engine_dynamic._BLOCK_S", 0.37)
    pieces = follow(arm, maneuver)
    np.testing.assert_array_equal(pieces.q, whole.q)
    np.testing.assert_array_equal(pieces.qdd, whole.qdd)


@pytest.mark.parametrize("rate", [30.0, 300.0, 1000.0, 2500.0])
def test_any_rate(arm: Arm, rate: float) -> None:
    """Steps of at most 1 ms that end on every sample."""
    maneuver = replace(SWEEP, duration_s=1.0, rate_Hz=rate)
    followed = follow(arm, maneuver)
    assert len(followed.t) == rate
    np.testing.assert_array_equal(followed.t, maneuver.trajectory().t)
    lag = 4e-3 * np.abs(followed.qd).max()  # damping over stiffness is at most 2.9 ms
    assert np.abs(behind(maneuver, followed)).max() < lag + 1e-4


# --- acceleration ----------------------------------------------------------------------------------------------------


def test_acceleration_is_the_second_difference_of_the_actual_path(arm: Arm) -> None:
    """At the step rate, with every step a sample.

    The engine's joint accelerations are the second differences of q exactly, so what is left is the curvature of the
    way from q to the sensor: h^2 ((qdd/2)^2 + qd^2 qdd/2 + qd^4/12) times the reach for each pair of joints, and the
    rounding of the second difference, 4 ulp of half a metre over h^2.
    """
    h = 1e-3
    followed = follow(arm, replace(SWEEP, duration_s=4.0, rate_Hz=1 / h, corner_s=0.2))
    position = arm.poses(followed.q).position
    difference = (position[2:] - 2 * position[1:-1] + position[:-2]) / h**2
    speed = np.abs(followed.qd).sum(axis=1).max()
    change = np.abs(np.gradient(followed.qd, h, axis=0)).sum(axis=1).max()
    bound = h**2 * ((change / 2) ** 2 + speed**2 * change / 2 + speed**4 / 12) + 4 * 1.1e-16 / h**2
    np.testing.assert_allclose(felt(arm, followed)[1:-1], difference, rtol=0, atol=bound)
    assert np.abs(felt(arm, followed)).max() > 1e4 * bound


def test_velocity_is_the_first_difference_of_the_actual_path(arm: Arm) -> None:
    followed = follow(arm, replace(SWEEP, duration_s=2.0, rate_Hz=1000.0, corner_s=0.2))
    difference = (followed.q[2:] - followed.q[:-2]) / 2e-3
    np.testing.assert_allclose(followed.qd[1:-1], difference, rtol=0, atol=1e-12)


def test_slow_motion_accelerates_as_commanded(arm: Arm, followed: JointTrajectory) -> None:
    """The true acceleration is the commanded one, delayed by the servo (under 3 ms) and smoothed by it."""
    commanded: JointTrajectory = SWEEP.trajectory()
    wanted = arm.site_acceleration(commanded.q, commanded.qd, commanded.qdd)
    peak = np.abs(wanted).max()
    assert peak > 0.02
    assert np.abs(felt(arm, followed) - wanted).max() < 0.15 * peak


# --- gravity ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.8), (9.8, 0.0, 0.0), (3.0, -5.0, 7.0)])
def test_gravity_pulls_where_it_is_told(arm: Arm, gravity: tuple[float, float, float]) -> None:
    """At rest the servo's error times its stiffness is gravity's torque."""
    locked = LockedPoses(poses_deg=(POSE,), hold_s=0.5, rate_Hz=100.0)
    still = follow(arm, locked, gravity)
    stiffness, _ = gains(arm)
    expected = gravity_torque(arm, still.q[-1], np.array(gravity))
    np.testing.assert_allclose(stiffness * behind(locked, still)[-1], expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(felt(arm, still), 0.0, atol=1e-6)
    assert np.abs(expected).max() > 1


def test_gravity_is_in_the_base_frame(arm: Arm, tmp_path: Path) -> None:
    """An arm whose base hangs on its side in the world droops all the same."""
    spec = mujoco.MjSpec.from_file(str(model_path("a465/a465.xml")))
    spec.body("base").quat = [0.5, 0.5, -0.5, 0.5]
    spec.compile()
    (tmp_path / "moved.xml").write_text(spec.to_xml())
    moved = Arm.from_mjcf(tmp_path / "moved.xml")
    maneuver = replace(SWEEP, duration_s=1.0)
    here, there = follow(arm, maneuver, (1.0, 2.0, -9.0)), follow(moved, maneuver, (1.0, 2.0, -9.0))
    np.testing.assert_allclose(there.q, here.q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(felt(moved, there), felt(arm, here), rtol=0, atol=1e-6)


def test_the_arm_itself_is_left_alone(arm: Arm) -> None:
    before = arm.model.opt.gravity.copy(), arm.model.opt.timestep, arm.model.opt.disableflags
    follow(arm, replace(SWEEP, duration_s=1.0, rate_Hz=300.0), (1.0, 2.0, 3.0))
    np.testing.assert_array_equal(arm.model.opt.gravity, before[0])
    assert (arm.model.opt.timestep, arm.model.opt.disableflags) == before[1:]


# --- refusals --------------------------------------------------------------------------------------------------------


def test_a_hand_has_no_joints_to_drive(arm: Arm) -> None:
    with pytest.raises(RigError, match="found a maneuver of the sensor alone, expected engine kinematic"):
        follow(arm, HandTumble(duration_s=1.0))


def test_jumps_are_refused(arm: Arm) -> None:
    with pytest.raises(RigError, match="joint6 jumps at t = 1 s, expected a motion without jumps"):
        follow(arm, LockedPoses(hold_s=1.0))
    follow(arm, StaticPoses(count=2, hold_s=0.5, move_s=3.0))  # the fastest of moves are none


def test_limits_are_refused(arm: Arm) -> None:
    beyond = LockedPoses(poses_deg=((0.0, 185.0, 0.0, 0.0, 0.0, 0.0),), hold_s=1.0)
    with pytest.raises(RigError, match="joint2 is at 185 deg in sample 0, expected 0 to 180 deg"):
        follow(arm, beyond)


@pytest.mark.parametrize("name", ["ur5e", "iiwa"])
def test_an_arm_without_servos_has_ideal_ones(tmp_path: Path, name: str) -> None:
    """Any URDF with masses: it lags by damping over stiffness, at most 2 D / omega with the servos' own D and omega.

    Gravity's torque over the stiffness comes on top: with inertias I the droop is at most the reach's g / omega^2.
    """
    found = Arm.from_urdf(written(tmp_path, name))
    maneuver = fitted(StaticPoses(count=3, hold_s=1.0, move_s=3.0), found)
    moved = follow(found, maneuver, gravity=(0.0, 0.0, 0.0))
    omega = 2.0 * np.pi * 50.0
    assert np.abs(moved.qd).max() > 0.2
    assert np.abs(behind(maneuver, moved)).max() < 1.2 * 2.0 * 0.7 / omega * np.abs(moved.qd).max()
    assert np.abs(behind(maneuver, moved)[-1]).max() < 1e-6
    wanted = found.site_acceleration(*(getattr(maneuver.trajectory(moved.t), each) for each in ("q", "qd", "qdd")))
    assert np.abs(felt(found, moved) - wanted).max() < 0.2 * np.abs(wanted).max()


def test_motors_give_way_to_servos(tmp_path: Path) -> None:
    """An MJCF whose joints have motors, which nothing drives here."""
    text = """<mujoco model="two"><worldbody><body><joint name="a" axis="0 0 1" range="-180 180"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.4 0 0"/>
        <body pos="0.4 0 0"><joint axis="0 1 0" range="-90 90"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/>
        <site name="imu" pos="0.3 0 0"/></body></body></worldbody><actuator><motor joint="a"/></actuator></mujoco>"""
    (tmp_path / "two.xml").write_text(text)
    found = Arm.from_mjcf(tmp_path / "two.xml")
    moving = StaticPoses(poses_deg=((0.0, 0.0), (60.0, 30.0)), hold_s=1.0, move_s=2.0, limits_deg=None)
    moved = follow(found, moving, gravity=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(np.degrees(moved.q[-1]), (60.0, 30.0), atol=1e-4)


def test_an_arm_without_masses_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"arm scara: shoulder moves no mass: expected mass and inertia .*<inertial>"):
        follow(Arm.from_urdf(written(tmp_path, "scara")), SWEEP)


def test_an_unstable_simulation_is_one_line(tmp_path: Path) -> None:
    """A servo stiffer than the step can follow: MuJoCo resets the state and warns, which must not pass for a result."""
    (tmp_path / "stiff.xml").write_text(
        """<mujoco model="stiff"><worldbody><body><joint name="a" axis="0 0 1"/><geom size="0.1"/>
        <site name="imu" pos="0.1 0 0"/></body></worldbody>
        <actuator><position joint="a" kp="1e12"/></actuator></mujoco>"""
    )
    arm = Arm.from_mjcf(tmp_path / "stiff.xml")
    moving = StaticPoses(poses_deg=((0.0,), (90.0,)), hold_s=0.5, move_s=1.0, limits_deg=None)
    with pytest.raises(RigError, match="arm stiff: the simulation became unstable before t =") as caught:
        follow(arm, moving)
    assert "\n" not in str(caught.value)
