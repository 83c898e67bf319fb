"""Effects of time against the continuous truth, and the filters that they and others are made of."""

from __future__ import annotations

from dataclasses import replace

import effects_reference as reference
import numpy as np
import pytest
from arm_files import IMU_M
from effects_reference import AXES, OFFSET, SENSITIVITY, readings
from effects_rig import TIMES, made, measured, pipeline, signals, volts
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rig.arm import Arm
from rig.arrays import Array
from rig.effects._gravity import gravity_torque, largest_gravity_torque
from rig.effects._numerics import curvature, low_passed, play, recursion, shifted
from rig.errors import RigError

COLUMNS = {"acquisition": slice(0, 6), "accelerometer": slice(0, 3), "magnetometer": slice(3, 6)}
STEP = float(TIMES[1] - TIMES[0])

#: A spline's end conditions are felt (2 - sqrt 3)^k k samples inside: 4e-12 of their error is left after this many.
ENDS = 20


def spline_error(t: Array) -> Array:
    """(6,) bound on the error of a cubic spline through the readings: 5/384 h^4 max |V''''|, by differences."""
    fine = readings(np.arange(t[0], t[-1], 0.5))
    return np.asarray(5.0 / 384.0 * STEP**4 * np.abs(np.diff(fine, 4, axis=0)).max(axis=0) / 0.5**4)


@pytest.mark.parametrize("where", COLUMNS)
@pytest.mark.parametrize("delay", [0.07, -0.3, 1.1])
def test_latency_reads_what_was_there_a_delay_ago(where: str, delay: float) -> None:
    late = volts(made("latency", where, delay_s=delay))
    expected = readings(TIMES)
    expected[:, COLUMNS[where]] = readings(TIMES - delay)[:, COLUMNS[where]]
    error = np.abs(late - expected)[ENDS:-ENDS].max(axis=0)
    assert (error <= spline_error(TIMES) * 1.5 + 1e-12).all()  # 1.5: the fourth derivative between its samples
    beyond = (TIMES - delay < TIMES[0]) | (TIMES - delay > TIMES[-1])
    edge = readings(TIMES)[0 if delay > 0 else -1, COLUMNS[where]]
    np.testing.assert_allclose(late[beyond][:, COLUMNS[where]], np.tile(edge, (beyond.sum(), 1)), atol=1e-12)


@pytest.mark.parametrize("where", ["accelerometer", "magnetometer"])
@pytest.mark.parametrize("tau", [1e-3, 0.05, 0.6])
def test_a_lag_is_the_low_pass_of_the_continuous_reading(where: str, tau: float) -> None:
    """The filter's response to the true reading, integrated in steps of 5 ms by the exact rule for straight lines.

    Straight lines through 5 ms are off by (5 ms)^2/8 max |V''|; the effect's spline by ``spline_error``; and the
    filter passes no error on enlarged.
    """
    fine_step = 5e-3
    fine_t = np.arange(TIMES[0], TIMES[0] + 20.0 + fine_step / 2, fine_step)
    x = readings(fine_t)
    y = np.empty_like(x)
    y[0] = x[0]
    decay = np.exp(-fine_step / tau)
    for row in range(len(x) - 1):  # tau y' + y = x, x a straight line
        slope = (x[row + 1] - x[row]) / fine_step
        y[row + 1] = x[row + 1] - tau * slope + decay * (y[row] - x[row] + tau * slope)
    every = round(STEP / fine_step)
    expected = y[::every]
    lagging = volts(made("sensor_lag", where, tau_s=tau))[: len(expected)]
    lines = fine_step**2 / 8.0 * np.abs(np.diff(x, 2, axis=0)).max(axis=0) / fine_step**2
    bound = 1.5 * spline_error(TIMES) + lines + 1e-12
    # The start's end condition: its error, at most a dozen times that of the middle, fades as above and as the filter.
    fade = 1.0 + 12.0 * np.maximum(0.2679 ** np.arange(len(expected)), np.exp(-np.arange(len(expected)) * STEP / tau))
    own = COLUMNS[where]
    assert (np.abs(lagging - expected)[:, own] <= (fade[:, None] * bound)[:, own]).all()
    assert np.array_equal(np.delete(lagging, own, axis=1), np.delete(volts()[: len(expected)], own, axis=1))


def site(t: Array, lever: Array) -> Array:
    """(n, 3) [m] the path of a point of the tool, ``lever`` away from the model's sensor."""
    path = []
    for q in reference.joint_angles(t):
        frame = reference.frames(q)[6]
        path.append(frame[:3, 3] + frame[:3, :3] @ (lever + np.array([0.0, 0.0, IMU_M])))
    return np.array(path)


