"""The parts of the ellipsoid fit, each against an independent way to the same number."""

from __future__ import annotations

from itertools import product
from typing import Any

import ellipsoid_examples as example
import numpy as np
import pytest
from directions import unit_vectors
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import stdtrit

from estimators.ellipsoid import Start, fit_ellipsoid, levenberg
from estimators.ellipsoid.algebraic import adjusted, constrained
from estimators.ellipsoid.distances import Residuals
from estimators.ellipsoid.likelihood import solve
from estimators.ellipsoid.moments import Moments
from estimators.ellipsoid.monomials import (
    FREE,
    TERMS,
    curvature_in_products,
    noise_in_products,
    packed,
    quadratic_form,
    symmetric,
    table,
)
from estimators.ellipsoid.outliers import FALSE_ALARM, any_outlying, heavy_tailed, least_median, outlying
from estimators.ellipsoid.refusal import missing
from estimators.ellipsoid.shape import Ellipsoid, Quadric
from estimators.ellipsoid.used_rows import spread_rows
from rig.arrays import Array
from rig.errors import RefusedFit, RigError

UNIT = Ellipsoid(np.zeros(3), np.eye(3), np.eye(3))
TRUE = Ellipsoid(example.OFFSET, np.linalg.inv(example.GAIN), example.GAIN)


def monomials(points: Array) -> Array:
    return table(points, np.eye(3), np.zeros(3))


