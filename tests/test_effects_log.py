"""Errors of the log of the tool's poses: what they do to the log, and what can be made of it again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effects_rig import ENVIRONMENT, SENSORS, logged, made, measured, pipeline, signals
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from rig.acquisition import Acquisition
from rig.arm import Arm
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.errors import RigError
from rig.maneuver import TorusSweep
from rig.pipeline import Pipeline
from rig.signals import Signals
from rig.simulate import Rig

#: Tail of every interval below; there are some thirty.
TAIL = 1e-7
FAST = np.arange(4000) * 0.02 + 3.0
INTERVAL_S = 0.15


def angle(first: Array, second: Array) -> Array:
    """(n,) [rad] between orientations."""
    return np.asarray((Rotation.from_matrix(first).inv() * Rotation.from_matrix(second)).magnitude())


def interpolated(jitter_s: float = 0.0, seed: int = 0, interval_s: float = INTERVAL_S) -> Signals:
    effect = made("pose_interpolation", node_interval_s=interval_s, jitter_s=jitter_s)
    return effect.log(measured(FAST), np.random.default_rng(seed))


@pytest.mark.parametrize("interval_s", [INTERVAL_S, 0.074, 0.062])
def test_the_nodes_of_a_log_are_found_between_and_on_samples(interval_s: float) -> None:
    """To a hundredth of a sample: what a turn at 0.25 rad/s bends two chords moves their corner by less. Where the path
    is straight there is no kink: there nodes are put at even steps, which a few of them at the seams are not. At three
    or four samples a node, most samples are beside one."""
    nodes = interpolated(interval_s=interval_s).pose_nodes
    assert nodes is not None
    expected = np.append(np.arange(FAST[0], FAST[-1], interval_s), FAST[-1])
    found = nodes.t[np.abs(nodes.t[:, None] - expected).min(axis=1) < 4e-4]
    assert len(found) > 0.95 * len(expected)
    assert nodes.interval_s == pytest.approx(interval_s, rel=1e-3)


@pytest.mark.parametrize("kind", ["smooth", "noisy", "short", "still"])
def test_a_log_that_is_not_made_of_chords_has_no_nodes(kind: str) -> None:
    poses = measured(FAST)
    if kind == "noisy":
        poses = made("pose_noise", sigma_rad=1e-4, tau_s=0.0).log(poses, np.random.default_rng(1))
    elif kind == "short":
        poses = measured(FAST[:20])
    elif kind == "still":
        poses = replace(poses, R_base_tool=poses.R_base_tool[:1].repeat(len(FAST), axis=0))
        poses = replace(poses, position=poses.position[:1].repeat(len(FAST), axis=0))
    assert poses.pose_nodes is None
    assert signals(FAST).pose_nodes is None
    assert EFFECTS["pose_interpolation"].lacking(poses)


def test_the_path_through_the_nodes_is_nearer_to_the_motion_than_the_chords() -> None:
    """A cubic spline's error is some (h w)^2/12 of the chords', 1e-4 at w = 0.25 rad/s; a tenth allows for its ends."""
    truth, log = measured(FAST), interpolated()
    again = made("pose_interpolation", node_interval_s=INTERVAL_S).apply(log, np.random.default_rng(0))
    inner = slice(50, -50)
    before = angle(truth.R_base_tool, log.R_base_tool)[inner]
    after = angle(truth.R_base_tool, again.R_base_tool)[inner]
    assert np.sqrt(np.mean(after**2)) < 0.1 * np.sqrt(np.mean(before**2))
    moved = [np.linalg.norm(each.position - truth.position, axis=1)[inner] for each in (log, again)]
    assert np.sqrt(np.mean(moved[1] ** 2)) < 0.1 * np.sqrt(np.mean(moved[0] ** 2))


def test_stamps_that_scatter_are_evened() -> None:
    """5 ms of scatter, averaged over 13 nodes: the path is off by less than half of what the log is."""
    truth, log = measured(FAST), interpolated(jitter_s=5e-3)
    again = made("pose_interpolation", node_interval_s=INTERVAL_S).apply(log, np.random.default_rng(0))
    inner = slice(50, -50)
    before, after = (angle(truth.R_base_tool, each.R_base_tool)[inner] for each in (log, again))
    assert np.sqrt(np.mean(after**2)) < 0.5 * np.sqrt(np.mean(before**2))


def test_the_interval_is_recovered_from_readings() -> None:
    """Readings of the true motion, against the log: within five standard deviations of the interval, and 3 % for the
    spline's own error, (2 s x 0.25 rad/s)^2/12 = 2 % of the chords'."""
    sigma, interval_s = 1e-3, 2.0
    log = made("pose_interpolation", node_interval_s=interval_s).log(measured(FAST), np.random.default_rng(0))
    rng = np.random.default_rng(2)
    readings = pipeline().expected(measured(FAST), rng).volts + sigma * rng.standard_normal((len(FAST), 6))
    base = pipeline().expected(log, rng).volts
    one = pipeline(made("pose_interpolation", node_interval_s=interval_s)).expected(log, rng).volts - base
    share = float(np.sum(one * (readings - base)) / np.sum(one**2))
    spread = sigma / float(np.linalg.norm(one))
    assert spread < 0.05
    assert abs(share - 1.0) < 5.0 * spread + 0.03


@pytest.mark.parametrize("tau", [0.0, 0.5])
def test_pose_noise_is_a_turn_that_all_channels_see(tau: float) -> None:
    """The change is the response times the turns, to second order of a turn of 1e-5 rad; and these are as stated."""
    sigma = 1e-5
    effect = made("pose_noise", sigma_rad=sigma, tau_s=tau)
    base = pipeline().expected(measured(FAST), np.random.default_rng(0))
    response = effect.response(base, pipeline())
    change = pipeline(effect).expected(measured(FAST), np.random.default_rng(3)).volts - base.volts
    turned = effect.apply(base, np.random.default_rng(3)).R_base_tool
    turns = (Rotation.from_matrix(base.R_base_tool).inv() * Rotation.from_matrix(turned)).as_rotvec()
    np.testing.assert_allclose(np.einsum("nkr,nr->nk", response, turns), change, atol=1e3 * sigma**2)
    frequency = np.fft.rfftfreq(len(FAST))[1:-1]
    stated = sigma**2 * effect.added_spectrum(frequency, 0.02)
    for axis in turns.T:
        ratio = np.abs(np.fft.rfft(axis)[1:-1]) ** 2 / len(FAST) / stated
        for band in np.array_split(ratio, 4):
            low, high = chi2.ppf([TAIL, 1.0 - TAIL], 2 * len(band)) / (2 * len(band))
            assert low * 0.98 <= band.mean() <= high * 1.02  # leakage: a memory of 0.5 s over 80 s


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.kind is Kind.NOISE])
def test_the_stated_variance_is_what_a_noise_effect_adds(name: str) -> None:
    """Mean square of the change of 200 recordings over the stated, all samples and channels together: its degrees of
    freedom are at least those of 200 x 3 independent numbers. Jitter to 1e-3 s x 0.5 rad/s; a walk on average."""
    small = {"timing_jitter": {"sigma_s": 1e-4}, "pose_noise": {"sigma_rad": 1e-5, "tau_s": 0.1}}.get(name, {})
    effect = made(name, **small)  # type: ignore[arg-type]
    t = FAST[:400]
    before = measured(t) if effect.of_log else signals(t)
    base = pipeline().expected(before, np.random.default_rng(0))
    stated = effect.added_variance(base, pipeline())
    added = np.zeros_like(base.volts)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        through = pipeline(effect).expected(before, rng)
        if effect.stage is EFFECTS["noise_excess"].stage:
            through = effect.apply(through, rng)
        change = through.volts - base.volts
        if name == "bias_random_walk":
            change = change - change.mean(axis=0)  # its mean square is that of all but the constant cosine
        added += change**2 / 200.0
    touched = stated.max(axis=0) > 0.0
    low, high = chi2.ppf([TAIL, 1.0 - TAIL], 600) / 600
    assert np.array_equal(touched, added.max(axis=0) > 0.0)
    assert low <= added[:, touched].sum() / stated[:, touched].sum() <= high


def test_jitter_of_the_stamps_is_the_slope_times_straight_lines_between_nodes() -> None:
    """The spectrum of straight lines between independent nodes, by the periodogram of the error that was made."""
    sigma = 1e-3
    effect = made("pose_interpolation", node_interval_s=0.2, jitter_s=sigma)
    rng = np.random.default_rng(5)
    nodes = np.arange(0.0, len(FAST) * 0.02 + 0.2, 0.2)
    error = np.interp(np.arange(len(FAST)) * 0.02, nodes, rng.standard_normal(len(nodes)))
    frequency = np.fft.rfftfreq(len(FAST))[1:-1]
    ratio = np.abs(np.fft.rfft(error)[1:-1]) ** 2 / len(FAST) / effect.added_spectrum(frequency, 0.02)
    band = ratio[frequency < 0.03]  # most of the power, far from the first zero at 0.1
    low, high = chi2.ppf([TAIL, 1.0 - TAIL], 2 * len(band)) / (2 * len(band))
    assert low * 0.98 <= band.mean() <= high * 1.02
    assert effect.adds_in_time
    base = pipeline().expected(logged(), np.random.default_rng(0))
    assert effect.response(base, pipeline()).shape == (*base.volts.shape, 1)


def rig_of(*effects: Effect, pose: str = "tool") -> Rig:
    acquisition = Acquisition(range_V=None, bits=None, decimation=1, pose=pose)  # type: ignore[arg-type]
    return Rig(Arm.a465(), ENVIRONMENT, SENSORS[0], SENSORS[1], acquisition, effects)


def test_the_simulator_spoils_the_log_and_not_the_readings() -> None:
    sweep = TorusSweep(duration_s=60.0, rate_Hz=50.0, yaw_passes=3, pitch_passes=2)
    clean = rig_of().simulate(sweep, np.random.default_rng(0))
    for effect in (made("pose_interpolation", node_interval_s=0.1), made("pose_noise", tau_s=0.0)):
        spoilt = rig_of(effect).simulate(sweep, np.random.default_rng(0))
        assert spoilt.accelerometer is not None
        assert np.array_equal(spoilt.accelerometer, clean.accelerometer)
        assert not np.allclose(spoilt.tool_quaternion, clean.tool_quaternion, atol=1e-6)
        with pytest.raises(RigError, match="expected 'tool'"):
            rig_of(effect, pose="joints").simulate(sweep, np.random.default_rng(0))


def test_what_logs_the_tools_pose_does_not_see_the_sensor_slip_on_it() -> None:
    sweep = TorusSweep(duration_s=60.0, rate_Hz=10.0, yaw_passes=3, pitch_passes=2)
    clean = rig_of().simulate(sweep, np.random.default_rng(0))
    slipped = rig_of(made("mounting_slip")).simulate(sweep, np.random.default_rng(0))
    rocked = rig_of(made("base_rocking")).simulate(sweep, np.random.default_rng(0))
    assert np.array_equal(slipped.tool_quaternion, clean.tool_quaternion)
    assert not np.array_equal(slipped.magnetometer, clean.magnetometer)
    assert not np.array_equal(rocked.tool_quaternion, clean.tool_quaternion)


def test_a_common_latency_and_one_of_a_sensor_add_up() -> None:
    """To a spline of a spline: the error of one at these slow motions, 5/384 (0.25 s)^4 of the fourth derivative."""
    together = made("latency", "acquisition", delay_s=0.03), made("latency", "magnetometer", delay_s=0.05)
    plain = Pipeline(ENVIRONMENT, SENSORS[0], SENSORS[1])
    found = replace(plain, effects=together).expected(signals(), np.random.default_rng(0)).volts
    accelerometer = replace(plain, effects=together[:1]).expected(signals(), np.random.default_rng(0)).volts
    magnetometer = replace(plain, effects=(made("latency", "magnetometer", delay_s=0.08),))
    late = magnetometer.expected(signals(), np.random.default_rng(0)).volts
    assert np.array_equal(found[:, :3], accelerometer[:, :3])
    np.testing.assert_allclose(found[20:-20, 3:], late[20:-20, 3:], atol=1e-5)
