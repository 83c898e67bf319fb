"""What poses cannot tell the known-angle calibration, and that it says so."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_examples import (
    BOTH,
    GRAVITY,
    TABLE_5,
    TRUTHS,
    errors,
    random_truth,
    readings,
    sweep_rotations,
    sweep_statistics,
)
from scipy.spatial.transform import Rotation
from statistics_draws import draw

from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.identifiability import Information, bound
from estimators.known_angle.model import WEIGHTINGS, Method, SensorParameters
from estimators.known_angle.reported import report
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.directions import direction_from_angles
from rig.errors import RefusedFit, RigError


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
    same = "channel 2 reads the same"
    for dead, reason in (
        (np.full(6656, 2.5), same),
        (np.zeros(6656), same),
        (rng.normal(2.5, 0.0136, 6656), "axis2"),
    ):
        spoilt = volts + noise * rng.standard_normal(volts.shape)
        spoilt[:, 1] = dead
        with pytest.raises(RefusedFit, match=reason):
            fit_sensor(Statistics.from_rotations(sweep_rotations(), spoilt), 9.8)


def test_a_fit_says_what_it_is_and_a_refusal_of_which_sensor() -> None:
    truth, noise = TRUTHS["table5"]
    statistics = draw(sweep_statistics(), np.random.default_rng(17), truth.coefficients, noise)
    for weighting in WEIGHTINGS:
        fit = fit_sensor(statistics, 9.8, weighting=weighting)
        assert (fit.method, fit.weighting, fit.count) == ("simultaneous", weighting, 6656)
    few = Statistics.from_rotations(sweep_rotations(5), np.ones((5, 3)))
    with pytest.raises(RigError, match=r"^wrist: found 5 samples"):
        fit_sensor(few, name="wrist")
    with pytest.raises(RefusedFit, match=r"^wrist: channel 1 reads the same"):
        fit_sensor(Statistics.from_rotations(sweep_rotations(50), np.ones((50, 3))), name="wrist")


def test_gamma_cannot_be_told_with_beta_at_90_degrees() -> None:
    axes = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    truth = SensorParameters(9.8, np.full(3, 0.14), np.full(3, 2.5), axes, np.tile(GRAVITY / 9.8, (3, 1)))
    noise = np.full(3, 0.0134)
    fit = fit_sensor(draw(sweep_statistics(), np.random.default_rng(16), truth.coefficients, noise), 9.8)
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
