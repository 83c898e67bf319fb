"""Maneuvers: what they reach, how smooth they are, and that they are what the paper describes.

Angles are compared to 1e-9 deg: positions of some hundred degrees are computed from times of some thousand seconds, so
a few times 1e-13 deg of rounding is in them; the smallest mistake, one sample, is 1e-2 deg.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver import MANEUVERS, FourierSweep, LockedPoses, Maneuver, StaticPoses, TorusSweep
from rig.maneuver.profile import BackAndForth, quintic
from rig.trajectory import JointTrajectory

ROUNDING_DEG = 1e-9


def joints_at(maneuver: Maneuver, t: Array) -> JointTrajectory:
    trajectory = maneuver.trajectory(t)
    assert isinstance(trajectory, JointTrajectory)
    return trajectory


def check_derivatives(maneuver: Maneuver, t: Array, h: float) -> None:
    """qd and qdd are the derivatives of q: central differences, whose error falls to a quarter with half the step.

    That holds where the derivative after next is continuous over the step: everywhere in a sweep, within a move of
    static poses. At two shares in a thousand of a piece's length the next term of the series is 1e-5 of this one.
    """
    here = joints_at(maneuver, t)
    for name, derivative in (("q", here.qd), ("qd", here.qdd)):
        errors = []
        for step in (h, h / 2):
            after, before = (getattr(joints_at(maneuver, t + shift), name) for shift in (step, -step))
            errors.append((after - before) / (2 * step) - derivative)
        scale = np.abs(derivative).max()
        assert scale > 0
        assert np.sqrt(np.mean(errors[0] ** 2)) < 1e-3 * scale
        ratio = np.linalg.norm(errors[0]) / np.linalg.norm(errors[1])
        assert ratio == pytest.approx(4.0, rel=0.05)


# --- the torus sweep -------------------------------------------------------------------------------------------------


def test_the_papers_sweep_in_numbers() -> None:
    sweep = TorusSweep()
    trajectory = sweep.trajectory()
    assert len(trajectory) == 166_400
    assert trajectory.t[0] == 0.0
    assert trajectory.t[-1] == pytest.approx(1663.99, abs=1e-9)
    assert sweep.duration_s == 1664.0
    q = np.degrees(trajectory.q)
    np.testing.assert_allclose(q[:, 1:4], np.tile([90.0, -90.0, 0.0], (len(q), 1)), rtol=0, atol=ROUNDING_DEG)
    np.testing.assert_allclose(q[:, 5], 13.9 * trajectory.t, rtol=0, atol=ROUNDING_DEG)
    Arm.a465().check_limits(trajectory.q, "sweep")


@pytest.mark.parametrize(("column", "extent", "passes"), [(0, 340.0, 15), (4, 180.0, 7)])
def test_ranges_and_passes_are_met_exactly(column: int, extent: float, passes: int) -> None:
    sweep = TorusSweep()
    ends = 1664.0 / passes * np.arange(passes + 1)
    at_ends = joints_at(sweep, ends)
    expected = np.where(np.arange(passes + 1) % 2, extent / 2, -extent / 2)
    np.testing.assert_allclose(np.degrees(at_ends.q[:, column]), expected, rtol=0, atol=ROUNDING_DEG)
    np.testing.assert_allclose(at_ends.qd[:, column], 0.0, atol=1e-12)
    dense = sweep.trajectory()
    q, qd = np.degrees(dense.q[:, column]), dense.qd[:, column]
    assert np.ptp(q) == pytest.approx(extent, abs=1e-3)  # samples miss the ends by up to half a period
    assert np.abs(q).max() <= extent / 2 + ROUNDING_DEG
    assert np.count_nonzero(np.diff(np.sign(qd[np.abs(qd) > 1e-9]))) == passes - 1
    cruising = np.degrees(np.abs(qd).max())
    assert cruising == pytest.approx(extent * passes / 1664.0, rel=5e-3)  # corners cost little
    assert np.mean(np.abs(np.degrees(np.abs(qd)) - cruising) < 1e-9) > 0.99


@pytest.mark.parametrize(
    "sweep",
    [
        TorusSweep(duration_s=60.0, corner_s=2.0),
        TorusSweep(duration_s=60.0, corner_s=4.0, yaw_passes=15, roll="sweep", roll_deg_per_s=80.0),
        TorusSweep(duration_s=20.0, corner_s=1.0, yaw_passes=1, pitch_passes=2, yaw_centre_deg=5.0),
    ],
)
def test_velocity_and_acceleration_are_the_derivatives(sweep: TorusSweep) -> None:
    check_derivatives(sweep, np.linspace(0.0137, sweep.duration_s - 0.0137, 4001), 2e-3)


def test_nothing_jumps_up_to_the_acceleration() -> None:
    """Between samples no quantity moves more than the greatest rate of the next one allows.

    The jerk of a corner is at most 1.155 * (15/8) * speed/(corner/2)^2 and that of the start 5.774 * speed/ramp^2.
    """
    sweep = TorusSweep(duration_s=60.0, corner_s=0.8, roll="sweep", roll_deg_per_s=60.0)
    dt = 1e-4
    t = np.arange(-0.1, 60.1, dt)
    motion = joints_at(sweep, t)
    for values, rates in ((motion.q, motion.qd), (motion.qd, motion.qdd)):
        allowed = np.abs(rates).max(axis=0) * dt * (1 + 1e-6) + 1e-12
        assert (np.abs(np.diff(values, axis=0)).max(axis=0) <= allowed).all()
    ramp = 5 / 8 * sweep.corner_s / 2
    jerk = 5.774 * np.abs(motion.qd).max(axis=0) / ramp**2
    assert (np.abs(np.diff(motion.qdd, axis=0)).max(axis=0) <= jerk * dt * 1.01 + 1e-12).all()


def test_it_holds_still_before_and_after_but_for_a_continuous_roll() -> None:
    sweep = TorusSweep(duration_s=30.0)
    t = np.array([-5.0, -1e-9, 30.0, 31.0, 1e4])
    motion = joints_at(sweep, t)
    edges = joints_at(sweep, np.array([0.0, 0.0, 30.0, 30.0, 30.0]))
    np.testing.assert_allclose(motion.q[:, :5], edges.q[:, :5], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(motion.qd[:, :5], 0.0)
    np.testing.assert_array_equal(motion.qdd, 0.0)
    np.testing.assert_allclose(np.degrees(motion.q[:, 5]), 13.9 * t, rtol=1e-15)


@pytest.mark.parametrize("corner", [0.05, 0.5, 3.9])
def test_speed_and_peak_acceleration_are_as_promised(corner: float) -> None:
    law = BackAndForth(-20.0, 30.0, 5, 20.0, corner)
    position, velocity, acceleration = law.evaluate(np.linspace(0, 20, 400_001))
    assert position.min() == pytest.approx(-20.0, abs=1e-12)
    assert position.max() == pytest.approx(30.0, abs=1e-12)
    assert np.abs(velocity).max() == pytest.approx(law.speed, rel=1e-12)
    assert np.abs(acceleration).max() == pytest.approx(law.peak_acceleration, rel=1e-5)


def test_roll_starts_where_it_is_told_and_may_turn_backwards() -> None:
    motion = joints_at(TorusSweep(roll_start_deg=30.0, roll_deg_per_s=-20.0), np.array([0.0, 2.0]))
    np.testing.assert_allclose(np.degrees(motion.q[:, 5]), [30.0, -10.0], atol=ROUNDING_DEG)


def test_sweeping_roll_stays_within_the_real_joints_limits() -> None:
    sweep = TorusSweep(roll="sweep")
    assert sweep.roll_passes == 64  # 13.9 deg/s for 1664 s are 64.25 ranges of 360 deg
    roll = np.degrees(sweep.trajectory().q[:, 5])
    assert np.abs(roll).max() <= 180.0 + ROUNDING_DEG
    assert np.ptp(roll) == pytest.approx(360.0, abs=0.1)  # samples miss the ends by up to half a period


def test_locked_joints_may_be_anywhere() -> None:
    """An arm of seven joints, its moving ones elsewhere."""
    sweep = TorusSweep(locked_deg=(10.0, 20.0, 30.0, 40.0), joints=(2, 5, 7), limits_deg=None, duration_s=10.0)
    q = np.degrees(sweep.trajectory().q)
    np.testing.assert_allclose(q[:, [0, 2, 3, 5]], np.tile([10, 20, 30, 40], (1000, 1)), atol=ROUNDING_DEG)
    np.testing.assert_allclose(q[0, [1, 4, 6]], [-170.0, -90.0, 0.0], atol=ROUNDING_DEG)


def test_a_scenarios_lists_do() -> None:
    table: dict[str, Any] = {"locked_deg": [90, -90, 0], "joints": [1, 5, 6], "yaw_passes": 3, "duration_s": 60}
    assert TorusSweep(**table) == TorusSweep(yaw_passes=3, duration_s=60.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"yaw_range_deg": 352.0}, "yaw_range_deg: joint1 goes to -176 to 176 deg, expected within -175 to 175 deg"),
        ({"yaw_centre_deg": 10.0}, "yaw_range_deg: joint1 goes to -160 to 180 deg"),
        ({"pitch_range_deg": 211.0}, "pitch_range_deg: joint5"),
        ({"locked_deg": (90.0, -111.0, 0.0)}, "locked_deg: joint3 goes to -111 deg, expected within -110 to 110 deg"),
        ({"roll": "sweep", "roll_range_deg": 361.0}, "roll_range_deg: joint6"),
        ({"roll": "sweeep"}, r"unknown maneuver.roll 'sweeep': .*\(nearest: 'sweep'\)"),
        ({"corner_s": 0.0}, "corner_s: found 0.0, expected a number above 0"),
        ({"corner_s": 120.0}, "corner_s: found 120, expected at most 110.933, the time of one yaw pass"),
        ({"duration_s": -1}, "duration_s: found -1"),
        ({"duration_s": "long"}, "duration_s: found 'long'"),
        ({"rate_Hz": float("inf")}, "rate_Hz: found inf"),
        ({"rate_Hz": True}, "rate_Hz: found True"),
        ({"yaw_passes": 0}, "yaw_passes: found 0, expected a whole number of at least 1"),
        ({"pitch_passes": 7.5}, "pitch_passes: found 7.5, expected a whole number"),
        ({"locked_deg": 90.0}, "locked_deg: found 90.0, expected a list of numbers"),
        ({"locked_deg": (90.0, "x", 0.0)}, r"locked_deg\[1\]: found 'x', expected a finite number"),
        ({"joints": (1, 1, 6)}, "joints: found .*, expected three different joints of 1 to 6"),
        ({"joints": (1, 5)}, "joints: found 2 values, expected 3"),
        ({"joints": (1, 5, 9)}, "expected three different joints of 1 to 6"),
        (
            {"locked_deg": (90.0, -90.0), "joints": (1, 4, 5)},
            "limits_deg: found 6 entries, expected a pair .* each of 5 joints",
        ),
    ],
)
def test_bad_sweeps_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(RigError, match=message) as caught:
        TorusSweep(**options)
    assert "\n" not in str(caught.value)


# --- locked and static poses -----------------------------------------------------------------------------------------


def test_locked_poses_of_the_noise_procedure() -> None:
    locked = LockedPoses()
    motion = locked.trajectory()
    assert (len(motion), locked.duration_s, locked.rate_Hz) == (600_000, 600.0, 1000.0)
    poses, counts = np.unique(motion.q, axis=0, return_counts=True)
    assert len(poses) == 3
    np.testing.assert_array_equal(counts, 200_000)
    np.testing.assert_array_equal(motion.qd, 0.0)
    np.testing.assert_array_equal(motion.qdd, 0.0)
    Arm.a465().check_limits(poses, "locked")


@pytest.mark.parametrize(("hold", "rate"), [(0.1, 1000.0), (0.7, 300.0), (3.3, 70.0)])
def test_locked_poses_have_equal_numbers_of_samples(hold: float, rate: float) -> None:
    locked = LockedPoses(poses_deg=((1.0,), (2.0,), (3.0,), (4.0,)), hold_s=hold, rate_Hz=rate)
    _, counts = np.unique(locked.trajectory().q, return_counts=True)
    np.testing.assert_array_equal(counts, round(hold * rate))


def test_poses_must_be_poses() -> None:
    with pytest.raises(RigError, match=r"poses_deg\[1\]: found 2 values, expected 3"):
        LockedPoses(poses_deg=((1.0, 2.0, 3.0), (1.0, 2.0)))
    with pytest.raises(RigError, match=r"poses_deg: found .*, expected a list of poses"):
        LockedPoses(poses_deg=())
    with pytest.raises(RigError, match="hold_s: found 0"):
        LockedPoses(hold_s=0)


def test_static_poses_move_and_hold() -> None:
    wanted = (
        (0.0, 90.0, -90.0, 0.0, 0.0, 0.0),
        (100.0, 80.0, -60.0, 30.0, -90.0, 170.0),
        (-50.0, 10.0, 5.0, 0.0, 9.0, 1.0),
    )
    static = StaticPoses(poses_deg=wanted, hold_s=2.0, move_s=3.0)
    assert static.duration_s == 12.0
    motion = static.trajectory()
    assert len(motion) == 1200
    for index, pose in enumerate(wanted):
        rows = (motion.t >= index * 5.0) & (motion.t <= index * 5.0 + 2.0)
        np.testing.assert_array_equal(motion.q[rows], np.tile(np.radians(pose), (rows.sum(), 1)))
        np.testing.assert_array_equal(motion.qd[rows], 0.0)
        np.testing.assert_array_equal(motion.qdd[rows], 0.0)
        assert static.holding(motion.t[rows]).all()
    assert not static.holding(np.array([2.5, 3.5, 4.5, 8.0])).any()
    middle = joints_at(static, np.array([3.5]))
    np.testing.assert_allclose(np.degrees(middle.q[0]), np.mean(wanted[:2], axis=0), atol=ROUNDING_DEG)
    np.testing.assert_allclose(middle.qdd, 0.0, atol=1e-12)
    check_derivatives(static, np.linspace(2.003, 4.997, 3001), 2e-3)


def test_the_quintic_is_at_rest_at_both_ends() -> None:
    for found, expected in zip(
        quintic(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])), ([0, 0, 0.5, 1, 1], [0, 0, 1.875, 0, 0], [0] * 5), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def test_random_poses_are_decided_by_their_seed() -> None:
    static = StaticPoses(count=50, seed=3)
    np.testing.assert_array_equal(static.angles, StaticPoses(count=50, seed=3).angles)
    assert not np.array_equal(static.angles, StaticPoses(count=50, seed=4).angles)
    assert replace(static, count=7).angles.shape == (7, 6)
    motion = static.trajectory()
    Arm.a465().check_limits(motion.q, "static")
    assert np.degrees(np.abs(motion.qd).max()) < 180.0  # the slowest joint's limit is 171 deg/s


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"poses_deg": ((0.0, -5.0, 0.0, 0.0, 0.0, 0.0),)}, r"poses_deg\[0\]: joint2 goes to -5 deg"),
        ({"poses_deg": ((0.0,),)}, "limits_deg: found 6 entries"),
        ({"count": 0}, "count: found 0"),
        ({"seed": -1}, "seed: found -1"),
        ({"move_s": 0.0}, "move_s: found 0.0"),
    ],
)
def test_bad_static_poses_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(RigError, match=message):
        StaticPoses(**options)


def test_a_fourier_sweep_is_periodic_smooth_and_at_rest_at_its_ends() -> None:
    sweep = FourierSweep(duration_s=40.0)
    ends = joints_at(sweep, np.array([-1.0, 0.0, 40.0, 41.0]))
    np.testing.assert_allclose(
        np.degrees(ends.q), np.tile([60.0, 90.0, -90.0, 0.0, 0.0, 0.0], (4, 1)), atol=ROUNDING_DEG
    )
    np.testing.assert_allclose(ends.qd, 0.0, atol=1e-14)
    np.testing.assert_allclose(ends.qdd, 0.0, atol=1e-14)
    check_derivatives(sweep, np.linspace(1.0, 39.0, 4001), 0.05)
    motion = sweep.trajectory()
    Arm.a465().check_limits(motion.q, "sweep")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"centre_deg": (0.0,)}, "cosine_deg: found 6 rows, expected one for each of 1 joints"),
        ({"sine_deg": ((1.0,),) * 6}, "found rows of 1 beside 2 of cosine_deg"),
        ({"cosine_deg": ((400.0, -100.0), *((0.0, 0.0),) * 5)}, "centre_deg: joint1 goes to"),
        ({"duration_s": 0.0}, "duration_s: found 0"),
    ],
)
def test_bad_fourier_sweeps_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(RigError, match=message):
        FourierSweep(**options)


def test_the_limits_of_a_joint_that_slides_are_metres() -> None:
    limits = ((-175.0, 175.0), (0.0, 0.3))
    poses = ((0.0, 0.2), (10.0, 0.25))
    assert StaticPoses(poses_deg=poses, slides=(2,), limits_deg=limits).angles[1, 1] == 0.25
    with pytest.raises(RigError, match=r"poses_deg\[1\]: joint2 goes to 0.31"):
        StaticPoses(poses_deg=(poses[0], (10.0, 0.31)), slides=(2,), limits_deg=limits)
    sweep = {"cosine_deg": ((1.0,), (0.05,)), "sine_deg": ((1.0,), (0.05,)), "slides": (2,), "limits_deg": limits}
    assert FourierSweep(centre_deg=(0.0, 0.2), **sweep).trajectory().q[:, 1].max() < 0.3
    with pytest.raises(RigError, match=r"joint2 goes to 0\.179\d* to 0\.32"):
        FourierSweep(centre_deg=(0.0, 0.25), **sweep)


@pytest.mark.parametrize("name", sorted(MANEUVERS))
def test_every_maneuver_keeps_the_protocol(name: str) -> None:
    maneuver: Maneuver = MANEUVERS[name]()
    motion = maneuver.trajectory()
    assert len(motion) == round(maneuver.rate_Hz * maneuver.duration_s)
    np.testing.assert_allclose(np.diff(motion.t), 1 / maneuver.rate_Hz, rtol=1e-9)
    rows = np.array([0, 17, len(motion) - 1])
    part = maneuver.trajectory(motion.t[rows])
    for field, values in vars(part).items():
        np.testing.assert_array_equal(values, getattr(motion, field)[rows])
