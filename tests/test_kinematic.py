"""Known-angle calibration: exact without noise, at the Cramer-Rao bound with it, from any data, or refused."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from kinematic_examples import (
    GRAVITY,
    TABLE_5,
    TRUTHS,
    errors,
    largest_difference,
    noiseless,
    random_truth,
    readings,
    sweep_angles,
    sweep_rotations,
    sweep_statistics,
    unit_vectors,
)
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from estimators.identifiability import Information, bound
from estimators.kinematic import fit_sensor
from estimators.model import METHODS, Method, SensorParameters, parameter_names
from estimators.reported import report
from estimators.search import Compressed, refine
from estimators.statistics import Statistics
from rig.arm import Arm
from rig.directions import angles_from_direction, direction_from_angles, tangent_basis
from rig.errors import RefusedFit, RigError

BOTH = pytest.mark.parametrize("method", METHODS)


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


@pytest.mark.parametrize(("method", "count"), [("simultaneous", 10_000), ("separate", 1_000)])
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
        statistics = base.draw(rng, theta, noise)
        fit = fit_sensor(statistics, 9.8, method=method, noise=noise, field_points=truth.fields[0])
        residual = np.diag(statistics.square - 2.0 * theta.T @ statistics.cross + theta.T @ base.gram @ theta)
        assert fit.residual_square @ noise**-2.0 <= residual @ noise**-2.0 * (1.0 + 1e-9)
        error = errors(fit, truth, method)
        assert error @ np.linalg.solve(fit.covariance, error) < (80.0 if method == "simultaneous" else 90.0)


POSE_SETS = {
    "six orientations": lambda rng: np.repeat(Rotation.random(6, rng=rng).as_matrix(), 10, axis=0),
    "twenty orientations": lambda rng: Rotation.random(20, rng=rng).as_matrix(),
    "within 20 degrees": lambda rng: Rotation.from_rotvec(0.2 * rng.standard_normal((100, 3))).as_matrix(),
    "the sweep's first 400": lambda rng: Arm.a465().rotation_map.rotations(sweep_angles()[:400]),
}


@BOTH
@pytest.mark.parametrize("poses", POSE_SETS)
def test_no_start_finds_a_lower_cost(poses: str, method: Method) -> None:
    """Thirty descents from random fields never end below the fit, on poses that are not as kind as a sweep's."""
    rng = np.random.default_rng(4)
    for _ in range(8):
        rotations = POSE_SETS[poses](rng).reshape(-1, 9)
        truth = random_truth(rng)
        volts = readings(rotations, truth) + 0.01 * rng.standard_normal((len(rotations), 3))
        statistics = Statistics.from_rotations(rotations, volts)
        fit = fit_sensor(statistics, 9.8, method=method, noise=np.full(3, 0.01), refuse=False)
        data = Compressed.of(statistics)
        for start in unit_vectors(rng, 30):
            if method == "simultaneous":
                other = refine(data, start, np.ones(3)).mean_square.sum()
                assert fit.residual_square.sum() / fit.count <= other * (1.0 + 1e-7)
            else:
                for k in range(3):
                    other = refine(data.channel(k), start, np.ones(1)).mean_square[0]
                    assert fit.residual_square[k] / fit.count <= other * (1.0 + 1e-7)


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


# --- uncertainty -----------------------------------------------------------------------------------------------------


