"""The attitude-free fit of one sensor: what it finds, what it leaves out and what it refuses."""

from __future__ import annotations

from typing import Any

import ellipsoid_examples as example
import numpy as np
import pytest
from directions import CUBE, unit_vectors
from scipy.special import chdtrc

from estimators.ellipsoid import EllipsoidFit, Start, fit_ellipsoid
from rig.arrays import Array
from rig.errors import RefusedFit, RigError


def readings_of(
    directions: Array, rng: np.random.Generator | None = None, noise: float = example.NOISE, parameters: int = 9
) -> Array:
    exact = directions @ example.gain_of(parameters) + example.OFFSET
    return exact if rng is None else exact + noise * rng.standard_normal(exact.shape)


def off_by(fit: EllipsoidFit, truth: Array) -> float:
    """The largest error in standard deviations."""
    return float(np.abs((fit.values - truth) / fit.std).max())


@pytest.mark.parametrize("parameters", [6, 9])
def test_without_noise_it_is_exact(parameters: Any) -> None:
    """To 450 times the rounding of a field of one; residuals are sums of squares, which hide noise below 6e-8."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        gain = np.diag(rng.uniform(0.3, 3.0, 3))
        if parameters == 9:
            turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
            gain = turn @ gain @ turn.T
        offset = rng.uniform(-3.0, 3.0, 3)
        fit = fit_ellipsoid(unit_vectors(rng, 60) @ gain + offset, parameters=parameters)
        assert fit.gain == pytest.approx(gain, abs=1e-13)
        assert fit.offset == pytest.approx(offset, abs=1e-13)
        assert fit.noise.max() < 1e-7 * gain.max()
        assert not fit.dropped.outliers


def test_units_and_magnitude_only_scale_the_answer() -> None:
    """Counts about 32,768 with 6,000 a field lose a digit to the offset: 1e-11 is 100 times their rounding."""
    rng = np.random.default_rng(2)
    volts = readings_of(unit_vectors(rng, 500), rng)
    fit = fit_ellipsoid(volts)
    scaled = fit_ellipsoid(4000.0 * volts + 32768.0, 9.81)
    assert scaled.gain == pytest.approx(4000.0 / 9.81 * fit.gain, rel=1e-11, abs=1e-9)
    assert scaled.offset == pytest.approx(4000.0 * fit.offset + 32768.0, rel=1e-11)
    factor = np.array([4000.0 / 9.81] * 6 + [4000.0] * 3)
    assert scaled.std == pytest.approx(factor * fit.std, rel=1e-7)
    assert scaled.noise == pytest.approx(4000.0 * fit.noise, rel=1e-7)
    lengths = np.linalg.norm(scaled.field_of(4000.0 * volts + 32768.0), axis=1)
    assert lengths.mean() == pytest.approx(9.81, rel=1e-3)


def test_the_order_of_memory_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    readings = readings_of(unit_vectors(rng, 9000), rng)
    assert fit_ellipsoid(np.asfortranarray(readings)).values == pytest.approx(fit_ellipsoid(readings).values, rel=1e-12)
    assert fit_ellipsoid(readings.tolist()).values.tolist() == fit_ellipsoid(readings).values.tolist()


def test_a_cycle_of_poses_does_not_fool_the_first_fit() -> None:
    """26 poses over and over: rows in equal steps would be of two or of one."""
    rng = np.random.default_rng(4)
    for repeats in (256, 512, 1300):
        readings = readings_of(np.tile(CUBE, (repeats, 1)), rng)
        assert off_by(fit_ellipsoid(readings), example.truth(9)) < 5.0  # of 9 figures: 5e-6


def test_noise_of_each_channel_comes_from_the_residuals() -> None:
    """20,000 readings, 2,500 of which tell the channels' ratios: a variance to some 5 %, a deviation to 2.5 %."""
    rng = np.random.default_rng(5)
    noise = np.array([0.0085, 0.0068, 0.0117])
    exact = readings_of(unit_vectors(rng, 20_000))
    fit = fit_ellipsoid(exact + noise * rng.standard_normal(exact.shape))
    assert fit.noise == pytest.approx(noise, rel=0.13)
    assert not fit.noise_given
    assert fit.degrees_of_freedom == 20_000 - 9


