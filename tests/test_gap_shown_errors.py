"""Errors that the recording itself shows: noise of logged poses beside the smooth path of an arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from whitened_examples import recorded, unexplained

from estimators.gap import diagnose
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.common import beside, common_noises
from estimators.gap.evidence.shown_errors import Shown
from rig.arm import Arm
from rig.effects import make_effect
from rig.effects.log import smooth_path
from rig.pose_nodes import quaternions
from rig.recording import Recording

SIGMA_RAD = 4e-3


@pytest.fixture(scope="module")
def run() -> Recording:
    return recorded(3, decimation=25)


def with_noise(run: Recording, arm: Arm, sigma_rad: float, seed: int = 0) -> tuple[Recording, np.ndarray]:
    """A recording whose tool's poses err by turns (n, 3) [rad], and these."""
    assert run.q is not None
    turns = sigma_rad * np.random.default_rng(seed).standard_normal((len(run), 3))
    poses = arm.poses(run.q).R_base_tool @ Rotation.from_rotvec(turns).as_matrix()
    return replace(run, q=None, tool_quaternion=quaternions(poses)), turns


def whitened(run: Recording) -> WhitenedData:
    return set_up(run, estimated_floor(run, None), None)


def test_poses_without_noise_are_their_own_smooth_path(run: Recording, arm: Arm) -> None:
    assert run.q is not None
    poses = arm.poses(run.q).R_base_tool
    assert np.abs(smooth_path(poses).errors).max() < 1e-4
    assert not smooth_path(poses[:4]).errors.any()


def test_what_a_smooth_path_shows_of_white_noise_is_all_that_it_does_not_keep(run: Recording, arm: Arm) -> None:
    """Of the variance, the share kept stays: 20,000 components tell it to 1 %, the path adds what it is rough by."""
    noisy, turns = with_noise(run, arm, SIGMA_RAD)
    assert noisy.tool_quaternion is not None
    path = smooth_path(Rotation.from_quat(noisy.tool_quaternion, scalar_first=True).as_matrix())
    left = np.mean((turns + path.errors) ** 2) / SIGMA_RAD**2
    assert left == pytest.approx(np.mean(path.hidden**2), rel=0.5)
    assert left < 0.25
    assert np.abs(smooth_path(np.tile(np.eye(3), (50, 1, 1))).errors).max() < 1e-12


def test_errors_shown_are_far_likelier_as_known_than_as_any(run: Recording, arm: Arm) -> None:
    """And the strength is told: 20,000 errors to half a per cent; what the path is rough by, to some per cent."""
    data = whitened(with_noise(run, arm, SIGMA_RAD)[0])
    noises = [each for each in common_noises(data, ()) if each.effect.name == "pose_noise"]
    assert 2 * sum(each.shown is not None for each in noises) == len(noises)
    linear = unexplained(data.whitened)
    mass, found = max(beside(linear, noises), key=lambda each: each[0])
    hidden = max(gain for gain, _ in beside(linear, [each for each in noises if each.shown is None]))
    assert mass > hidden + 100.0
    assert found.effect.sigma_rad == pytest.approx(SIGMA_RAD, rel=0.1)  # type: ignore[attr-defined]
    assert found.effect.tau_s < data.interval_s  # type: ignore[attr-defined]


def test_poses_in_no_order_are_no_noise(run: Recording, arm: Arm) -> None:
    """A maneuver that stops at random: what is rough is the path, and pose noise is as likely as before, by half."""
    assert run.q is not None
    order = np.random.default_rng(0).permutation(len(run))
    poses = quaternions(arm.poses(run.q).R_base_tool)[order]
    shuffled = replace(
        run,
        q=None,
        tool_quaternion=poses,
        accelerometer=run.accelerometer[order],  # type: ignore[index]
        magnetometer=run.magnetometer[order],  # type: ignore[index]
    )
    data = whitened(shuffled)
    noises = [each for each in common_noises(data, ()) if each.effect.name == "pose_noise"]
    linear = unexplained(data.whitened)
    hidden = [gain for gain, _ in beside(linear, [each for each in noises if each.shown is None])]
    both = [gain for gain, _ in beside(linear, noises)]
    assert max(both) == max(hidden)


@pytest.mark.parametrize("tau_s", [0.0, 1.0])
def test_the_spectrum_of_what_is_shown_tells_whether_errors_last(run: Recording, arm: Arm, tau_s: float) -> None:
    effect = make_effect("pose_noise", {"where": "acquisition", "sigma_rad": SIGMA_RAD, "tau_s": tau_s})
    data = whitened(with_noise(run, arm, 0.0)[0])
    logged = effect.apply(data.base, np.random.default_rng(2))
    moved = replace(data, base=data.pipeline.expected(logged, np.random.default_rng(0)))
    probes = [replace(effect, tau_s=each) for each in (0.0, 1.0, 10.0)]  # type: ignore[call-arg]
    shown = Shown.of(moved, probes[0])
    assert shown is not None
    shares = shown.log_shares(probes, moved.interval_s)
    assert np.logaddexp.reduce(shares) == pytest.approx(0.0, abs=1e-9)
    assert (np.argmax(shares) == 0) == (tau_s == 0.0)


def test_noise_of_poses_is_no_play_and_no_lever(run: Recording, arm: Arm) -> None:
    """A play smooths the poses, and so takes their noise out again; it is named all the same, and nothing else."""
    found = diagnose(with_noise(run, arm, SIGMA_RAD, seed=5)[0])
    assert [cause.effect for cause in found.causes if cause.probability > 0.05] == ["pose_noise"]
    sigma = found.causes[0].parameters["sigma_rad"]
    assert sigma.value == pytest.approx(SIGMA_RAD, rel=0.1)