def trials(
    name: str, method: Method, draws: int, seed: int, *, known: bool, count: int = 6656, factor: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors over their standard deviations (draws, p), errors over the bound's, and the deviations' ratio to it."""
    truth, noise = TRUTHS[name]
    sigma = factor * noise
    base = sweep_statistics(count)
    limit = np.sqrt(bound(base.gram, truth, sigma, method).diagonal())
    rng = np.random.default_rng(seed)
    standardised, over_bound, ratio = [], [], []
    for _ in range(draws):
        statistics = base.draw(rng, truth.coefficients, sigma)
        fit = fit_sensor(statistics, truth.reference_magnitude, method=method, noise=sigma if known else None)
        error, std = errors(fit, truth, method), np.sqrt(fit.covariance.diagonal())
        # Student's quantile in units of the normal one: what an interval from estimated noise is taken with.
        wider = 1.0 if known else stdtrit(fit.degrees_of_freedom.min(), 0.975) / 1.96
        standardised.append(error / (wider * std))
        over_bound.append(error / limit)
        ratio.append(std / limit)
    return np.array(standardised), np.array(over_bound), np.array(ratio)


@BOTH
@pytest.mark.parametrize("known", [True, False], ids=["noise given", "noise estimated"])
def test_intervals_hold_95_percent_and_deviations_equal_the_bound(method: Method, known: bool) -> None:
    """Three truths x 300 seeds at 6,656 samples with the paper's noise, pooled over S, delta and tangent coordinates.

    The parameters of one draw are correlated, so the pooled standard error is found from the spread between draws:
    about 0.2 %, which puts the limits of 94 and 96 % five of them away (false failure below 1 in a million). The pooled
    RMS error over the bound has a relative standard error of 0.6 %, and 5 % is asked for.
    """
    found = [trials(name, method, 300, seed, known=known) for seed, name in enumerate(TRUTHS)]
    standardised = np.vstack([z for z, _, _ in found])
    over_bound = np.vstack([z for _, z, _ in found])
    ratio = np.vstack([r for _, _, r in found])
    covered = (np.abs(standardised) < 1.96).mean(axis=1)
    standard_error = covered.std() / np.sqrt(len(covered))
    assert standard_error < 0.0025
    assert 0.94 < covered.mean() < 0.96
    assert abs(np.sqrt((over_bound**2).mean()) - 1.0) < 0.05
    assert np.abs(ratio - 1.0).max() < 0.05  # each reported deviation: the noise is known to 0.9 %, S to 0.03 %


@BOTH
@pytest.mark.parametrize("factor", [1.0, 10.0])
@pytest.mark.parametrize("count", [100, 1000])
def test_the_same_with_fewer_samples_and_more_noise(count: int, factor: float, method: Method) -> None:
    """Over the whole sweep, noise estimated; pooled standard error 0.4 %, limits four of them away (1 in 16,000)."""
    standardised, over_bound, _ = trials("table10", method, 250, count, known=False, count=count, factor=factor)
    covered = (np.abs(standardised) < 1.96).mean(axis=1)
    assert abs(covered.mean() - 0.95) < 4.0 * max(covered.std(), 0.055) / np.sqrt(len(covered))
    assert abs(np.sqrt((over_bound**2).mean()) - 1.0) < 0.06  # relative standard error 1.2 to 1.5 %


def test_equal_weights_cost_what_their_covariance_says() -> None:
    """One channel ten times noisier. The spread of 400 estimates over the sandwich's deviations, pooled: standard error
    1 %; the naive inverse of equally weighted information would be off by 30 % and more, and weights by likelihood are
    better."""
    truth, _ = TRUTHS["table10"]
    noise = np.array([0.005, 0.05, 0.005])
    base = sweep_statistics(1000)
    rng = np.random.default_rng(6)
    standardised = []
    for _ in range(400):
        statistics = base.draw(rng, truth.coefficients, noise)
        fit = fit_sensor(statistics, 1.0, noise=noise, weighting="equal")
        standardised.append(errors(fit, truth, "simultaneous") / np.sqrt(fit.covariance.diagonal()))
    assert abs(np.sqrt((np.array(standardised) ** 2).mean()) - 1.0) < 0.05
    best = bound(base.gram, truth, noise).diagonal()
    equal = Information.of(base.gram, truth, np.ones(3))
    gained = best / equal.sandwich(noise, np.ones(3)).diagonal()
    assert gained.max() <= 1.0 + 1e-9
    assert gained.min() < 0.7


def test_estimated_noise_is_unbiased_and_its_degrees_add_up() -> None:
    """At 40 samples, where the 14 parameters are a large part: the mean of 1,000 variances within four standard errors
    (for three channels: a chance of 1 in 5,000)."""
    truth, noise = TRUTHS["table10"]
    base = sweep_statistics(40)
    rng = np.random.default_rng(7)
    fits = [fit_sensor(base.draw(rng, truth.coefficients, noise), 1.0) for _ in range(1000)]
    ratio = np.array([fit.noise**2 / noise**2 for fit in fits])
    assert (np.abs(ratio.mean(axis=0) - 1.0) < 4.0 * np.sqrt(2.0 / 35.0 / 1000.0)).all()
    assert all(abs(fit.degrees_of_freedom.sum() - (3 * 40 - 14)) < 1e-6 for fit in fits)


@pytest.mark.parametrize("name", ["table2", "table5"])
def test_an_elevation_near_the_pole_keeps_its_95_percent(name: str) -> None:
    """Gravity along the base z axis (Table 2), and within its own uncertainty of it (Table 5): phi is a length there.

    1,000 draws have a standard error of 0.7 %; by design between 93.7 and 97 % are held: 4.5 standard errors around it.
    """
    truth, noise = TRUTHS[name]
    phi = float(angles_from_direction(truth.fields[0])[0])
    rng = np.random.default_rng(8)
    held, widened = [], 0
    for _ in range(1000):
        fit = fit_sensor(sweep_statistics().draw(rng, truth.coefficients, noise), 9.8, noise=noise)
        reported = report(fit.parameters, fit.covariance, "simultaneous")
        row = reported.names.index("phi_deg")
        held.append(abs(reported.values[row] - phi) < 1.96 * np.sqrt(reported.covariance[row, row]))
        widened += any(warning.startswith("phi:") for warning in reported.warnings)
        assert "psi_deg" in reported.untold
        assert np.isnan(reported.covariance[reported.names.index("psi_deg")]).all()
    assert 0.905 < np.mean(held) < 0.999
    assert widened > 900


@BOTH
def test_reported_angles_and_vectors_spread_as_they_say(method: Method) -> None:
    """400 draws of Table 10: each angle and vector component, error over deviation has an RMS of one to four standard
    errors of 3.5 % (fails by chance for some parameter of 30 in 500 seeds)."""
    truth, noise = TRUTHS["table10"]
    rng = np.random.default_rng(9)
    exact = report(truth, np.eye(len(parameter_names(method))), method)
    scores, vector_scores = [], []
    for _ in range(400):
        fit = fit_sensor(sweep_statistics().draw(rng, truth.coefficients, noise), 1.0, method=method, noise=noise)
        found = report(fit.parameters, fit.covariance, method)
        assert not found.untold
        assert not found.warnings
        difference = found.values - exact.values
        scores.append(difference / np.sqrt(found.covariance.diagonal()))
        vector_scores.append((found.vector_values - exact.vector_values) / np.sqrt(found.vector_covariance.diagonal()))
    for score in (np.array(scores), np.array(vector_scores)):
        assert np.abs(np.sqrt((score**2).mean(axis=0)) - 1.0).max() < 4.0 * 0.0354


# --- what the data cannot tell ---------------------------------------------------------------------------------------


def moving(*joints: int, count: int = 300) -> np.ndarray:
    """Rotations (n, 9) with these joints of the A465 moving at random, the others locked as in the sweep."""
    rng = np.random.default_rng(10)
    q = np.tile(np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0]), (count, 1))
    for joint in joints:
        q[:, joint - 1] = rng.uniform(-1.5, 1.5, count)
    return Arm.a465().rotation_map.rotations(q)


def measured(rotations: np.ndarray, truth: SensorParameters, noise: float = 0.01) -> Statistics:
    rng = np.random.default_rng(11)
    return Statistics.from_rotations(
        rotations, readings(rotations, truth) + noise * rng.standard_normal((len(rotations), 3))
    )


@BOTH
@pytest.mark.parametrize("joint", [1, 5, 6])
def test_one_moving_joint_cannot_calibrate(joint: int, method: Method) -> None:
    truth = SensorParameters.of(TABLE_5, 9.8 * direction_from_angles(50.0, 20.0))
    with pytest.raises(RefusedFit, match=r"these poses cannot determine sensitivity1.*directions on one circle only"):
        fit_sensor(measured(moving(joint), truth), 9.8, method=method)


@BOTH
def test_joint_1_alone_with_gravity_along_it_reads_the_same(method: Method) -> None:
    truth = SensorParameters.of(TABLE_5, (0.0, 0.0, -9.8))
    with pytest.raises(RefusedFit, match="these poses cannot determine"):
        fit_sensor(measured(moving(1), truth), 9.8, method=method)
    with pytest.raises(RefusedFit, match="channel 1 reads the same in every orientation"):
        fit_sensor(measured(moving(1), truth, noise=0.0), 9.8, method=method)


@BOTH
@pytest.mark.parametrize("known", [True, False])
def test_joints_1_and_5_with_gravity_along_joint_1_do_not_deceive(known: bool, method: Method) -> None:
    """Joint 1 then changes nothing, but an estimate of gravity that noise has tilted sees it change something. Two
    joints do calibrate where gravity is inclined to both."""
    noise = np.full(3, 0.01) if known else None
    rotations = moving(1, 5)
    for seed in range(40):
        truth = SensorParameters.of(TABLE_5, (0.0, 0.0, -9.8))
        volts = readings(rotations, truth) + 0.01 * np.random.default_rng(seed).standard_normal((len(rotations), 3))
        with pytest.raises(RefusedFit, match="these poses"):
            fit_sensor(Statistics.from_rotations(rotations, volts), 9.8, method=method, noise=noise)
    inclined = SensorParameters.of(TABLE_5, 9.8 * direction_from_angles(50.0, 20.0))
    fit_sensor(measured(rotations, inclined), 9.8, method=method, noise=noise)


@BOTH
@pytest.mark.parametrize("orientations", [1, 2, 3, 4, 5])
def test_few_orientations_are_refused_however_many_samples(orientations: int, method: Method) -> None:
    rng = np.random.default_rng(12)
    rotations = np.repeat(Rotation.random(orientations, rng=rng).as_matrix(), 200, axis=0).reshape(-1, 9)
    with pytest.raises(RefusedFit, match="never changes" if orientations == 1 else "cannot determine|too few to check"):
        fit_sensor(measured(rotations, TRUTHS["table5"][0]), 9.8, method=method)


def test_orientations_repeated_with_rounded_encoders_are_no_more() -> None:
    rng = np.random.default_rng(13)
    held = np.repeat(rng.uniform(-1.5, 1.5, (3, 6)), 200, axis=0)
    q = held + 15.7e-6 * rng.integers(-1, 2, held.shape)
    with pytest.raises(RefusedFit, match="these poses"):
        fit_sensor(measured(Arm.a465().rotation_map.rotations(q), TRUTHS["table5"][0]), 9.8)


def test_two_solutions_that_fit_alike_are_refused() -> None:
    """Seven orientations give a channel 7 equations for 6 unknowns: many sets have a second solution within the noise.

    What is accepted is the true one: no error exceeds 0.5 (of S, of S |f|, rad), five of the largest deviations
    that are accepted. The other solutions' fields lie tens of degrees away.
    """
    rng = np.random.default_rng(14)
    refused = 0
    for _ in range(100):
        rotations = np.repeat(Rotation.random(7, rng=rng).as_matrix(), 10, axis=0).reshape(-1, 9)
        truth = random_truth(rng)
        noise = np.full(3, 0.003)
        volts = readings(rotations, truth) + noise * rng.standard_normal((70, 3))
        statistics = Statistics.from_rotations(rotations, volts)
        fit = fit_sensor(statistics, 9.8, method="separate", noise=noise, field_points=truth.fields[0], refuse=False)
        if fit.problem is None:
            assert np.abs(errors(fit, truth, "separate")).max() < 0.5
        else:
            refused += fit.problem.startswith("two solutions whose fields lie")
    assert refused >= 1


def test_a_channel_that_does_not_respond_is_refused() -> None:
    truth, noise = TRUTHS["table5"]
    volts = readings(sweep_rotations(), truth)
    rng = np.random.default_rng(15)
    for dead, reason in ((np.full(6656, 2.5), "channel 2 reads the same"), (rng.normal(2.5, 0.0136, 6656), "axis2")):
        spoilt = volts + noise * rng.standard_normal(volts.shape)
        spoilt[:, 1] = dead
        with pytest.raises(RefusedFit, match=reason):
            fit_sensor(Statistics.from_rotations(sweep_rotations(), spoilt), 9.8)


def test_gamma_cannot_be_told_with_beta_at_90_degrees() -> None:
    axes = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    truth = SensorParameters(9.8, np.full(3, 0.14), np.full(3, 2.5), axes, np.tile(GRAVITY / 9.8, (3, 1)))
    noise = np.full(3, 0.0134)
    fit = fit_sensor(sweep_statistics().draw(np.random.default_rng(16), truth.coefficients, noise), 9.8)
    reported = report(fit.parameters, fit.covariance, "simultaneous")
    assert "gamma1_deg" in reported.untold
    assert "axis 1 lies 0.0" in reported.untold["gamma1_deg"]
    assert not {"gamma2_deg", "gamma3_deg", "beta1_deg"} & set(reported.untold)
    row = reported.names.index("gamma1_deg")
    assert np.isnan(reported.covariance[row]).all()
    assert np.isnan(reported.covariance[:, row]).all()
    told = np.delete(np.arange(14), [row, reported.names.index("psi_deg")])
    assert np.isfinite(reported.covariance[np.ix_(told, told)]).all()
    # The axis itself is told: across it, by the bound.
    limit = np.sqrt(bound(sweep_statistics().gram, truth, noise)[2, 2])
    first = reported.vector_names.index("axis1_x")
    assert abs(np.sqrt(reported.vector_covariance[first, first]) / limit - 1.0) < 0.05
    assert (np.abs(fit.parameters.axes[0] - axes[0]) < 5.0 * limit).all()


def test_the_null_space_is_that_of_the_model() -> None:
    """Three orientations: 9 equations for 14 parameters leave 5 directions open; the covariance ignores these."""
    rng = np.random.default_rng(17)
    rotations = np.repeat(Rotation.random(3, rng=rng).as_matrix(), 20, axis=0).reshape(-1, 9)
    gram = Statistics.from_rotations(rotations, np.zeros((60, 3))).gram
    information = Information.of(gram, random_truth(rng), np.full(3, 0.01))
    assert information.null.shape == (14, 5)
    assert np.isinf(information.condition)
    assert np.isnan(bound(gram, random_truth(rng), 0.01)).any()
    full = Information.of(sweep_statistics().gram, random_truth(rng), np.full(3, 0.01))
    assert full.null.shape == (14, 0)
    assert np.abs(full.covariance @ full.matrix - np.eye(14)).max() < 1e-9


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
        fit = fit_sensor(sweep_statistics(count).draw(rng, truth.coefficients, noise), 1.0)
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
    statistics = sweep_statistics(1000).draw(np.random.default_rng(19), truth.coefficients, noise)
    reference = fit_sensor(statistics, 1.0)
    for factor, magnitude in product((1e-3, 1e3, 1638.4), (1.0, 47.0)):
        scaled = Statistics(1000, statistics.gram, factor * statistics.cross, factor**2 * statistics.square)
        fit = fit_sensor(scaled, magnitude)
        assert np.abs(fit.parameters.axes - reference.parameters.axes).max() < 1e-9
        assert np.abs(fit.parameters.sensitivity * magnitude / factor - reference.parameters.sensitivity).max() < 1e-9
        assert np.abs(fit.covariance / reference.covariance - 1.0).max() < 1e-5
