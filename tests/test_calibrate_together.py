"""One calibration over several recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig
from scipy.special import chdtri
from statistics_draws import draw

import estimators
import scenarios
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.from_recording import statistics_of
from estimators.known_angle.together import Part, contributions, fit_together
from rig.arm import Arm
from rig.errors import RefusedFit, RigError
from rig.recording import Recording

DOWN = (0.0, 0.0, -1.0)


@pytest.fixture(scope="module")
def sweep() -> Recording:
    return replace(scenarios.load("ann-arbor").simulate(seed=3), name="sweep")


def _turn(run: Recording) -> Recording:
    """The samples of the first half turn of joint 1 alone: about one axis, which no calibration comes from."""
    assert run.q is not None
    q = np.tile(run.q[0], (400, 1))
    q[:, 0] += np.linspace(0.0, 1.5, 400)
    rows = slice(0, 400)
    arm = Arm.a465()
    assert run.accelerometer is not None
    moved = replace(run.select(rows), q=q, name="turn")
    calibration = estimators.calibrate(run)
    own = calibration["accelerometer"]
    assert own.field_direction is not None
    fields = np.matmul(
        9.8 * own.field_direction.vector, moved.rotations(arm).reshape(-1, 3, 3)
    )  # the sensor's frame: R^T f
    noise = 0.013 * np.random.default_rng(8).standard_normal((400, 3))
    volts = own.offset + own.sensitivity * (fields @ own.axis_vectors.T) + noise
    return replace(moved, accelerometer=volts, magnetometer=None, units={"accelerometer": "V"})


def test_two_halves_together_are_the_whole(sweep: Recording) -> None:
    half = len(sweep) // 2
    parts = [replace(sweep.select(slice(0, half)), name="a"), replace(sweep.select(slice(half, None)), name="b")]
    noise = {"accelerometer": [0.0134] * 3, "magnetometer": [0.008] * 3}
    whole, joint = estimators.calibrate(sweep, noise=noise), estimators.calibrate(parts, noise=noise)
    for sensor in ("accelerometer", "magnetometer"):
        spread = np.sqrt(np.diag(whole[sensor].covariance))
        told = np.isfinite(spread)
        assert (np.abs(joint[sensor].values - whole[sensor].values)[told] < 1e-6 * spread[told]).all()
        assert np.allclose(np.sqrt(np.diag(joint[sensor].covariance))[told], spread[told], rtol=1e-6)
        assert np.allclose(joint[sensor].fit_rms, whole[sensor].fit_rms, rtol=1e-9)
        shares = [each["share"] for each in joint.extra["recordings"][sensor]]
        assert sum(shares) == pytest.approx(1.0)


@pytest.mark.parametrize("known", [True, False])
def test_recordings_of_other_noise_are_weighed_by_it(sweep: Recording, known: bool) -> None:
    """14 parameters of each of 200 draws: their chi-square by the stated covariance is one of 2,800, twice 1e-6 beyond.

    Noise that is estimated from 13,000 residuals is known to .4 %, which is next to nothing of that.
    """
    arm = Arm.a465()
    assert sweep.accelerometer is not None
    data = statistics_of(sweep, arm, [sweep.accelerometer], "sweep")
    truth = fit_sensor(data, 9.8, noise=[0.0134] * 3).parameters
    half = len(sweep) // 2
    other = statistics_of(sweep.select(slice(0, half)), arm, [sweep.accelerometer[:half]], "half")
    rng = np.random.default_rng(5)
    quiet, loud = np.array([0.01, 0.012, 0.014]), np.array([0.08, 0.05, 0.03])
    total = 0.0
    for _ in range(200):
        drawn = [draw(data, rng, truth.coefficients, loud), draw(other, rng, truth.coefficients, quiet)]
        parts = [
            Part(name, each, sigma if known else None, np.zeros(3))
            for name, each, sigma in zip("ab", drawn, (loud, quiet), strict=True)
        ]
        joint = fit_together(parts, 9.8, "simultaneous", "likelihood", DOWN, "accelerometer")
        found = joint.fit.parameters
        # the coefficients are functions of the parameters: their errors, through the Jacobian, are the parameters'
        jacobian = truth.jacobian("simultaneous").reshape(30, -1)
        error = np.linalg.lstsq(jacobian, (found.coefficients - truth.coefficients).T.ravel(), rcond=None)[0]
        total += float(error @ np.linalg.solve(joint.fit.covariance, error))
        if not known:
            assert np.allclose(joint.noise, [loud, quiet], rtol=0.06)  # 3,328 samples: 1.2 % a standard deviation
    freedom = 200 * 14
    assert chdtri(freedom, 1.0 - 1e-6) < total < chdtri(freedom, 1e-6)


def test_a_recording_that_disagrees_is_named(sweep: Recording) -> None:
    half = len(sweep) // 2
    first, second = sweep.select(slice(0, half)), sweep.select(slice(half, None))
    assert second.accelerometer is not None
    spoilt = replace(second, accelerometer=second.accelerometer + np.array([0.01, 0.0, 0.0]), name="b")
    runs = [replace(first, name="a"), spoilt]
    found = estimators.calibrate(runs)
    assert any("b does not agree" in words for words in found["accelerometer"].quality.warnings)
    judged = estimators.judged_together(runs, found)
    verdicts = {name: own.quality.verdict for name, own in judged.sensors.items()}
    assert verdicts["accelerometer"] is not None
    assert not verdicts["accelerometer"]["good"]
    assert verdicts["magnetometer"] is not None
    assert verdicts["magnetometer"]["good"]


def test_agreement_is_a_chi_square(sweep: Recording) -> None:
    """Over 300 draws the mean of chi-square of 14 lies within five standard errors of 14."""
    arm = Arm.a465()
    assert sweep.accelerometer is not None
    data = statistics_of(sweep, arm, [sweep.accelerometer], "sweep")
    truth = fit_sensor(data, 9.8, noise=[0.0134] * 3).parameters
    rng = np.random.default_rng(6)
    noise = np.array([0.0134, 0.0134, 0.0146])
    squares = []
    for _ in range(300):
        parts = [Part(name, draw(data, rng, truth.coefficients, noise), noise, np.zeros(3)) for name in "ab"]
        joint = fit_together(parts, 9.8, "simultaneous", "likelihood", DOWN, "accelerometer")
        told = contributions(joint)
        assert [each["agreement"]["degrees_of_freedom"] for each in told] == [14, 14]
        squares.append(told[0]["agreement"]["chi_square"])
    assert abs(np.mean(squares) - 14.0) < 5.0 * np.sqrt(28.0 / 300)


def test_a_turn_about_one_axis_joins_others(sweep: Recording) -> None:
    turn = _turn(sweep)
    with pytest.raises(RefusedFit):
        estimators.calibrate(turn)
    found = estimators.calibrate([sweep, turn])
    own = found.extra["recordings"]["accelerometer"]
    assert [each["recording"] for each in own] == ["sweep", "turn"]
    assert own[1]["agreement"]["degrees_of_freedom"] < 14  # it cannot tell the rest
    assert own[1]["agreement"]["p_value"] > 1e-6
    assert len(found.extra["recordings"]["magnetometer"]) == 1
    judged = estimators.judged_together([sweep, turn], found)
    verdict = judged["accelerometer"].quality.verdict
    assert verdict is not None
    assert verdict["good"], verdict["text"]


def test_units_may_differ(sweep: Recording) -> None:
    half = len(sweep) // 2
    first, second = sweep.select(slice(0, half)), sweep.select(slice(half, None))
    millivolts = {sensor: 1e3 * second.readings(sensor) for sensor in second.sensors}
    other = replace(second, **millivolts, units=dict.fromkeys(second.sensors, "mV"), name="b")
    same = estimators.calibrate([replace(first, name="a"), replace(second, name="b")])
    found = estimators.calibrate([replace(first, name="a"), other])
    for sensor in same.sensors:
        assert np.allclose(found[sensor].vector_values, same[sensor].vector_values, rtol=1e-6, atol=1e-9)


def test_what_cannot_be_one_is_refused(sweep: Recording) -> None:
    heavier = replace(sweep, metadata=replace(sweep.metadata, gravity_m_s2=9.7), name="b")
    with pytest.raises(RigError, match=r"gravity_m_s2: found 9\.7, expected 9\.8"):
        estimators.calibrate([sweep, heavier])
    with pytest.raises(RigError, match="found the name 'sweep' again"):
        estimators.calibrate([sweep, sweep])
    with pytest.raises(RigError, match="ellipsoid"):
        estimators.calibrate([sweep, replace(sweep, name="b")], method="ellipsoid")


def test_from_the_command_line(sweep: Recording, tmp_path: Path, rig: Rig) -> None:
    half = len(sweep) // 2
    sweep.select(slice(0, half)).write(tmp_path / "a.parquet")
    sweep.select(slice(half, None)).write(tmp_path / "b.csv")
    found = rig("calibrate", tmp_path / "a.parquet", tmp_path / "b.csv", "-o", tmp_path / "cal.json")
    assert found.status == 0, found.err
    assert "share of what is told" in found.out
    read = estimators.Calibration.read(tmp_path / "cal.json")
    assert read.recording == "a and b"
    assert read["accelerometer"].samples == len(sweep)
    robust = rig("calibrate", tmp_path / "a.parquet", tmp_path / "b.csv", "--robust")
    assert robust.status == 2
    assert "--robust: found 2 recordings, expected one" in robust.err
