"""Known-angle calibration: exact without noise, at the Cramer-Rao bound with it, from any data, or refused."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from directions import unit_vectors
from kinematic_examples import (
    BOTH,
    POSE_SETS,
    TABLE_5,
    TRUTHS,
    errors,
    largest_difference,
    noiseless,
    random_truth,
    readings,
    sweep_rotations,
    sweep_statistics,
)
from scipy.optimize import least_squares
from statistics_draws import draw

from estimators.batch.global_minima import Problems, descend
from estimators.batch.optimum import Centred
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.model import Method, SensorParameters, parameter_names
from estimators.known_angle.statistics import Statistics
from rig.directions import angles_from_direction, direction_from_angles, tangent_basis
from rig.errors import RefusedFit, RigError

# --- the model -------------------------------------------------------------------------------------------------------


@BOTH
def test_the_linear_form_is_the_papers_model(method: Method) -> None:
    """To rounding: 30 products of numbers near one."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        truth = random_truth(rng)
        if method == "separate":
            truth = SensorParameters(9.8, truth.sensitivity, truth.offset, truth.axes, unit_vectors(rng, 3))
        rotations = sweep_rotations(50)
        linear = np.hstack([rotations, np.ones((50, 1))]) @ truth.coefficients
        assert np.abs(linear - readings(rotations, truth)).max() < 1e-14


@BOTH
def test_the_jacobian_equals_finite_differences(method: Method) -> None:
    """Central differences with a step of 1e-6: truncation 1e-12, rounding 1e-10 of coefficients near one."""
    rng = np.random.default_rng(1)
    truth = random_truth(rng)
    if method == "separate":
        truth = SensorParameters(9.8, truth.sensitivity, truth.offset, truth.axes, unit_vectors(rng, 3))
    jacobian = truth.jacobian(method)
    axis_basis, field_basis = tangent_basis(truth.axes), tangent_basis(truth.fields)

    def moved(column: int, step: float) -> np.ndarray:
        S, delta = truth.sensitivity.copy(), truth.offset.copy()
        axes, fields = truth.axes.copy(), truth.fields.copy()
        per = 4 if method == "simultaneous" else 6
        k, which = divmod(column, per)
        if method == "simultaneous" and column >= 12:
            fields = fields + step * field_basis[:, column - 12]
        elif which == 0:
            S[k] *= 1.0 + step
        elif which == 1:
            delta[k] += step * truth.sensitivity[k] * 9.8
        elif which < 4:
            axes[k] += step * axis_basis[k, which - 2]
        else:
            fields[k] += step * field_basis[k, which - 4]
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        fields /= np.linalg.norm(fields, axis=1, keepdims=True)
        return SensorParameters(9.8, S, delta, axes, fields).coefficients.T

    for column in range(jacobian.shape[2]):
        numerical = (moved(column, 1e-6) - moved(column, -1e-6)) / 2e-6
        assert np.abs(jacobian[:, :, column] - numerical).max() < 1e-9, parameter_names(method)[column]


# --- exactness and the global minimum --------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("name", TRUTHS)
def test_without_noise_everything_comes_back(name: str, method: Method) -> None:
    """1e-9 is asked for; the condition of the sweep's Gram matrix, about 4, allows some 1e-14."""
    truth, _ = TRUTHS[name]
    statistics = Statistics.from_rotations(sweep_rotations(), readings(sweep_rotations(), truth))
    fit = fit_sensor(statistics, truth.reference_magnitude, method=method)
    assert largest_difference(fit.parameters, truth) < 1e-12
    assert fit.rms.max() < 2e-7  # rounding of the squares of readings near 2.5: sqrt(8 eps) * 2.5


@BOTH
@pytest.mark.parametrize("weighting", ["likelihood", "equal"])
def test_without_noise_any_truth_comes_back(method: Method, weighting: str) -> None:
    """Rounding of the sums, some 1e-15 of readings near 3, over S |g| near 1."""
    rng = np.random.default_rng(2)
    for _ in range(100):
        truth = random_truth(rng)
        fit = fit_sensor(
            noiseless(sweep_statistics(), truth),
            9.8,
            method=method,
            weighting=weighting,  # type: ignore[arg-type]
            field_points=truth.fields[0],
        )
        assert largest_difference(fit.parameters, truth) < 1e-12


