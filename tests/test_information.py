"""What a maneuver can tell before it is run: against differences of the paper's model, published facts and fits."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from kinematic_examples import BOTH, TRUTHS, noiseless, random_truth, sweep_rotations, sweep_statistics
from matplotlib.image import imread
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

import estimators
import scenarios
from estimators.design.attitude_free_bound import FreeSensor
from estimators.design.maneuver_bound import growth, predict
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.model import Method, parameter_names
from estimators.known_angle.statistics import Statistics
from rig.directions import angles_from_direction, direction_from_angles
from rig.errors import RigError
from rig.maneuver import HandTumble, LockedPoses
from scenarios.bound import bound_of, noise_of
from scenarios.loader import from_toml
from scenarios.plots.bound import bound_figure


@BOTH
def test_the_bound_is_that_of_the_papers_model_in_its_own_angles(method: Method) -> None:
    """Renk (14), (15) written out in angles, differentiated by central differences of 1e-6: truncation 1e-12 and
    rounding 1e-10, over a condition below 1e3."""
    truth, noise = TRUTHS["table10"]
    rotations = sweep_rotations(500).reshape(-1, 3, 3)
    names = parameter_names(method)
    beta, gamma = angles_from_direction(truth.axes)
    phi, psi = angles_from_direction(truth.fields)
    values: dict[str, float] = {"phi_deg": float(phi[0]), "psi_deg": float(psi[0])}
    for k in range(3):
        values |= {f"sensitivity{k + 1}": truth.sensitivity[k], f"offset{k + 1}": truth.offset[k]}
        values |= {f"beta{k + 1}_deg": beta[k], f"gamma{k + 1}_deg": gamma[k]}
        values |= {f"phi{k + 1}_deg": phi[k], f"psi{k + 1}_deg": psi[k]}
    start = np.array([values[name] for name in names])

    def volts(x: np.ndarray) -> np.ndarray:
        named = dict(zip(names, x, strict=True))
        columns = []
        for k in (1, 2, 3):
            own = "" if method == "simultaneous" else str(k)
            axis = direction_from_angles(named[f"beta{k}_deg"], named[f"gamma{k}_deg"])
            field = direction_from_angles(named[f"phi{own}_deg"], named[f"psi{own}_deg"])
            felt = np.einsum("nij,i,j->n", rotations, field, axis)
            columns.append((named[f"sensitivity{k}"] * felt + named[f"offset{k}"]) / noise[k - 1])
        return np.concatenate(columns)

    steps = 1e-6 * np.eye(len(names))
    jacobian = np.stack([(volts(start + step) - volts(start - step)) / 2e-6 for step in steps], axis=1)
    expected = np.sqrt(np.linalg.inv(jacobian.T @ jacobian).diagonal())
    gram = Statistics.from_rotations(rotations).gram
    found = predict(gram, 500, truth, noise, method)
    assert found.names == names
    assert found.problem is None
    assert np.abs(found.std / expected - 1.0).max() < 1e-6
    assert np.abs(found.values - start).max() < 1e-10


def test_the_sweeps_bound_is_the_known_one() -> None:
    """Standard deviations of the paper's sweep with the paper's noise, computed independently, printed to two or three
    digits. The converter's rounding, which counts here, adds .03 %."""
    accelerometer = bound_of(scenarios.load("renk2005-accelerometer")).sensors["accelerometer"].prediction
    magnetometer = bound_of(scenarios.load("renk2005-magnetometer")).sensors["magnetometer"].prediction
    for found, expected in (
        (accelerometer, {"sensitivity1": 2.4e-5, "offset1": 1.64e-4, "beta1_deg": 0.0134, "gamma1_deg": 0.165}),
        (magnetometer, {"sensitivity1": 1.97e-4, "offset1": 1.04e-4, "beta1_deg": 0.0070, "gamma1_deg": 0.0086}),
        (magnetometer, {"phi_deg": 0.0047, "psi_deg": 0.0090}),
    ):
        std = dict(zip(found.names, found.std, strict=True))
        for name, value in expected.items():
            assert std[name] == pytest.approx(value, rel=0.025), name


def test_a_calibration_is_as_certain_as_foreseen() -> None:
    """The covariance at the estimate differs from that at the truth by its relative errors, some 1e-3; and the errors
    lie within it: their squared distance is chi-square with 14 degrees, exceeded once in a million."""
    scenario = scenarios.load("ann-arbor")
    noise = noise_of(scenario)
    found = estimators.calibrate(scenario.simulate(seed=5), noise=noise)
    for sensor, bound in bound_of(scenario).sensors.items():
        calibration = found[sensor]
        assert calibration.parameters == bound.prediction.names
        std = np.sqrt(calibration.covariance.diagonal())
        assert np.abs(std / bound.prediction.std - 1.0).max() < 0.01
        error = calibration.values - bound.prediction.values
        error -= 360.0 * np.round(error / 360.0) * np.array([name.endswith("deg") for name in calibration.parameters])
        assert error @ np.linalg.solve(calibration.covariance, error) < chdtri(14, 1e-6)
        between = list(bound.prediction.angles_between_std_deg.values())
        assert list(calibration.angles_between_std_deg.values()) == pytest.approx(between, rel=0.01)