def gaussian_nodes(covariance: Array, order: int) -> tuple[Array, Array]:
    """Points and weights that give the mean of any polynomial of degree 2 order - 1 of N(0, covariance) exactly."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    grid = np.array(list(product(nodes, repeat=3)))
    share = np.array([np.prod(row) for row in product(weights, repeat=3)])
    return grid @ np.linalg.cholesky(covariance).T, share / share.sum()


def some_covariance(scale: float) -> Array:
    root = np.array([[1.0, 0.0, 0.0], [0.4, 0.8, 0.0], [-0.3, 0.2, 1.3]])
    return scale**2 * root @ root.T


def test_packing() -> None:
    matrix = some_covariance(1.0)
    assert symmetric(packed(matrix)).tolist() == matrix.tolist()
    points = unit_vectors(np.random.default_rng(0), 20)
    assert quadratic_form(matrix) @ monomials(points)[4:] == pytest.approx(
        np.einsum("ni,ij,nj->n", points, matrix, points), rel=1e-12
    )


@pytest.mark.parametrize("scale", [0.01, 0.5])
def test_what_noise_adds_to_the_products_is_taken_away_exactly(scale: float) -> None:
    """For weights that do not depend on the noise, however large it is: a polynomial identity, to rounding."""
    point = np.array([0.3, -0.8, 0.5])
    covariance = some_covariance(1.0)
    offsets, share = gaussian_nodes(scale**2 * covariance, 4)
    noisy = monomials(point + offsets)
    gram = (noisy * share) @ noisy.T
    linear, square = noise_in_products(packed(covariance), noisy @ share, 1.0)
    exact = monomials(point[None])
    assert gram - scale**2 * linear + scale**4 * square == pytest.approx(exact @ exact.T, abs=1e-13)


def test_the_second_order_of_the_covariance() -> None:
    """The covariance of what is summed, by quadrature: its excess over first order is the square of the variance times
    ``curvature_in_products``, up to terms that are smaller by another factor of the variance (1e-6, times 20 or so)."""
    variance = 1e-6
    covariance = variance * np.eye(3)
    rng = np.random.default_rng(3)
    points = unit_vectors(rng, 12)
    offsets, share = gaussian_nodes(covariance, 6)
    excess, expected = np.zeros((TERMS, TERMS)), np.zeros((TERMS, TERMS))
    for point in points:
        noisy = monomials(point + offsets)
        residual = noisy[4:7].sum(axis=0) - 1.0
        # exp(-D) of z_j Q, with Q = |y|^2 - 1 a combination of monomials
        sphere = np.array([-1.0, 0, 0, 0, 1.0, 1.0, 1.0, 0, 0, 0])
        corrected = noisy * residual
        for node in range(len(share)):
            first, second = noise_in_products(packed(covariance), noisy[:, node], 1.0)
            corrected[:, node] -= (first - second) @ sphere
        mean = corrected @ share
        assert mean == pytest.approx(np.zeros(TERMS), abs=1e-15)
        exact = monomials(point[None])
        excess += (corrected * share) @ corrected.T - 4.0 * variance * exact @ exact.T
        # with weights 1 / (4 variance): the noise's variance is one in the units of the weights
        expected += (
            16.0
            * variance**2
            * curvature_in_products(exact @ exact.T / (4.0 * variance), exact[:, 0] / (4.0 * variance), variance)
        )
    assert excess == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("parameters", [6, 9])
def test_the_derivative_of_gain_and_offset(parameters: int) -> None:
    """Against central differences, which are good to the cube root of rounding squared, some 1e-9."""
    frame = (
        TRUE
        if parameters == 9
        else Ellipsoid(example.OFFSET, *(np.diag(d) for d in ([0.7, 0.8, 0.6], [1 / 0.7, 1 / 0.8, 1 / 0.6])))
    )
    coefficients = np.array([0.1, -0.05, 0.02, 1.1, 0.9, 1.05, 0.03, -0.02, 0.01])[:parameters]

    def values(of: Array) -> Array:
        quadric = Quadric.of(frame, -1.0, of)
        assert quadric is not None
        return np.concatenate([packed(quadric.ellipsoid.gain)[: parameters - 3], quadric.ellipsoid.center])

    quadric = Quadric.of(frame, -1.0, coefficients)
    assert quadric is not None
    assert quadric.ellipsoid.gain @ quadric.ellipsoid.whitening == pytest.approx(np.eye(3), abs=1e-14)
    step = 1e-5
    numeric = [
        (values(coefficients + step * unit) - values(coefficients - step * unit)) / (2.0 * step)
        for unit in np.eye(parameters)
    ]
    assert quadric.derivative(frame, parameters) == pytest.approx(np.array(numeric).T, abs=1e-8)


def test_quadrics_that_are_no_ellipsoids() -> None:
    assert Quadric.of(UNIT, -1.0, np.array([0.0, 0, 0, 1, 1, -1, 0, 0, 0])) is None
    assert Quadric.of(UNIT, 1.0, np.array([0.0, 0, 0, 1, 1, 1, 0, 0, 0])) is None  # no point
    assert Quadric.of(UNIT, -1.0, np.array([0.0, 0, 0, 1, 1, 0, 0, 0, 0])) is None  # a cylinder
    assert Quadric.of(UNIT, -1.0, np.full(9, np.nan)) is None
    turned = Quadric.of(UNIT, 1.0, np.array([0.0, 0, 0, -4, -4, -4, 0, 0, 0]))  # the other sign, the same sphere
    assert turned is not None
    assert turned.ellipsoid.gain == pytest.approx(0.5 * np.eye(3), abs=1e-15)


@pytest.mark.parametrize("counted", [False, True])
def test_moments_are_the_weighted_sums(counted: bool) -> None:
    """Against sums written out; noise that differs between channels, so that the weights' own noise counts."""
    rng = np.random.default_rng(4)
    readings = unit_vectors(rng, 300) @ example.GAIN + example.OFFSET + 0.05 * rng.standard_normal((300, 3))
    variances = np.array([1.0, 0.5, 2.0])
    counts = rng.integers(1, 20, 300).astype(float) if counted else None
    found = Moments.of(readings, TRUE, variances, counts)
    number = np.ones(300) if counts is None else counts
    y = (readings - example.OFFSET) @ TRUE.whitening
    z = monomials(y)
    N = TRUE.whitening @ np.diag(variances) @ TRUE.whitening
    square = np.square(y).sum(axis=1)
    spread = np.einsum("ni,ij,nj->n", y, N, y)
    weight = number * square / (4.0 * spread)
    # Sums of 300 terms in another order: 300 roundings at most.
    assert found.gram == pytest.approx((z * weight) @ z.T, rel=1e-12, abs=1e-10)
    assert found.first == pytest.approx(z @ (weight / number), rel=1e-12, abs=1e-11)
    assert found.second == pytest.approx((weight / number**2).sum(), rel=1e-12)
    bent = np.einsum("ni,ij,nj->n", y, N @ N, y)
    assert found.drift == pytest.approx(z @ (1.0 - square * bent / spread**2), rel=1e-11, abs=1e-11)
    over = np.square(square - 1.0) * weight
    assert found.largest == pytest.approx(over.max(), rel=1e-11)
    assert found.fourth == pytest.approx(np.square(over).sum(), rel=1e-11)