@pytest.mark.parametrize(("method", "count"), [("simultaneous", 3_000), ("separate", 1_000)])
def test_any_truth_reaches_the_global_minimum(method: Method, count: int) -> None:
    """Random fields and axes with the paper's noise: the cost never exceeds the truth's, and the truth lies where the
    covariance says. The squared Mahalanobis distance is chi-square with 14 (18) degrees of freedom, of which 80 (90)
    is exceeded with a probability of 3e-11 (2e-11)."""
    rng = np.random.default_rng(3)
    base = sweep_statistics()
    noise = TRUTHS["table5"][1]
    for _ in range(count):
        truth = random_truth(rng)
        theta = truth.coefficients
        statistics = draw(base, rng, theta, noise)
        fit = fit_sensor(statistics, 9.8, method=method, noise=noise, field_points=truth.fields[0])
        residual = np.diag(statistics.square - 2.0 * theta.T @ statistics.cross + theta.T @ base.gram @ theta)
        assert fit.residual_square @ noise**-2.0 <= residual @ noise**-2.0 * (1.0 + 1e-9)
        error = errors(fit, truth, method)
        assert error @ np.linalg.solve(fit.covariance, error) < (80.0 if method == "simultaneous" else 90.0)


@BOTH
@pytest.mark.parametrize(
    "poses", ["six orientations", "twenty orientations", "within 20 degrees", "the sweep's first 400"]
)
def test_no_start_finds_a_lower_cost(poses: str, method: Method) -> None:
    """Thirty descents from random fields never end below the fit, on poses that are not as kind as a sweep's."""
    rng = np.random.default_rng(4)
    for _ in range(8):
        rotations = POSE_SETS[poses](rng).reshape(-1, 9)
        truth = random_truth(rng)
        volts = readings(rotations, truth) + 0.01 * rng.standard_normal((len(rotations), 3))
        statistics = Statistics.from_rotations(rotations, volts)
        fit = fit_sensor(statistics, 9.8, method=method, noise=np.full(3, 0.01), refuse=False)
        square = statistics.square.diagonal()[None]
        data = Centred.of(statistics.gram, statistics.cross[None], square, np.array([statistics.count])).problems
        left, starts = fit.residual_square / fit.count, unit_vectors(rng, 30).T
        every = np.zeros(30, dtype=np.intp)
        if method == "simultaneous":
            others = descend(data.select(every), starts, every).cost
            assert left.sum() <= others.min() * (1.0 + 1e-7)
            continue
        for k in range(3):
            one = Problems(data.covariance, data.cross[:, :, k : k + 1], data.variance[:, k : k + 1])
            assert left[k] <= descend(one.select(every), starts, every).cost.min() * (1.0 + 1e-7)


@BOTH
def test_equal_weights_are_the_papers_least_squares(method: Method) -> None:
    """Against (14) and (15) written out in angles and minimised by SciPy from the truth, sample by sample.

    The two optima agree to SciPy's tolerance: its cost is flat to 1e-15, its parameters to 1e-8 at most.
    """
    truth, noise = TRUTHS["table10"]
    rotations = sweep_rotations(300)
    volts = readings(rotations, truth) + noise * np.random.default_rng(5).standard_normal((300, 3))
    R = rotations.reshape(-1, 3, 3)
    fit = fit_sensor(Statistics.from_rotations(rotations, volts), 1.0, method=method, weighting="equal")

    def model(x: np.ndarray, k: int) -> np.ndarray:
        S, delta, beta, gamma, phi, psi = x
        felt = np.einsum("nij,i,j->n", R, direction_from_angles(phi, psi), direction_from_angles(beta, gamma))
        return S * felt + delta - volts[:, k]

    beta, gamma = angles_from_direction(truth.axes)
    phi, psi = angles_from_direction(truth.fields)
    start = np.stack([truth.sensitivity, truth.offset, beta, gamma, phi, psi], axis=1)
    options = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "x_scale": "jac"}
    if method == "separate":
        found = np.array([least_squares(model, start[k], args=(k,), **options).x for k in range(3)])
    else:

        def together(x: np.ndarray) -> np.ndarray:
            return np.concatenate([model(np.concatenate([x[4 * k : 4 * k + 4], x[12:]]), k) for k in range(3)])

        x = least_squares(together, np.concatenate([start[:, :4].ravel(), start[0, 4:]]), **options).x
        found = np.hstack([x[:12].reshape(3, 4), np.tile(x[12:], (3, 1))])
    expected = SensorParameters(
        1.0,
        found[:, 0],
        found[:, 1],
        direction_from_angles(found[:, 2], found[:, 3]),
        direction_from_angles(found[:, 4], found[:, 5]),
    )
    assert largest_difference(fit.parameters, expected) < 1e-7


# --- conventions and calls -------------------------------------------------------------------------------------------