@BOTH
def test_growth_ends_at_the_bound_and_its_shares_add_up(method: Method) -> None:
    truth, noise = TRUTHS["table5"]
    rotations = sweep_rotations()
    parts = [Statistics.from_rotations(block).gram for block in np.array_split(rotations, 26)]
    grown = growth(parts, truth, noise, method)
    whole = predict(np.sum(parts, axis=0), len(rotations), truth, noise, method)
    std = dict(zip(whole.names, whole.std, strict=True))
    assert grown.sensitivity[-1] * truth.sensitivity == pytest.approx([std[f"sensitivity{k}"] for k in (1, 2, 3)])
    assert grown.offset[-1] == pytest.approx([std[f"offset{k}"] for k in (1, 2, 3)])
    assert grown.axis_deg[-1] == pytest.approx(whole.axis_std_deg)
    assert grown.field_deg[-1] == pytest.approx(whole.field_std_deg)
    assert grown.share.sum() == pytest.approx(1.0, abs=1e-12)
    assert (grown.share > 0.0).all()
    for values in (grown.sensitivity, grown.offset, grown.axis_deg, grown.field_deg):
        assert (np.diff(values, axis=0) < 0.0).all()  # every minute pays
    twice = growth([*parts, *parts], truth, noise, method)
    assert twice.axis_deg[-1] == pytest.approx(grown.axis_deg[-1] / np.sqrt(2.0))


def test_nothing_is_claimed_until_it_is_determined() -> None:
    truth, noise = TRUTHS["table5"]
    still = Statistics.from_rotations(np.tile(sweep_rotations()[:1], (50, 1))).gram
    moving = sweep_statistics(1000).gram
    grown = growth([still, moving], truth, noise)
    assert np.isnan(grown.sensitivity[0]).all()
    assert np.isfinite(grown.sensitivity[1]).all()
    never = growth([still, still], truth, noise)
    assert np.isnan(never.axis_deg).all()
    assert np.isnan(never.share).all()