def test_chi_square_against_given_noise_is_chi_square() -> None:
    """p-values of 400 draws are uniform: the mean is 0.5 to 0.0144; 0.07 is 4.9 standard deviations (1e-6)."""
    rng = np.random.default_rng(6)
    exact = readings_of(example.hemisphere(rng, 300))
    chance = []
    for _ in range(400):
        fit = fit_ellipsoid(exact + example.NOISE * rng.standard_normal(exact.shape), noise=[example.NOISE] * 3)
        chance.append(chdtrc(fit.degrees_of_freedom, fit.chi_square))
    assert np.mean(chance) == pytest.approx(0.5, abs=0.07)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.4])
@pytest.mark.parametrize("count", [400, 20_000])
def test_outliers_are_left_out(share: float, count: int) -> None:
    """Disturbances of half the field, 37 times the noise. 5.5 standard deviations of nine figures: 3e-7 by chance; a
    disturbance that is no larger than noise stays in, so the spread is a little larger than stated (up to 7 %)."""
    rng = np.random.default_rng(7)
    readings = readings_of(unit_vectors(rng, count), rng)
    bad = rng.choice(count, round(share * count), replace=False)
    readings[bad] += 0.5 * rng.standard_normal((len(bad), 3))
    fit = fit_ellipsoid(readings)
    assert off_by(fit, example.truth(9)) < 5.9
    assert fit.used is not None
    assert len(fit.used) == fit.samples == count - fit.dropped.outliers
    gross = bad[np.abs(np.linalg.norm(fit.field_of(readings[bad]), axis=1) - 1.0) > 0.1]
    assert not np.isin(gross, fit.used).any()
    if share < 0.2:
        everything = fit_ellipsoid(readings, robust=False)
        assert everything.samples == count
        assert everything.noise.mean() > 3.0 * fit.noise.mean()


@pytest.mark.parametrize("ratio", [(1.0, 1.0, 1.0), (0.2, 1.0, 2.0), (0.1, 0.1, 1.0)])
def test_three_gross_readings_take_no_others_with_them(ratio: tuple[float, ...]) -> None:
    """Whatever noise each channel has, which nobody states. One good reading is left out in less than 1 % of data sets
    (.8 % of 2,700): more than four in 20 with probability 3e-6. With noise learned from all readings, tens to hundreds
    are."""
    rng = np.random.default_rng(10)
    noise = example.NOISE * np.array(ratio)
    lost = 0
    for _ in range(20):
        directions = unit_vectors(rng, 3000)
        readings = readings_of(directions) + noise * rng.standard_normal(directions.shape)
        readings[:3] += 0.7 * directions[:3] @ example.GAIN
        fit = fit_ellipsoid(readings)
        assert fit.used is not None
        assert fit.used[0] >= 3
        lost += fit.dropped.outliers - 3
    assert lost <= 4


def test_one_bad_reading_of_26_is_found() -> None:
    rng = np.random.default_rng(8)
    readings = readings_of(CUBE, rng)
    readings[11] += 0.2 * CUBE[11]
    fit = fit_ellipsoid(readings)
    assert fit.dropped.outliers == 1
    assert fit.used is not None
    assert 11 not in fit.used


def test_repeated_and_zero_readings_are_left_out() -> None:
    rng = np.random.default_rng(9)
    once = readings_of(unit_vectors(rng, 300), rng)
    held = np.repeat(once, 3, axis=0)
    held = np.insert(held, [6, 399, 399], 0.0, axis=0)
    fit = fit_ellipsoid(held)
    assert fit.values == pytest.approx(fit_ellipsoid(once).values, rel=1e-12)
    assert fit.samples == 300
    assert (fit.dropped.repeated, fit.dropped.zero) == (600, 3)
    assert str(fit.dropped) == "600 repeated, 3 all-zero"
    assert fit_ellipsoid(held, drop_repeats=False, robust=False).samples == len(held)
    # Equal in two channels only, as coarse converters give them: measurements of their own.
    two = once.copy()
    two[1::2, :2] = two[::2, :2]
    assert fit_ellipsoid(two, robust=False, refuse=False).samples == 300


@pytest.mark.parametrize("noise", [0.0, 1e-3, example.NOISE])
@pytest.mark.parametrize("parameters", [6, 9])
@pytest.mark.parametrize("poses", [1, 3, 5])
def test_few_orientations_are_refused(poses: int, parameters: Any, noise: float) -> None:
    """However many samples of each, and however small the residual."""
    rng = np.random.default_rng(10 * poses + parameters)
    readings = readings_of(np.repeat(unit_vectors(rng, poses), 200, axis=0), rng, noise, parameters)
    with pytest.raises(RefusedFit) as refused:
        fit_ellipsoid(readings, parameters=parameters)
    message = str(refused.value)
    assert "\n" not in message
    if noise == 0.0:
        assert f"found {poses} readings" in message
    elif poses > 1 and noise == 1e-3:
        assert f"{poses} distinct directions, expected at least {parameters}" in message