@pytest.mark.parametrize("lever", [(0.0, 0.0, 0.0), (0.02, -0.03, 0.05), (0.3, 0.1, 0.0)])
@pytest.mark.parametrize("measured_poses", [False, True])
def test_motion_acceleration_is_that_of_the_site(lever: tuple[float, ...], measured_poses: bool) -> None:
    """The truth by differences of the exact path over 10 ms; those over h = 0.25 s are off by h^2/12 max |p''''|."""
    arm = np.array(lever)
    h = 0.01
    acceleration = (site(TIMES + h, arm) - 2.0 * site(TIMES, arm) + site(TIMES - h, arm)) / h**2
    fourth = np.linalg.norm(np.diff(site(np.arange(TIMES[0], TIMES[-1], 0.25), arm), 4, axis=0), axis=1).max() / 0.25**4
    bound = STEP**2 / 12.0 * fourth * 1.5 + 1e-9  # rounding of a metre over (10 ms)^2: 1e-11

    recording = measured() if measured_poses else signals()
    effect = made("motion_acceleration", lever_m=lever)
    found = pipeline(effect).expected(recording, np.random.default_rng(0))
    error = np.linalg.norm(found.acceleration - acceleration, axis=1)[1:-1]  # the ends repeat their neighbours
    assert np.linalg.norm(acceleration, axis=1).max() > 20.0 * bound
    assert error.max() <= bound

    R = np.array([reference.frames(q)[6][:3, :3] for q in reference.joint_angles(TIMES)])
    felt = np.einsum("nij,ni->nj", R, reference.GRAVITY - found.acceleration) @ AXES[:3].T
    np.testing.assert_allclose(found.volts[:, :3], felt * SENSITIVITY[:3] + OFFSET[:3], atol=1e-12)


@pytest.mark.parametrize("cycles", [0.02, 0.125, 0.25])
def test_samples_far_apart_keep_the_acceleration(cycles: float) -> None:
    """Of a sine of so many cycles a sample, w = 2 pi times that: a second difference loses w^2/12 of it, a fifth at a
    quarter of the rate; w^4/360 may be off, and what higher orders add."""
    turn = 2.0 * np.pi * cycles
    path = np.sin(turn * np.arange(400.0) + 0.3)[:, None]
    found = curvature(0.25 * np.arange(400.0), path)[20:-20] / -((turn / 0.25) ** 2)
    np.testing.assert_allclose(found, path[20:-20], rtol=0.0, atol=turn**4 / 350.0 + 1e-9)


def test_motion_acceleration_agrees_with_the_exact_one_and_does_not_add_it_twice() -> None:
    t = np.arange(400) * 0.01 + 5.0
    q, h = reference.joint_angles(t), 1e-3
    later, sooner = reference.joint_angles(t + h), reference.joint_angles(t - h)
    exact = Arm.a465().site_acceleration(q, (later - sooner) / (2.0 * h), (later - 2.0 * q + sooner) / h**2)
    base = signals(t)
    rng = np.random.default_rng(0)
    approximate = pipeline(made("motion_acceleration", lever_m=(0.0, 0.0, 0.0))).expected(base, rng)
    # The parabola spans 0.1 s of motions below 0.25 rad/s: (0.25 * 0.05)^2/5 = 3e-5 of what there is; and rounding of
    # 1e-16 m in (0.01 s)^2, of q in (1 ms)^2.
    scale = np.linalg.norm(exact, axis=1).max()
    assert np.abs(approximate.acceleration - exact)[6:-6].max() < 1e-4 * scale + 1e-8
    lever = made("motion_acceleration")
    moving = pipeline(lever).expected(replace(base, acceleration=exact), rng)
    alone = pipeline(lever).expected(base, rng)
    assert np.abs(moving.acceleration - alone.acceleration)[6:-6].max() < 1e-4 * scale + 1e-8


@given(
    arrays(float, st.integers(1, 200), elements=st.floats(-2.0, 2.0, width=16)), st.floats(1e-6, 3.0, allow_nan=False)
)
def test_the_play_operator_is_its_recursion(x: Array, half_width: float) -> None:
    expected = [x[0]]
    for value in x[1:]:
        expected.append(min(max(expected[-1], value - half_width), value + half_width))
    given_ = x.copy()
    assert np.array_equal(play(x, half_width), expected)
    assert np.array_equal(x, given_)


