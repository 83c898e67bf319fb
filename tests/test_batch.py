"""Many fits at once are the single fits, one by one, and many draws are distributed as single ones."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_examples import BOTH, POSE_SETS, TRUTHS, random_truth, readings, sweep_statistics
from scipy.special import chdtr
from statistics_draws import draw_many

from estimators.batch import ManyFits, ManyParameters, fit_many
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.model import Method
from estimators.known_angle.statistics import Statistics
from rig.errors import RigError


def agrees(fits: ManyFits, index: int, single: object) -> bool:
    """Both end at the bottom of a cost that is flat to its rounding, eps of the readings' squares over the residuals'.

    That is at most 1e-10 of chi-square per sample, and 1e-4 of a standard deviation covers it with a wide margin: the
    two searches differ by 1e-8 of one.
    """
    parameters, problem = single.parameters, single.problem  # type: ignore[attr-defined]
    error = ManyParameters.stacked([fits.parameters[index]]).errors(parameters, fits.method)[0]
    return bool(fits.told[index] == (problem is None)) and (
        problem is not None or np.abs(error / fits.std[index]).max() < 1e-4
    )


@BOTH
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("weighting", ["likelihood", "equal"])
@pytest.mark.parametrize(("name", "count"), [("table2", 100), ("table10", 6656)])
def test_they_are_the_single_fits(method: Method, given: bool, weighting: str, name: str, count: int) -> None:
    truth, noise = TRUTHS[name]
    base = sweep_statistics(count)
    drawn = draw_many(np.random.default_rng(0), base.gram, count, truth.coefficients, 3.0 * noise, 40)
    floor = 3.0 * noise if given else None
    options = {
        "method": method,
        "weighting": weighting,
        "reference_magnitude": truth.reference_magnitude,
        "field_points": truth.fields[0],
    }
    fits = fit_many(drawn.gram, drawn.cross, drawn.square, count, floor, **options)  # type: ignore[arg-type]
    assert fits.converged.all()
    for i in range(len(fits)):
        one = Statistics(count, drawn.gram, drawn.cross[i], np.diag(drawn.square[i]))
        single = fit_sensor(one, noise=floor, **options)  # type: ignore[arg-type]
        assert agrees(fits, i, single)
        # Where the noise is estimated its iteration ends within 1e-6 of a standard deviation, and a channel's residuals
        # by themselves change in proportion.
        assert np.abs(fits.residual_square[i] / single.residual_square - 1.0).max() < 1e-6
        assert np.abs(fits.noise[i] / single.noise - 1.0).max() < 1e-6
        size = np.sqrt(single.covariance.diagonal())
        assert np.abs((fits.covariance[i] - single.covariance) / np.outer(size, size)).max() < 1e-4


@BOTH
@pytest.mark.parametrize("poses", POSE_SETS)
def test_they_are_the_single_fits_on_any_poses(poses: str, method: Method) -> None:
    """Poses that differ from data set to data set, some of which tell too little: refused alike."""
    rng = np.random.default_rng(1)
    truths, sums = [], []
    for _ in range(12):
        rotations = POSE_SETS[poses](rng).reshape(-1, 9)
        truths.append(random_truth(rng))
        volts = readings(rotations, truths[-1]) + 0.01 * rng.standard_normal((len(rotations), 3))
        sums.append(Statistics.from_rotations(rotations, volts))
    points = np.stack([truth.fields[0] for truth in truths])
    noise = np.full(3, 0.01)
    fits = fit_many(
        np.stack([part.gram for part in sums]),
        np.stack([part.cross for part in sums]),
        np.stack([part.square for part in sums]),
        [part.count for part in sums],
        noise,
        method,
        reference_magnitude=9.8,
        field_points=points,
    )
    for i, part in enumerate(sums):
        single = fit_sensor(part, 9.8, method=method, noise=noise, field_points=points[i], refuse=False)
        assert agrees(fits, i, single)
        excess = (fits.residual_square[i] - single.residual_square) @ noise**-2.0
        assert excess < 1e-5  # of chi-square: no minimum of the single search is missed, whatever the poses


def test_errors_and_coefficients_are_those_of_single_parameters() -> None:
    rng = np.random.default_rng(2)
    points = [random_truth(rng) for _ in range(5)]
    many = ManyParameters.stacked(points)
    for i, point in enumerate(points):
        assert np.abs(many.coefficients[i] - point.coefficients).max() < 1e-15
        assert np.array_equal(many[i].axes, point.axes)
    assert not many.errors(many, "separate").any() or np.abs(many.errors(many, "separate")).max() < 1e-15
    other = points[0]
    against_one, against_each = (
        many.errors(other, "separate"),
        many.errors(ManyParameters.stacked([other] * 5), "separate"),
    )
    assert np.array_equal(against_one, against_each)


def test_draws_of_no_noise_are_exact_and_any_truth_has_its_own() -> None:
    rng = np.random.default_rng(3)
    base = sweep_statistics(100)
    truths = [random_truth(rng) for _ in range(4)]
    drawn = draw_many(rng, base.gram, 100, ManyParameters.stacked(truths).coefficients, np.zeros(3), 4)
    for i, truth in enumerate(truths):
        theta = truth.coefficients
        assert np.abs(drawn.cross[i] - base.gram @ theta).max() < 1e-12 * np.abs(drawn.cross[i]).max()
        assert np.abs(drawn.square[i] - np.diag(theta.T @ base.gram @ theta)).max() < 1e-12 * drawn.square[i].max()


def test_draws_are_distributed_as_noise_on_every_sample() -> None:
    """Whitened projections have unit variance (30 comparisons at four standard errors), what is left of the squares is
    chi-square with n - 10 degrees (three Kolmogorov distances at 1 in 8,000): one seed in 400 fails by chance."""
    truth, noise = TRUTHS["table10"]
    base = sweep_statistics(100)
    draws = 20_000
    drawn = draw_many(np.random.default_rng(4), base.gram, 100, truth.coefficients, noise, draws)
    exact = base.gram @ truth.coefficients
    whitened = np.linalg.solve(np.linalg.cholesky(base.gram), drawn.cross - exact) / noise
    assert np.abs((whitened**2).mean(axis=0) - 1.0).max() < 4.0 * np.sqrt(2.0 / draws)
    explained = np.einsum("mac,ab,mbc->mc", drawn.cross, np.linalg.inv(base.gram), drawn.cross)
    left = (drawn.square - explained) / noise**2
    for k in range(3):
        uniform = np.sort(chdtr(90, left[:, k]))
        assert np.abs(uniform - (np.arange(draws) + 0.5) / draws).max() < 2.2 / np.sqrt(draws)


def test_wrong_inputs_are_refused() -> None:
    base = sweep_statistics(100)
    truth, noise = TRUTHS["table5"]
    drawn = draw_many(np.random.default_rng(5), base.gram, 100, truth.coefficients, noise, 3)
    with pytest.raises(RigError, match=r"cross \(3, 10, 2\)"):
        fit_many(drawn.gram, drawn.cross[:, :, :2], drawn.square, 100)
    with pytest.raises(RigError, match="one of 5 samples, expected at least 14"):
        fit_many(drawn.gram, drawn.cross, drawn.square, 5)
    with pytest.raises(RigError, match="expected one gram each"):
        fit_many(drawn.gram, drawn.cross, drawn.square, [100, 100, 50])
    with pytest.raises(RigError, match="nearest: 'separate'"):
        fit_many(drawn.gram, drawn.cross, drawn.square, 100, method="seperate")  # type: ignore[arg-type]