def test_one_reading_too_few_for_the_noise_is_refused_unless_it_is_given() -> None:
    rng = np.random.default_rng(11)
    readings = readings_of(unit_vectors(rng, 9), rng, 1e-6)
    with pytest.raises(RefusedFit, match="tells nothing of the noise: expected at least 10, or the noise"):
        fit_ellipsoid(readings)
    fit = fit_ellipsoid(readings, noise=[1e-6] * 3)
    assert fit.degrees_of_freedom == 0
    assert off_by(fit, example.truth(9)) < 5.0


@pytest.mark.parametrize("noise", [0.0, 1e-3, example.NOISE])
def test_a_plane_is_refused(noise: float) -> None:
    rng = np.random.default_rng(12)
    angle = rng.uniform(0.0, 2.0 * np.pi, 1000)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(1000)])
    with pytest.raises(RefusedFit, match=r"about a plane at right angles to .*: turn the sensor about an axis in that"):
        fit_ellipsoid(readings_of(circle, rng, noise))


@pytest.mark.parametrize("noise", [1e-3, example.NOISE])
def test_two_parallel_circles_are_refused(noise: float) -> None:
    """A magnetometer turned level at two tilts: a pair of planes passes through all readings as well."""
    rng = np.random.default_rng(13)
    angle = rng.uniform(0.0, 2.0 * np.pi, 2000)
    height = np.where(rng.random(2000) < 0.5, 0.3, -0.3)
    width = np.sqrt(1.0 - height**2)
    circles = np.column_stack([width * np.cos(angle), width * np.sin(angle), height])
    with pytest.raises(RefusedFit, match=r"alike|no ellipsoid"):
        fit_ellipsoid(readings_of(circles, rng, noise))


@pytest.mark.parametrize("half_angle", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, example.NOISE])
def test_a_small_cap_is_refused_however_small_the_residual(half_angle: float, noise: float) -> None:
    """Judged from the fitted centre: one that has run away sees the readings from one side."""
    rng = np.random.default_rng(14)
    readings = readings_of(example.cap(rng, 3000, half_angle), rng, noise)
    with pytest.raises(RefusedFit):
        fit_ellipsoid(readings)
    try:
        fit = fit_ellipsoid(readings, refuse=False)
    except RefusedFit:  # there is no ellipsoid at all
        return
    assert fit.problem is not None
    if noise and half_angle == 30.0:
        assert "(0.0" in fit.problem  # what is missing lies opposite
        assert "-1.00)" in fit.problem


def test_readings_of_no_one_magnitude_are_refused() -> None:
    rng = np.random.default_rng(15)
    with pytest.raises(RefusedFit, match="no ellipsoid"):
        fit_ellipsoid(rng.standard_normal((5000, 3)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"readings": np.zeros((40, 2))}, r"shape \(40, 2\), expected \(n, 3\)"),
        ({"readings": np.eye(3)}, "found 3 readings, expected at least 9"),
        ({"parameters": 7}, "found 7, expected 6 or 9"),
        ({"reference_magnitude": 0.0}, "found 0, expected a positive number"),
        ({"noise": [0.1, 0.1]}, "expected 3 positive numbers"),
        ({"noise": [0.1, 0.1, 0.0]}, "expected 3 positive numbers"),
        ({"counts": np.ones(4)}, "expected 40 positive numbers"),
        ({"counts": np.ones(40), "start": Start(1.0)}, "expected one or the other"),
    ],
)
def test_a_wrong_call_says_what_was_expected(arguments: dict[str, Any], message: str) -> None:
    rng = np.random.default_rng(16)
    arguments = {"readings": readings_of(unit_vectors(rng, 40), rng), **arguments}
    with pytest.raises(RigError, match=message) as error:
        fit_ellipsoid(**arguments)
    assert not isinstance(error.value, RefusedFit)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 4999])
def test_a_reading_that_is_not_finite_is_named(bad: float, row: int) -> None:
    rng = np.random.default_rng(17)
    readings = readings_of(unit_vectors(rng, 5000), rng)
    readings[row, 1] = bad
    with pytest.raises(RigError, match=f"reading {row} is .* expected finite numbers"):
        fit_ellipsoid(readings)