def test_moments_of_parts_add() -> None:
    rng = np.random.default_rng(5)
    readings = unit_vectors(rng, 20_000) @ example.GAIN + example.OFFSET + 0.05 * rng.standard_normal((20_000, 3))
    variances, counts = np.array([1.0, 0.5, 2.0]), rng.integers(1, 20, 20_000).astype(float)
    whole = Moments.of(readings, TRUE, variances, counts)
    parts = Moments.of(readings[:7], TRUE, variances, counts[:7]) + Moments.of(
        readings[7:], TRUE, variances, counts[7:]
    )
    for name in ("rows", "gram", "first", "second", "drift", "largest", "fourth"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name), rel=1e-11, abs=1e-9), name
    with pytest.raises(RigError, match="two preliminary ellipsoids"):
        whole + Moments.of(readings, UNIT, np.ones(3))


@pytest.mark.parametrize("count", [20, 20_000])
def test_what_rounding_leaves_is_told_from_noise(count: int) -> None:
    """Residuals of 6e-8 of the radius cannot be seen in sums of squares; those of 1e-6 can, at any length."""
    rng = np.random.default_rng(11)
    directions = unit_vectors(rng, count)
    for noise, exact in ((0.0, True), (1e-6, False)):
        readings = directions @ example.GAIN + example.OFFSET + noise * rng.standard_normal((count, 3))
        found = solve(Moments.of(readings, TRUE, np.ones(3)), 9, known=False)
        assert found is not None
        assert bool(found.exact) is exact


def test_the_algebraic_fits() -> None:
    """The adjusted one is free of bias, the constrained one is always an ellipsoid."""
    rng = np.random.default_rng(6)
    points = unit_vectors(rng, 5000) @ example.GAIN + example.OFFSET
    exact = monomials(points)
    for fit in (lambda gram: adjusted(gram, np.eye(10)), constrained):
        found = fit(exact @ exact.T)
        quadric = Quadric.of(UNIT, float(found[0]), found[1:])
        assert quadric is not None
        assert quadric.ellipsoid.gain == pytest.approx(example.GAIN, abs=1e-9)
    blob = monomials(rng.standard_normal((50, 3)))
    found = constrained(blob @ blob.T)
    assert Quadric.of(UNIT, float(found[0]), found[1:]) is not None


def test_residuals_and_the_noise_of_the_channels() -> None:
    rng = np.random.default_rng(7)
    variances = np.square([0.004, 0.012, 0.007])
    readings = unit_vectors(rng, 40_000) @ example.GAIN + example.OFFSET
    readings += np.sqrt(variances) * rng.standard_normal(readings.shape)
    residuals = Residuals.of(readings, TRUE)
    found = residuals.variances()
    assert found is not None
    # 40,000 squares tell three variances to some 1.2 % (of the largest for the smallest, which is 1/9 of it: 8 %).
    assert found == pytest.approx(variances, rel=0.06, abs=0.012 * variances.max() * 4)
    over = residuals.over(variances)
    assert over.mean() == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / 40_000))
    # A hundredth that is gross moves a resistant figure by .01 (1 - .52) / .2, the slope at 1: 2.4 %; it knows less.
    spoilt = residuals.table.copy()
    spoilt[3, ::100] = 1.0
    resistant = Residuals(spoilt).variances(resistant=True)
    assert resistant == pytest.approx(variances, rel=0.1, abs=0.012 * variances.max() * 8)
    # Directions in one channel's axis only do not tell the others.
    assert Residuals.of(example.OFFSET + np.array([[1.4, 0, 0], [-1.41, 0, 0]] * 40), TRUE).variances() is None


