"""The mechanisms: what the stepped model does beside what statics and kinematics say it must."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import scenarios
from rig.arm import Arm
from rig.arrays import Array
from rig.effects import EFFECTS
from rig.maneuver import TorusSweep
from validation.blind.mechanics import MECHANISMS, Mechanism
from validation.blind.mechanics.drive import Driven, built, drive
from validation.blind.mechanics.driven_readings import see
from validation.blind.mechanics.mechanisms import (
    LashJoint,
    MagnetOnLink,
    OffCentreSensor,
    RockingBase,
    SpringJoint,
    VibratingTable,
)
from validation.blind.settings import draw_setting

DOWN = np.array([0.0, 0.0, -9.8])
SLOW = TorusSweep(
    duration_s=40.0,
    rate_Hz=20.0,
    yaw_range_deg=90.0,
    yaw_passes=2,
    pitch_range_deg=120.0,
    pitch_passes=1,
    corner_s=4.0,
)


def turns(driven: Driven) -> Array:
    """(n, 3) [rad] how the sensor is turned beside what the encoders say, base frame."""
    ideal = Arm.a465().poses(driven.q).R_base_tool
    return Rotation.from_matrix(driven.R_base_tool @ ideal.transpose(0, 2, 1)).as_rotvec()


def test_they_are_named_as_the_catalogue_names_them() -> None:
    rng = np.random.default_rng(0)
    setting = draw_setting(scenarios.load("ann-arbor"), 400, rng)
    for kind in MECHANISMS.values():
        mechanism = kind.draw(rng, setting)
        names = [(mechanism.effect, mechanism.where), *mechanism.families, *mechanism.besides]
        assert all(where in EFFECTS[effect].places for effect, where in names)
        assert mechanism.scaled(2.0).strength == 2.0


def test_nothing_in_the_arm_changes_nothing() -> None:
    """The encoders, and the path's acceleration beside the arm's own formula: what is left is the servos' tremor."""
    driven = drive(MagnetOnLink(0.0, "link1", (0.0, 0.0, 0.0)), SLOW, DOWN)
    assert np.abs(turns(driven)).max() < 1e-12
    assert not driven.field.any()
    t = driven.t[8:-8]
    path = SLOW.trajectory(t)
    expected = Arm.a465().site_acceleration(path.q, path.qd, path.qdd)
    assert np.sqrt(np.mean((driven.acceleration[8:-8] - expected) ** 2)) < 0.05 * np.sqrt(np.mean(expected**2))


def test_the_lash_makes_a_play_of_its_width() -> None:
    """Between the stops but for their softness, 5 % of the width, and there it stays until the other stop pushes."""
    driven = drive(LashJoint(1.0), SLOW, DOWN)
    yaw = turns(driven)[:, 2]
    speed = np.gradient(driven.q[:, 0], driven.t)
    running = (np.abs(speed) > 0.5 * np.abs(speed).max()) & (driven.t > 8.0)
    np.testing.assert_allclose(yaw[running & (speed > 0)], -2e-3, atol=2e-4)
    back = running & (speed < 0) & (driven.t > 26.0)
    np.testing.assert_allclose(yaw[back], 2e-3, atol=2e-4)


def test_the_lash_knocks_in_single_readings() -> None:
    """Beside the same arm without it: a tenth of the largest is felt in two or three of 160 readings, as the stop
    changes. So outliers are a name for what it does on the side."""
    with_it, without = (drive(each, SLOW, DOWN) for each in (LashJoint(1.0), MagnetOnLink(0.0, "link1", (0.0,) * 3)))
    felt = np.linalg.norm(with_it.acceleration - without.acceleration, axis=1)[8:]
    side = np.sign(turns(with_it)[8:, 2])
    knocks = np.flatnonzero(felt > 0.1 * felt.max())
    assert len(knocks) <= 3
    assert np.abs(knocks - np.flatnonzero(np.diff(side))).max() <= 2
    assert LashJoint(1.0).besides == (("outliers", "acquisition"),)


def test_the_spring_gives_way_by_torque_over_stiffness() -> None:
    """The static droop under the tool's weight; the slow sweep's own accelerations add under 2 % of its largest."""
    driven = drive(SpringJoint(1.0), SLOW, DOWN)
    arm = Arm.a465()
    data = mujoco.MjData(arm.model)
    torque = []
    for q in driven.q:
        data.qpos[:] = q
        data.qvel[:] = 0.0
        mujoco.mj_forward(arm.model, data)
        torque.append(data.qfrc_bias[4])  # what the joint must carry
    expected = -np.array(torque) / 200.0
    axis = arm.link_poses(driven.q).rotation[:, 4, :, 1]  # joint 5 turns about y of link 5
    found = np.einsum("nk,nk->n", turns(driven), axis)
    np.testing.assert_allclose(found[8:], expected[8:], atol=0.02 * np.abs(expected).max())