@BOTH
def test_what_poses_leave_open_is_said_with_the_reason(method: Method) -> None:
    truth, noise = TRUTHS["table5"]
    turns = Rotation.from_rotvec(np.linspace(0.0, 6.0, 100)[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    found = predict(Statistics.from_rotations(turns).gram, 100, truth, noise, method)
    assert found.problem is not None
    assert "cannot determine" in found.problem
    assert found.condition == np.inf
    open_ = {name for name, std in zip(found.names, found.std, strict=True) if np.isnan(std)}
    assert open_ == set(found.untold)
    assert {"sensitivity1", "beta1_deg"} <= open_
    assert np.isnan(found.axis_std_deg).all()
    one = predict(Statistics.from_rotations(turns[:1].repeat(20, axis=0)).gram, 20, truth, noise, method)
    assert one.problem == "the orientation never changes, expected readings in many orientations"
    few = replace(scenarios.load("renk2005-accelerometer"), maneuver=LockedPoses(hold_s=10.0, rate_Hz=100.0))
    prediction = bound_of(few, method).sensors["accelerometer"].prediction
    assert prediction.problem is not None
    assert json.dumps(prediction.to_json(), allow_nan=False)


def test_an_angle_without_meaning_is_open_though_its_vector_is_told() -> None:
    """Gravity along the base z axis, as in Table 2: its azimuth is nothing."""
    prediction = bound_of(scenarios.load("renk2005-table2")).sensors["accelerometer"].prediction
    assert set(prediction.untold) == {"psi_deg"}
    assert "use the vector" in prediction.untold["psi_deg"]
    assert prediction.field_std_deg[0] < 0.02
    assert prediction.problem is None


def test_a_problem_foreseen_is_the_refusal_that_comes() -> None:
    """On random small sets of poses, half of which tell too little."""
    rng = np.random.default_rng(0)
    refused = 0
    for count in (3, 4, 5, 6, 8, 20) * 3:
        rotations = np.repeat(Rotation.random(count, rng=rng).as_matrix(), 40 // count + 1, axis=0)
        truth, noise = random_truth(rng), np.full(3, 1e-3)
        base = Statistics.from_rotations(rotations, np.zeros((len(rotations), 3)))
        foreseen = predict(base.gram, base.count, truth, noise).problem
        points = truth.fields[0]
        fit = fit_sensor(noiseless(base, truth), 9.8, noise=noise, field_points=points, refuse=False)
        assert (foreseen is None) == (fit.problem is None)
        refused += foreseen is not None
    assert refused >= 6


def test_without_attitude_the_bound_is_that_of_the_model_with_every_direction_unknown() -> None:
    """The full information of gain, offset and two angles for each of 30 directions, the angles eliminated."""
    rng = np.random.default_rng(1)
    truth = random_truth(rng)
    noise = np.array([0.01, 0.02, 0.015])
    sensor = FreeSensor.of(truth.gain, truth.offset, 9.8)
    directions = rng.standard_normal((30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    own = directions @ sensor.R_own_tool.T
    # The polar decomposition leaves the readings as they are.
    assert np.abs(9.8 * own @ sensor.gain - 9.8 * directions @ truth.gain.T).max() < 1e-12
    size = sensor.gain.diagonal().max()
    columns = []
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = size
        columns.append((9.8 * own @ unit / noise).ravel())
    columns += [(np.tile(np.eye(3)[k] * size * 9.8, (30, 1)) / noise).ravel() for k in range(3)]
    wanted = np.stack(columns, axis=1)
    nuisance = np.zeros((90, 60))
    for row, direction in enumerate(own):
        across = np.linalg.svd(direction[None])[2][1:]
        nuisance[3 * row : 3 * row + 3, 2 * row : 2 * row + 2] = (9.8 * across @ sensor.gain / noise).T
    mixed = wanted.T @ nuisance
    expected = wanted.T @ wanted - mixed @ np.linalg.solve(nuisance.T @ nuisance, mixed.T)
    found = sensor.information(directions, noise)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_a_scenario_without_pose_gets_the_bound_of_the_attitude_free_calibration() -> None:
    scenario = scenarios.load("renk2005-accelerometer")
    blind = scenario.with_acquisition(pose="none")
    bound = bound_of(blind)
    prediction = bound.sensors["accelerometer"].prediction
    gains = [f"gain{ij}" for ij in (11, 22, 33, 12, 13, 23)]
    assert prediction.names == (*gains, "offset1", "offset2", "offset3")
    assert prediction.problem is None
    assert bound.sensors["accelerometer"].growth.share.sum() == pytest.approx(1.0)
    # Attitude helps: an offset is known better with it.
    known = bound_of(scenario).sensors["accelerometer"].prediction
    assert prediction.std[-1] > known.std[known.names.index("offset3")]
    hand = replace(blind, rig=replace(blind.rig, arm=None), maneuver=HandTumble(seed=1, duration_s=60.0))
    assert bound_of(hand).attitude is False
    assert bound_figure(bound)
    few = replace(blind, maneuver=LockedPoses(hold_s=10.0, rate_Hz=100.0))
    problem = bound_of(few).sensors["accelerometer"].prediction.problem
    assert problem is not None
    assert "cannot determine" in problem


def test_without_noise_there_is_no_bound() -> None:
    scenario = from_toml(SMALL, "small.toml")
    silent = scenario.scaled_noise(0.0)
    rounding = noise_of(silent)  # the converter's remains
    assert rounding == pytest.approx(np.full(6, 20.0 / 2.0**14 / np.sqrt(12.0)))
    exact = silent.with_acquisition(bits=None)
    with pytest.raises(RigError, match="without noise everything is told exactly"):
        bound_of(exact)


def test_rig_bound_prints_draws_and_speaks_json(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    said = json.loads(rig.done("bound", tmp_path / "small.toml", "-o", tmp_path / "b.png", "--json"))
    assert said["format"] == "rig-bound/1"
    assert said["time_s"] == [3.0 * number for number in range(1, 21)]
    expected = bound_of(scenarios.load(tmp_path / "small.toml")).sensors["magnetometer"].prediction
    parameters = said["sensors"]["magnetometer"]["parameters"]
    assert [entry["std"] for entry in parameters.values()] == pytest.approx(list(expected.std))
    assert len(said["sensors"]["accelerometer"]["after"]["share"]) == 20
    assert imread(tmp_path / "b.png").shape[1] > 1000
    text = rig.done("bound", "ann-arbor", "--method", "separate")
    assert "field3" in text
    assert "6,656 samples" in text
    assert "learned" in text
    assert "taken as given" in text
    assert "nearest: 'ann-arbor'" in rig.refused("bound", "ann-arbr")
    assert "expected .png" in rig.refused("bound", "ann-arbor", "-o", tmp_path / "b.jpg")


def test_an_accelerometer_in_a_hand_is_counted_at_rest_only() -> None:
    """Two seconds in a pose, two to the next: somewhat under half of the samples. A magnetometer may move."""
    held = bound_of(scenarios.load("camps2009-accelerometer"))
    still = held.sensors["accelerometer"].prediction.samples
    assert 0.4 * 2400 < still < 0.5 * 2400
    moving = scenarios.load("camps2009-magnetometer")
    trajectory = moving.maneuver.trajectory()
    kept = len(trajectory.t[:: moving.rig.acquisition.decimation])
    assert bound_of(moving).sensors["magnetometer"].prediction.samples == kept