def test_heavy_tails_are_seen_and_gaussian_ones_are_not() -> None:
    rng = np.random.default_rng(8)
    squares = np.square(rng.standard_normal(5000))
    assert not heavy_tailed(5000, float(squares @ squares), float(squares.mean()))
    squares[:100] = 100.0
    assert heavy_tailed(5000, float(squares @ squares), float(squares.mean()))


def test_a_reading_is_judged_by_the_fit_to_all_the_others() -> None:
    """Of a straight line, where that fit can be made: a reading is an outlier as its prediction says, at any size."""
    rng = np.random.default_rng(12)
    x, y = np.linspace(0.0, 1.0, 12), rng.standard_normal(12)
    design = np.column_stack([np.ones(12), x])
    leverage = (design @ np.linalg.inv(design.T @ design) * design).sum(axis=1)
    limit = -stdtrit(9, 0.5 * FALSE_ALARM / 12)
    others = np.arange(12) != 3
    rest = design[others] @ np.linalg.lstsq(design[others], y[others], rcond=None)[0]
    deviation = np.sqrt(np.square(y[others] - rest).sum() / 9 / (1.0 - leverage[3]))
    predicted = design[3] @ np.linalg.lstsq(design[others], y[others], rcond=None)[0]
    for share, is_outlier in ((0.99, False), (1.01, True)):
        y[3] = predicted + share * limit * deviation
        squares = np.square(y - design @ np.linalg.lstsq(design, y, rcond=None)[0])
        variance = squares.sum() / 10
        found = outlying(squares, leverage, np.ones(12, dtype=bool), variance, 10)
        assert found.tolist() == [number == 3 and is_outlier for number in range(12)]
        assert any_outlying(squares, leverage, variance, 10) == is_outlier


def test_the_start_stands_45_percent_of_outliers_in_one_place() -> None:
    """To a tenth of the field, from which the way to the optimum is sure."""
    rng = np.random.default_rng(13)
    readings = unit_vectors(rng, 400) @ example.GAIN + example.OFFSET + 0.01 * rng.standard_normal((400, 3))
    readings[:180] = [4.0, 0.0, 1.0] + 0.3 * rng.standard_normal((180, 3))
    found = least_median(readings, np.ones(3), 9)
    assert found is not None
    assert np.abs(found.center - example.OFFSET).max() < 0.1
    assert np.abs(found.gain - example.GAIN).max() < 0.1


@pytest.mark.parametrize("away", np.vstack([np.eye(3), [0.6, -0.64, 0.48]]))
def test_what_is_missing_is_where_no_reading_was(away: Array) -> None:
    """A cap of 70 degrees about one direction lacks the opposite one: of 500 directions the next is 5 degrees off, and
    the weakest combination is the cap's own axis but for the draw of 400 readings, some degrees."""
    cap = example.cap(np.random.default_rng(14), 400, 70.0)
    across = np.linalg.svd(away[None])[2][1:]
    directions = cap @ np.vstack([across, away])
    found = solve(Moments.of(directions, UNIT, np.full(3, 1e-6)), 9, known=True)
    assert found is not None
    assert missing(found) @ away < -np.cos(np.radians(20.0))


def test_sampled_rows_follow_no_cycle() -> None:
    """Of any cycle of poses up to 60 long all are met, each 14 times or more on the average."""
    rows = spread_rows(6656, 832)
    assert rows is not None
    assert (np.diff(rows) > 0).all()
    assert 0 <= rows[0] < rows[-1] < 6656
    for period in range(2, 60):
        met = np.bincount(rows % period, minlength=period)
        assert met.min() > 0.2 * len(rows) / period, period
    assert spread_rows(800, 832) is None