def test_the_base_tips_by_moment_over_stiffness() -> None:
    """The moment of the arm's weight about the hinge over its stiffness, to 3 % (it also weighs as it tips)."""
    mechanism = RockingBase(1.0, 0.7)
    driven = drive(mechanism, SLOW, DOWN)
    arm = Arm.a465()
    axis = np.array([-np.sin(0.7), np.cos(0.7), 0.0])
    data, moments = mujoco.MjData(arm.model), []
    for q in driven.q:
        data.qpos[:] = q
        mujoco.mj_kinematics(arm.model, data)
        mujoco.mj_comPos(arm.model, data)
        weight = arm.model.body_mass[:, None] * DOWN
        moments.append(axis @ np.cross(data.xipos, weight).sum(axis=0))
    expected = np.array(moments) / 2e4
    found = turns(driven) @ axis
    np.testing.assert_allclose(found[8:], expected[8:], atol=0.03 * np.abs(expected).max())


def test_the_magnet_is_a_dipole_that_rides_on_its_link() -> None:
    """Constant in link 5; on link 1 the catalogue's dipole formula at the place where the link carries it."""
    near = drive(MagnetOnLink(1.0, "link5", (1e-5, 2e-5, -1e-5)), SLOW, DOWN)
    links = Arm.a465().link_poses(near.q)
    in_link = np.einsum("nji,nj->ni", links.rotation[:, 4], near.field)
    assert np.ptp(in_link, axis=0).max() < 1e-9 * np.abs(in_link).max()
    moment = np.array([1e-3, 5e-4, -2e-4])
    far = drive(MagnetOnLink(1.0, "link1", tuple(moment)), SLOW, DOWN)
    links, poses = Arm.a465().link_poses(far.q), Arm.a465().poses(far.q)
    for row in (0, 50, 120):
        turned = links.rotation[row, 0]
        way = poses.position[row] - (links.position[row, 0] + turned @ [0.0, -0.15, 0.12])
        d = np.linalg.norm(way)
        m = turned @ moment
        expected = 3.0 * way * (way @ m) / d**5 - m / d**3
        np.testing.assert_allclose(far.field[row], expected, rtol=1e-9)


def test_the_sensor_off_its_centre_feels_its_own_path() -> None:
    """Beside differences of the commanded path at the displaced place; servos follow it to a few per cent."""
    fast = replace(SLOW, yaw_passes=6, corner_s=3.0)
    lever = np.array([0.05, -0.02, 0.03])
    driven = drive(OffCentreSensor(1.0, tuple(lever)), fast, DOWN)
    step, arm = 1e-2, Arm.a465()

    def place(t: Array) -> Array:
        poses = arm.poses(fast.trajectory(t).q)
        return poses.position + poses.R_base_tool @ lever

    t = driven.t[8:-8]
    expected = (place(t - step) - 2.0 * place(t) + place(t + step)) / step**2
    assert np.sqrt(np.mean((driven.acceleration[8:-8] - expected) ** 2)) < 0.06 * np.sqrt(np.mean(expected**2))


def test_the_table_shakes_as_a_driven_oscillator() -> None:
    """Amplitude of F/(k - m w^2 + i c w) w^2 along the line, to 15 %: the arm on it is not quite rigid.

    The board's averaging over a triangle of +-10 ms takes its share, sinc^2.
    """
    frequency = 13.3
    driven = drive(VibratingTable(1.0, (0.0, 0.0, 1.0), frequency, 0.0), replace(SLOW, corner_s=8.0), DOWN)
    mass = float(Arm.a465().model.body_mass.sum())
    w = 2.0 * np.pi * frequency
    expected = np.sinc(0.01 * frequency) ** 2 * 2.0 * w * w / abs(6e5 - mass * w * w + 2500.0 * w * 1j)
    rows = slice(20, -20)
    wave = np.exp(-1j * w * driven.t[rows])
    found = 2.0 * abs(np.mean(driven.acceleration[rows, 2] * wave))
    assert found == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_models_hold_the_arm_and_the_sensor(name: str) -> None:
    setting = draw_setting(scenarios.load("ann-arbor"), 400, np.random.default_rng(1))
    mechanism: Mechanism = MECHANISMS[name].draw(np.random.default_rng(2), setting)
    model = built(mechanism)
    assert {f"joint{number}" for number in range(1, 7)} <= {model.joint(index).name for index in range(model.njnt)}
    assert model.nu == 6 + mechanism.forces(np.zeros(1)).shape[1]


def test_readings_are_those_of_the_turned_sensor() -> None:
    """A magnet changes the magnetometer alone, by the sensor's own axes times its field."""
    setting = draw_setting(scenarios.load("ann-arbor"), 400, np.random.default_rng(1))
    seen = see(MagnetOnLink(1.0, "link5", (1e-5, 0.0, 0.0)), replace(setting, maneuver=SLOW))
    assert np.abs(seen.change[:, 3:]).max() > 1e-3
    assert seen.volts.shape == seen.change.shape == (160, 6)