def test_the_recursion_is_its_recursion() -> None:
    rng = np.random.default_rng(4)
    decay, drive = rng.uniform(0.0, 1.0, 99), rng.standard_normal((100, 3))
    expected = [drive[0]]
    for row in range(99):
        expected.append(decay[row] * expected[-1] + drive[row + 1])
    np.testing.assert_allclose(recursion(decay, drive), expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("tau", [1e-4, 0.1, 3.0])
def test_the_low_pass_of_a_cubic_is_exact(tau: float) -> None:
    """x = t^3 is its own spline, at uneven samples too; tau y' + y = t^3, y(0) = 0 has a closed solution."""
    t = np.sort(np.r_[0.0, np.random.default_rng(5).uniform(0.0, 3.0, 50)])
    forced = t**3 - 3.0 * tau * t**2 + 6.0 * tau**2 * t - 6.0 * tau**3
    expected = forced + 6.0 * tau**3 * np.exp(-t / tau)
    np.testing.assert_allclose(low_passed(t, (t**3)[:, None], tau)[:, 0], expected, rtol=1e-11, atol=1e-10)


def test_a_shift_leaves_a_missing_sensor_alone() -> None:
    t = np.arange(10.0)
    x = np.stack([t**3, np.full(10, np.nan)], axis=1)
    out = shifted(t, x, t - 0.5)
    np.testing.assert_allclose(out[1:, 0], (t[1:] - 0.5) ** 3, rtol=1e-12)
    assert out[0, 0] == 0.0
    assert np.isnan(out[:, 1]).all()


@pytest.mark.parametrize("rate", [4.0, 100.0])
@pytest.mark.parametrize("even", [True, False])
def test_the_curvature_of_a_parabola_is_exact(rate: float, even: bool) -> None:
    t = np.arange(300) / rate
    if not even:
        t = t + np.random.default_rng(6).uniform(-0.3, 0.3, 300) / rate
    path = np.stack([1.0 + 2.0 * t - 3.0 * t**2, 0.5 * t**2], axis=1)
    # Rounding of the path (3 (300/rate)^2 m) over the span of the parabola squared.
    rounding = 1e-15 * np.abs(path).max() / min(0.04, 1.0 / rate) ** 2 * 10.0
    np.testing.assert_allclose(curvature(t, path), np.tile([-6.0, 1.0], (300, 1)), atol=rounding)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_few_samples_have_what_curvature_they_have(count: int) -> None:
    t = np.arange(float(count))
    expected = 2.0 if count >= 3 else 0.0
    np.testing.assert_allclose(curvature(t, t[:, None] ** 2), np.full((count, 1), expected), atol=1e-13)


@pytest.mark.parametrize("moving", [(0, 4, 5), (1, 2), (0, 1, 2, 3, 4, 5), ()])
def test_gravity_torque_by_interpolation_is_that_of_each_sample(moving: tuple[int, ...]) -> None:
    """The interpolation is exact: some 10 N m from some 27 poses leave 1e-13 N m of rounding; (): a single pose."""
    arm = Arm.a465()
    q = np.tile([0.3, 1.4, -1.2, 0.4, 0.2, 0.7], (100, 1))
    q[:, list(moving)] = np.random.default_rng(8).uniform(-np.pi, np.pi, (100, len(moving)))
    for joint in (1, 2, 4):
        each = np.concatenate([gravity_torque(arm, row[None], joint) for row in q])
        np.testing.assert_allclose(gravity_torque(arm, q, joint), each, atol=1e-12)
        assert np.abs(each).max() <= largest_gravity_torque(arm, joint) * (1.0 + 1e-12)


def test_an_arm_without_weight_cannot_droop() -> None:
    with pytest.raises(RigError, match="gravity does not load joint1"):
        largest_gravity_torque(Arm.a465(), 0)  # its axis is vertical


@pytest.mark.parametrize(("name", "parameter"), [("latency", "delay_s"), ("sensor_lag", "tau_s")])
def test_a_short_delay_is_a_short_lag(name: str, parameter: str) -> None:
    """Both are minus the slope times the time, to first order: what makes them twins; the rest is of second order."""
    base = volts()
    slope = (readings(TIMES + 1e-4) - readings(TIMES - 1e-4)) / 2e-4
    where = "magnetometer"
    for size in (1e-4, 1e-3):
        change = (volts(made(name, where, **{parameter: size})) - base)[ENDS:-ENDS, 3:]
        expected = -size * slope[ENDS:-ENDS, 3:]
        assert np.abs(change - expected).max() < 10.0 * size * np.abs(expected).max() + 1e-12
