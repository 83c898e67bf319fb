"""Sufficient statistics: the same sums by every way, their algebra, and draws that are as good as noise on samples."""

from __future__ import annotations

from functools import reduce
from itertools import pairwise
from operator import add

import numpy as np
import pytest
from kinematic_examples import TRUTHS, readings, sweep_angles, sweep_rotations, sweep_statistics
from scipy.spatial.transform import Rotation
from scipy.special import chdtr
from statistics_draws import draw, wishart_root

from estimators.known_angle.statistics import BLOCK, ROTATION_TERMS, Statistics
from rig.arm import Arm
from rig.errors import RigError

EPS = np.finfo(float).eps


def example(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Quaternions (n, 4), rotations (n, 9) and readings of two sensors (n, 3)."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(n, rng=rng)
    quaternion = turns.as_quat(scalar_first=True)
    return quaternion, turns.as_matrix().reshape(n, 9), rng.normal(2.5, 1.0, (n, 3)), rng.normal(0.0, 30.0, (n, 3))


def assert_close(found: Statistics, expected: Statistics, units: float = 50.0) -> None:
    """To ``units`` roundings of the largest sum of each kind: sums of n terms of one size lose a few."""
    assert found.count == expected.count
    for name in ("gram", "cross", "square"):
        a, b = getattr(found, name), getattr(expected, name)
        assert np.abs(a - b).max() <= units * EPS * max(np.abs(b).max(), 1e-300), name


@pytest.mark.parametrize("n", [1, 7, BLOCK - 1, BLOCK, 2 * BLOCK + 5])
def test_sums_are_those_of_the_definition(n: int) -> None:
    _, rotations, first, second = example(n)
    x = np.hstack([rotations, np.ones((n, 1))])
    volts = np.hstack([first, second])
    expected = Statistics(n, x.T @ x, x.T @ volts, volts.T @ volts)
    assert_close(Statistics.from_rotations(rotations, first, second), expected)
    assert_close(Statistics.from_rotations(rotations.reshape(n, 3, 3), volts), expected)


def test_no_sample_adds_nothing() -> None:
    _, rotations, first, _ = example(10)
    some = Statistics.from_rotations(rotations, first)
    assert_close(some + Statistics.from_rotations(np.empty((0, 9)), np.empty((0, 3))), some, units=0.0)


def test_quaternions_give_the_sums_of_their_rotation_matrices() -> None:
    quaternion, rotations, first, second = example(3000)
    expected = Statistics.from_rotations(rotations, first, second)
    assert_close(Statistics.from_quaternions(quaternion, first, second), expected)
    assert_close(Statistics.from_quaternions(-quaternion, first, second), expected)


def test_quaternions_of_other_lengths_are_normalised() -> None:
    quaternion, rotations, first, _ = example(3000)
    lengths = np.random.default_rng(1).uniform(0.999, 1.001, (3000, 1))
    found = Statistics.from_quaternions(quaternion * lengths, first)
    assert_close(found, Statistics.from_rotations(rotations, first))
    one_off = quaternion.copy()
    one_off[17] *= 1.0005
    assert_close(Statistics.from_quaternions(one_off, first), Statistics.from_rotations(rotations, first))


def test_joint_angles_give_the_sums_of_the_arms_rotations() -> None:
    q = sweep_angles()
    rng = np.random.default_rng(2)
    volts = rng.normal(2.5, 1.0, (len(q), 6))
    rotations = Arm.a465().poses(q).R_base_tool  # MuJoCo's kinematics
    found = Statistics.from_joints(Arm.a465().rotation_map, q, volts[:, :3], volts[:, 3:])
    assert_close(found, Statistics.from_rotations(rotations, volts))


def test_they_add() -> None:
    _, rotations, first, second = example(1000)
    whole = Statistics.from_rotations(rotations, first, second)
    cuts = [0, 1, 300, 999, 1000]
    parts = [Statistics.from_rotations(rotations[a:b], first[a:b], second[a:b]) for a, b in pairwise(cuts)]
    assert_close(reduce(add, parts), whole)
    assert_close(parts[3] + parts[1] + parts[0] + parts[2], whole)
    assert_close(whole.select(slice(3, 6)), Statistics.from_rotations(rotations, second))


def test_a_million_small_parts_lose_no_more_than_their_rounding() -> None:
    """Adding one part 100,000 times: the sum's error grows by at most eps a step, and is far below the residuals'."""
    _, rotations, first, _ = example(50)
    part = Statistics.from_rotations(rotations, first)
    total = part
    for _ in range(99_999):
        total = total + part
    assert np.abs(total.square / (1e5 * part.square) - 1.0).max() < 1e5 * EPS
    assert total.count == 5_000_000


def test_wrong_inputs_are_refused() -> None:
    _, rotations, first, _ = example(10)
    with pytest.raises(RigError, match=r"shape \(9, 3\), expected one row for each of 10 poses"):
        Statistics.from_rotations(rotations, first[:9])


def test_draws_are_distributed_as_noise_on_every_sample() -> None:
    """The projected noise, whitened, is standard normal; what is left of the squares is chi-square with n - 10 degrees.

    33 comparisons at four standard errors and three Kolmogorov distances at a level of 1 in 8,000: together they fail
    by chance for one seed in 400.
    """
    truth, noise = TRUTHS["table10"]
    base = sweep_statistics(100)
    rng = np.random.default_rng(0)
    draws = 4000
    whiten = np.linalg.inv(np.linalg.cholesky(base.gram))
    projected, left = np.empty((draws, ROTATION_TERMS, 3)), np.empty((draws, 3, 3))
    for i in range(draws):
        drawn = draw(base, rng, truth.coefficients, noise)
        projected[i] = whiten @ (drawn.cross - base.gram @ truth.coefficients) / noise
        left[i] = (drawn.square - drawn.cross.T @ np.linalg.solve(base.gram, drawn.cross)) / np.outer(noise, noise)
    assert np.abs(projected.mean(axis=0)).max() < 4.0 / np.sqrt(draws)
    assert abs((projected**2).mean() - 1.0) < 4.0 * np.sqrt(2.0 / projected.size)
    for k in range(3):
        uniform = np.sort(chdtr(100 - ROTATION_TERMS, left[:, k, k]))
        distance = np.abs(uniform - (np.arange(draws) + 0.5) / draws).max()
        assert distance < 2.2 / np.sqrt(draws)
    off_diagonal = left[:, 0, 1] / np.sqrt(100 - ROTATION_TERMS)
    assert abs(off_diagonal.mean()) < 4.0 / np.sqrt(draws)
    assert abs((off_diagonal**2).mean() - 1.0) < 4.0 * np.sqrt(2.1 / draws)


def test_a_draw_and_noise_on_every_sample_have_the_same_fit() -> None:
    """With noise of zero a draw is exact."""
    truth, _ = TRUTHS["table5"]
    exact = Statistics.from_rotations(sweep_rotations(), readings(sweep_rotations(), truth))
    drawn = draw(sweep_statistics(), np.random.default_rng(0), truth.coefficients, np.zeros(3))
    assert_close(drawn, exact, units=200.0)


def test_wishart_of_few_degrees_has_their_rank() -> None:
    rng = np.random.default_rng(0)
    for degrees in (0, 1, 2, 3, 10):
        root = wishart_root(rng, degrees, 3)
        assert np.linalg.matrix_rank(root.T @ root) == min(degrees, 3)