@pytest.mark.parametrize("parameters", [6, 9])
def test_levenberg_marquardt_ends_where_the_paper_s_sum_is_least(parameters: int) -> None:
    """Camps (2)-(7): no small step from it lowers the sum, from the data sheet's values or from others."""
    rng = np.random.default_rng(9)
    magnitude = 0.47
    readings = magnitude * unit_vectors(rng, 600) @ (5.0 * example.gain_of(parameters)) + example.OFFSET
    readings += 0.02 * rng.standard_normal(readings.shape)
    fit = fit_ellipsoid(readings, magnitude, parameters=parameters, start=Start(8.0))  # type: ignore[arg-type]
    other = fit_ellipsoid(readings, magnitude, parameters=parameters, start=Start([3.0, 9.0, 5.0], [0.5, 0.0, -0.5]))  # type: ignore[arg-type]
    assert fit.estimator == "levenberg-marquardt"
    assert other.values == pytest.approx(fit.values, rel=1e-6, abs=1e-7)

    def paper(values: Array) -> float:
        gain = symmetric(np.concatenate([values[: parameters - 3], np.zeros(9 - parameters)]))
        field = (readings - values[parameters - 3 :]) @ np.linalg.inv(gain)
        return float(np.square(np.square(field).sum(axis=1) - magnitude**2).sum())

    least = paper(fit.values)
    for unit in np.eye(parameters):
        for step in (1e-4, -1e-4):
            assert paper(fit.values + step * unit) > least
    direct = fit_ellipsoid(readings, magnitude, parameters=parameters)  # type: ignore[arg-type]
    # Two estimates from the same noise: they differ by the paper's bias, half a standard deviation here.
    assert np.abs((fit.values - direct.values) / direct.std).max() < 1.0
    assert fit.std == pytest.approx(direct.std, rel=0.05)
    assert fit.chi_square == pytest.approx(600 - parameters, rel=1e-12)


def test_the_sign_that_levenberg_marquardt_ends_with_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """The residuals are even in the inverse gain: the search may end at either."""
    readings = unit_vectors(np.random.default_rng(15), 60) @ example.GAIN + example.OFFSET

    def other_way(*arguments: Any, **options: Any) -> OptimizeResult:
        found = least_squares(*arguments, **options)
        return OptimizeResult({**found, "x": found.x * np.repeat([-1.0, 1.0], [6, 3])})

    expected = fit_ellipsoid(readings, start=Start(1.4))
    monkeypatch.setattr(levenberg, "least_squares", other_way)
    found = fit_ellipsoid(readings, start=Start(1.4))
    assert found.values == pytest.approx(expected.values, rel=1e-12)
    assert found.covariance == pytest.approx(expected.covariance, rel=1e-9)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (Start([1.0, 2.0]), "expected one number, three, or for the gain 3 by 3"),
        (Start(-1.0), "expected positive numbers"),
        (Start(0.0), "expected positive numbers"),
        (Start(1.0, [0.0, 0.0]), "expected one number, three"),
    ],
)
def test_a_start_that_is_none(start: Start, message: str) -> None:
    with pytest.raises(RigError, match=message):
        fit_ellipsoid(unit_vectors(np.random.default_rng(10), 50), start=start)


def test_levenberg_marquardt_refuses_what_is_no_ellipsoid() -> None:
    angle = np.linspace(0.0, 3.0, 60)
    saddle = np.column_stack([np.cos(angle), np.sin(angle), 2.0 + 0.3 * np.cos(2.0 * angle) ** 2])
    with pytest.raises(RefusedFit, match=r"from gain \[0.01, 0.01, 0.01\] and offset"):
        fit_ellipsoid(saddle, start=Start(0.01, 50.0))


def test_free_columns_are_those_of_the_models() -> None:
    assert [FREE[p].stop - FREE[p].start for p in (6, 9)] == [6, 9]