@BOTH
def test_the_sign_is_chosen_by_where_the_field_points(method: Method) -> None:
    truth, _ = TRUTHS["table10"]
    statistics = noiseless(sweep_statistics(), truth)
    down = fit_sensor(statistics, method=method).parameters
    up = fit_sensor(statistics, method=method, field_points=(0.0, 0.0, 1.0)).parameters
    sideways = fit_sensor(statistics, method=method, field_points=(0.0, -1.0, 0.0)).parameters
    assert (down.fields[:, 2] < 0).all()
    for other in (up, sideways):
        assert np.array_equal(other.fields, -down.fields)
        assert np.array_equal(other.axes, -down.axes)
        assert np.array_equal(other.sensitivity, down.sensitivity)
        assert (other.sensitivity > 0).all()


def test_a_horizontal_field_has_a_definite_sign() -> None:
    """With z of exactly zero in truth, rounding must not choose: the largest component is made positive."""
    for field in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.6, -0.8, 0.0)):
        truth = SensorParameters.of(TABLE_5, field)
        found = fit_sensor(noiseless(sweep_statistics(), truth), 1.0).parameters.fields[0]
        assert found[np.argmax(np.abs(found))] > 0.7


def test_fewer_samples_than_parameters_are_refused_as_input() -> None:
    truth, _ = TRUTHS["table5"]
    for count, method in ((13, "simultaneous"), (5, "separate")):
        statistics = noiseless(sweep_statistics(count), truth)
        with pytest.raises(RigError, match=f"found {count} samples for the {count + 1} parameters") as caught:
            fit_sensor(statistics, 9.8, method=method)  # type: ignore[arg-type]
        assert not isinstance(caught.value, RefusedFit)


@pytest.mark.parametrize("count", [14, 20, 40])
def test_the_smallest_sets_that_are_accepted_are_right(count: int) -> None:
    """Noise estimated from few degrees of freedom: errors over deviations stay below ten, where Student's t with the
    fewest degrees (about 9) is exceeded with a probability of 4e-6 a parameter."""
    truth, noise = TRUTHS["table10"]
    rng = np.random.default_rng(18)
    for _ in range(50):
        fit = fit_sensor(draw(sweep_statistics(count), rng, truth.coefficients, noise), 1.0)
        assert (np.abs(errors(fit, truth, "simultaneous")) < 10.0 * np.sqrt(fit.covariance.diagonal())).all()


def test_wrong_calls_are_refused() -> None:
    truth, _ = TRUTHS["table5"]
    statistics = noiseless(sweep_statistics(), truth)
    with pytest.raises(RigError, match=r"unknown method 'seperate'.*nearest: 'separate'"):
        fit_sensor(statistics, method="seperate")  # type: ignore[arg-type]
    with pytest.raises(RigError, match="unknown weighting"):
        fit_sensor(statistics, weighting="equally")  # type: ignore[arg-type]
    with pytest.raises(RigError, match="expected the three of one sensor"):
        fit_sensor(statistics.select(slice(0, 2)))
    for noise in ((0.1, 0.1), (0.1, -0.1, 0.1), (0.1, np.nan, 0.1)):
        with pytest.raises(RigError, match="noise: found"):
            fit_sensor(statistics, noise=noise)


def test_noise_of_zero_is_taken_as_rounding() -> None:
    truth, _ = TRUTHS["table5"]
    fit = fit_sensor(noiseless(sweep_statistics(), truth), 9.8, noise=np.zeros(3))
    assert largest_difference(fit.parameters, truth) < 1e-12
    assert (fit.noise > 0).all()
    assert fit.noise.max() < 3e-7


def test_scales_of_units_do_not_matter() -> None:
    """The same readings in mV and raw counts: the same axes and field, everything else in proportion, to rounding."""
    truth, noise = TRUTHS["table10"]
    statistics = draw(sweep_statistics(1000), np.random.default_rng(19), truth.coefficients, noise)
    reference = fit_sensor(statistics, 1.0)
    for factor, magnitude in product((1e-3, 1e3, 1638.4), (1.0, 47.0)):
        scaled = Statistics(1000, statistics.gram, factor * statistics.cross, factor**2 * statistics.square)
        fit = fit_sensor(scaled, magnitude)
        assert np.abs(fit.parameters.axes - reference.parameters.axes).max() < 1e-9
        assert np.abs(fit.parameters.sensitivity * magnitude / factor - reference.parameters.sensitivity).max() < 1e-9
        assert np.abs(fit.covariance / reference.covariance - 1.0).max() < 1e-5
