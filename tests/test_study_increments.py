"""Statistics drawn from count to count have the distribution that noise on every sample gives."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_examples import ACCELEROMETER_NOISE, TABLE_5, readings, sweep_rotations
from scipy.stats import ks_2samp, kstest, norm

from estimators.known_angle.model import SensorParameters
from rig.arrays import Array
from scenarios.studies.increments import Increments
from scenarios.studies.settings import ORDERS, order_of

#: Some increments have fewer rows than the 13 columns, some more.
COUNTS = (5, 12, 30, 90)
DRAWS = 20_000
NOISE = 4.0 * ACCELEROMETER_NOISE


@pytest.fixture(scope="module")
def poses() -> tuple[Array, Array]:
    """Orientations, and readings that the model cannot explain altogether."""
    rotations = sweep_rotations(90)
    truth = SensorParameters.of(TABLE_5, (1.0, 2.0, -9.0))
    unmodelled = 0.02 * np.random.default_rng(7).standard_normal((90, 3))
    return rotations, readings(rotations, truth) + unmodelled


@pytest.fixture(scope="module")
def drawn(poses: tuple[Array, Array]) -> tuple[Increments, Array, Array]:
    sums = Increments.of(*poses, np.arange(90), COUNTS)
    return (sums, *sums.draw(np.random.default_rng(11), NOISE, DRAWS))


def noisy(poses: tuple[Array, Array], draws: int) -> tuple[Array, Array]:
    """The same by brute force: noise on every sample."""
    rotations, exact = poses
    x = np.hstack([rotations, np.ones((len(rotations), 1))])
    volts = exact + NOISE * np.random.default_rng(12).standard_normal((draws, *exact.shape))
    cross = np.stack([np.einsum("nr,mnk->mrk", x[:n], volts[:, :n]) for n in COUNTS])
    square = np.stack([np.square(volts[:, :n]).sum(axis=1) for n in COUNTS])
    return cross, square


def test_without_noise_they_are_the_sums(poses: tuple[Array, Array], drawn: tuple[Increments, Array, Array]) -> None:
    rotations, exact = poses
    x = np.hstack([rotations, np.ones((90, 1))])
    for index, count in enumerate(COUNTS):
        np.testing.assert_allclose(drawn[0].gram[index], x[:count].T @ x[:count], atol=1e-12)
        np.testing.assert_allclose(drawn[0].cross[index], x[:count].T @ exact[:count], atol=1e-11)
        np.testing.assert_allclose(drawn[0].square[index], np.square(exact[:count]).sum(axis=0), rtol=1e-13)


def test_moments_are_those_of_white_noise(drawn: tuple[Increments, Array, Array]) -> None:
    """Each of the 4 x 3 x 10 means and 4 x 3 x 55 variances within six standard errors: fails once in 10^6 runs."""
    sums, cross, square = drawn
    for index, count in enumerate(COUNTS):
        for k in range(3):
            error = cross[index, :, :, k] - sums.cross[index, :, k]
            covariance = NOISE[k] ** 2 * sums.gram[index]
            scale = np.sqrt(covariance.diagonal())
            assert (np.abs(error.mean(axis=0)) <= 6.0 * scale / np.sqrt(DRAWS)).all()
            found = error.T @ error / DRAWS
            reach = np.sqrt((np.outer(scale, scale) ** 2 + covariance**2) / DRAWS)
            assert (np.abs(found - covariance) <= 6.0 * reach).all()
            added = square[index, :, k] - sums.square[index, k] - count * NOISE[k] ** 2
            spread = np.sqrt(4.0 * NOISE[k] ** 2 * sums.square[index, k] + 2.0 * count * NOISE[k] ** 4)
            assert abs(added.mean()) <= 6.0 * spread / np.sqrt(DRAWS)
            assert added.std() == pytest.approx(spread, rel=6.0 / np.sqrt(2.0 * DRAWS) * 1.2)


def test_the_data_set_grows(drawn: tuple[Increments, Array, Array]) -> None:
    """What is added between two counts is independent of what was there: six standard errors of a correlation."""
    _, cross, _ = drawn
    for index in range(1, len(COUNTS)):
        before, added = cross[index - 1, :, 9, 0], cross[index, :, 9, 0] - cross[index - 1, :, 9, 0]
        assert abs(np.corrcoef(before, added)[0, 1]) < 6.0 / np.sqrt(DRAWS)
        together = np.corrcoef(cross[index - 1, :, 9, 0], cross[index, :, 9, 0])[0, 1]
        assert together == pytest.approx(np.sqrt(COUNTS[index - 1] / COUNTS[index]), abs=6.0 / np.sqrt(DRAWS))


def test_what_no_function_of_the_rotation_explains_is_drawn_jointly(
    poses: tuple[Array, Array], drawn: tuple[Increments, Array, Array]
) -> None:
    """The residual sum of squares of the linear fit depends on cross and square together, and on the unmodelled part:
    the same distribution as from noisy samples, by Kolmogorov and Smirnov at 1e-5 for each of six."""
    sums, cross, square = drawn
    brute = noisy(poses, 4000)
    for index in (2, 3):
        inverse = np.linalg.pinv(sums.gram[index], rcond=1e-11, hermitian=True)
        for k in range(3):
            left, right = (
                s[index, :4000, k] - np.einsum("mr,rs,ms->m", c[index, :4000, :, k], inverse, c[index, :4000, :, k])
                for c, s in ((cross, square), brute)
            )
            assert ks_2samp(left, right).pvalue > 1e-5


def test_draws_are_normal_whatever_the_rows(drawn: tuple[Increments, Array, Array]) -> None:
    sums, cross, _ = drawn
    for index in range(len(COUNTS)):
        for row in (0, 9):
            scaled = (cross[index, :, row, 1] - sums.cross[index, row, 1]) / np.sqrt(sums.gram[index, row, row])
            assert kstest(scaled / NOISE[1], norm.cdf).pvalue > 1e-5


@pytest.mark.parametrize("order", ORDERS)
def test_an_order_takes_every_sample_once(order: str) -> None:
    for count in (1, 2, 100, 6656):
        rows = order_of(order, count, np.random.default_rng(0))  # type: ignore[arg-type]
        assert np.array_equal(np.sort(rows), np.arange(count))


def test_every_kth_is_every_kth() -> None:
    rows = order_of("every-kth", 6656, np.random.default_rng(0))
    for k in (1, 2, 4, 8, 16, 32, 64, 128, 256, 512):
        assert np.array_equal(np.sort(rows[: 6656 // k]), np.arange(0, 6656, k))
    for count in (100, 333, 1234, 5000):  # in between the gaps differ by a factor of two at most
        gaps = np.diff(np.sort(rows[:count]))
        assert gaps.max() <= 2 * gaps.min()


def test_the_first_are_the_first_and_random_is_random() -> None:
    assert np.array_equal(order_of("first", 7, np.random.default_rng(0)), np.arange(7))
    one, other = (order_of("random", 6656, np.random.default_rng(seed)) for seed in (0, 1))
    assert not np.array_equal(one, other)
    assert np.array_equal(one, order_of("random", 6656, np.random.default_rng(0)))
