"""The hand's tumble: a rotation, smooth, as fast as asked for, covering what it should, still when it holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import SMALL, Rig

from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver import HandTumble
from rig.trajectory import PoseTrajectory


def angular_speed(R: Array, dt: float) -> Array:
    """(n - 1,) [rad/s] between samples."""
    trace = np.einsum("nij,nij->n", R[1:], R[:-1])
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1, 1)) / dt)


@pytest.mark.parametrize("coverage", ["full", "hemisphere"])
def test_tumble_is_a_rotation_and_decided_by_its_seed(coverage: Any) -> None:
    tumble = HandTumble(seed=5, coverage=coverage)
    motion = tumble.trajectory()
    assert isinstance(motion, PoseTrajectory)
    assert len(motion) == 12_000
    product = motion.R_base_tool @ np.swapaxes(motion.R_base_tool, 1, 2)
    np.testing.assert_allclose(product, np.tile(np.eye(3), (12_000, 1, 1)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(motion.R_base_tool), 1.0, rtol=0, atol=1e-14)
    again = HandTumble(seed=5, coverage=coverage).trajectory(motion.t[::100])
    np.testing.assert_array_equal(again.R_base_tool, motion.R_base_tool[::100])
    np.testing.assert_array_equal(again.position, motion.position[::100])
    other = HandTumble(seed=6, coverage=coverage).trajectory()
    assert np.abs(other.R_base_tool - motion.R_base_tool).max() > 1
    # Smooth: the sensor turns by its speed times a period, here up to ten times the RMS of 60 deg/s.
    assert angular_speed(motion.R_base_tool, 0.01).max() < np.radians(600)


@pytest.mark.parametrize("hold", [0.0, 1.0])
def test_tumbles_acceleration_is_the_second_difference_of_its_position(hold: float) -> None:
    tumble = HandTumble(seed=1, hold_s=hold, sway_m=0.05, duration_s=30.0)
    t = np.linspace(0.5, 29.5, 5000)
    exact = tumble.trajectory(t).acceleration
    errors = []
    for h in (4e-3, 2e-3):
        before, here, after = (tumble.trajectory(t + shift).position for shift in (-h, 0.0, h))
        errors.append((after - 2 * here + before) / h**2 - exact)
    assert np.abs(exact).max() > 0.1
    assert np.sqrt(np.mean(errors[0] ** 2)) < 1e-3 * np.abs(exact).max()
    # Stopping has a jump in jerk, whose error falls with h instead of h^2.
    assert np.linalg.norm(errors[0]) / np.linalg.norm(errors[1]) == pytest.approx(4.0, rel=0.02 if hold == 0 else 0.2)


@pytest.mark.parametrize("coverage", ["full", "hemisphere"])
def test_tumbles_speed_is_the_rms_asked_for(coverage: Any) -> None:
    """Mean square over 600 independent seeds, against the expectation for Gaussian signals.

    Eight sinusoids are not quite Gaussian: 3,000 seeds give 0.989 +- 0.011 and 1.006 +- 0.008 of it, so 2 % are allowed
    for that; beyond it, four standard errors, about 10 %: a false failure in 16,000.
    """
    t, dt = np.arange(20) * 3.0, 1e-3
    squares = []
    for seed in range(600):
        tumble = HandTumble(seed=seed, coverage=coverage, speed_deg_per_s=40.0)
        R = np.stack([tumble.trajectory(t).R_base_tool, tumble.trajectory(t + dt).R_base_tool])
        squares.append(np.mean(np.sum((R[1] - R[0]) ** 2, axis=(1, 2)) / 2 / dt**2))
    relative = np.array(squares) / np.radians(40.0) ** 2
    error = relative.std(ddof=1) / np.sqrt(len(relative))
    assert relative.mean() == pytest.approx(1.0, abs=0.02 + 4 * error)
    assert error < 0.05  # or the comparison would say nothing


def test_full_coverage_is_uniform_and_the_hemispheres_too() -> None:
    """The vertical, seen by the sensor, uniform on its sphere or upper half: mean and mean square of each component.

    200 independent seeds, one instant each; a uniform component has variance 1/3 (full) and the height on a hemisphere
    mean 1/2, variance 1/12. Four standard errors, six and three comparisons: a false failure in 1,700. The hemisphere's
    height departs from uniform by less than .02, as eight sinusoids are not quite Gaussian.
    """
    t = np.array([17.0])
    full = np.array([HandTumble(seed=seed).trajectory(t).R_base_tool[0, 2] for seed in range(200)])
    half = np.array(
        [HandTumble(seed=seed, coverage="hemisphere").trajectory(t).R_base_tool[0, 2] for seed in range(200)]
    )
    np.testing.assert_allclose(full.mean(axis=0), 0.0, atol=4 * np.sqrt(1 / 3 / 200))
    np.testing.assert_allclose((full**2).mean(axis=0), 1 / 3, atol=4 * np.sqrt(4 / 45 / 200))
    np.testing.assert_allclose(half[:, :2].mean(axis=0), 0.0, atol=4 * np.sqrt(1 / 3 / 200))
    assert half[:, 2].mean() == pytest.approx(0.5, abs=0.02 + 4 * np.sqrt(1 / 12 / 200))


def test_a_hemispheres_tumble_never_tips_over() -> None:
    for seed in range(10):
        height = HandTumble(seed=seed, coverage="hemisphere").trajectory().R_base_tool[:, 2, 2]
        assert height.min() > 0
        assert height.min() < 0.2
        assert height.max() > 0.9


def test_holds_are_still_and_as_long_as_asked() -> None:
    tumble = HandTumble(seed=2, duration_s=50.0, hold_s=3.0, move_s=2.0)
    motion = tumble.trajectory()
    for stop in range(10):
        rows = (motion.t >= 5.0 * stop) & (motion.t <= 5.0 * stop + 3.0)
        assert tumble.holding(motion.t[rows]).all()
        assert np.ptp(motion.R_base_tool[rows], axis=0).max() == 0
        assert np.ptp(motion.position[rows], axis=0).max() == 0
        np.testing.assert_array_equal(motion.acceleration[rows], 0.0)
    assert np.mean(tumble.holding(motion.t)) == pytest.approx(0.6, abs=0.01)
    ends = tumble.trajectory(np.arange(10) * 5.0).R_base_tool
    turned = angular_speed(ends, 1.0)
    assert np.degrees(turned).min() > 10  # every hold in a pose of its own
    assert not HandTumble(seed=2).holding(motion.t).any()


def test_a_tumble_without_sway_has_no_acceleration() -> None:
    motion = HandTumble(sway_m=0.0).trajectory()
    assert not motion.position.any()
    assert not motion.acceleration.any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"coverage": "fulll"}, r"unknown maneuver.coverage 'fulll': .*\(nearest: 'full'\)"),
        ({"seed": 1.5}, "seed: found 1.5"),
        ({"hold_s": -1.0}, "hold_s: found -1.0, expected a number of at least 0"),
        ({"speed_deg_per_s": 0.0}, "speed_deg_per_s: found 0.0"),
    ],
)
def test_bad_tumbles_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(RigError, match=message):
        HandTumble(**options)


def test_the_bound_of_a_tumble_is_of_gain_and_offset(rig: Rig, here: Path) -> None:
    swept = SMALL[: SMALL.index("[locked]")]
    tumbled = swept.replace('kind = "torus-sweep"\nduration_s = 60.0', 'kind = "hand-tumble"\n[arm]\nmodel = "none"')
    Path("tumble.toml").write_text(tumbled)
    text = rig.done("bound", "tumble.toml")
    assert text.count("without attitude, symmetric gain") == 2
    assert "offset1" in text
    assert "gain [% of the largest]" in text
