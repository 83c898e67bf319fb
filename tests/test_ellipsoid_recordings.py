"""Recordings without attitude: two sensors in one frame, poses at rest, files, and the calibration that comes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from estimators.calibration import Calibration
from estimators.calibration.fields import apply
from estimators.ellipsoid import Options, Start, align, calibrate, calibrate_attitude_free, fit_ellipsoid
from estimators.stillness import average_poses, find_still
from rig.acquisition import Acquisition
from rig.arrays import Array
from rig.environment import Environment
from rig.errors import RefusedFit, RigError
from rig.maneuver import HandTumble
from rig.recording import Recording, scan_recording
from rig.sensor import TriaxialSensor
from rig.simulate import Rig

ENVIRONMENT = Environment(gravity_m_s2=9.80292, magnetic_field=0.55176, magnetic_direction=(0.33591, 0.03839, -0.94111))
ACCELEROMETER = TriaxialSensor.from_axes(
    (0.1426, 0.1425, 0.1420), (2.375, 2.449, 2.110), np.eye(3) + 0.02 * np.array([[0, 1, 0], [0, 0, 1.5], [-1, 0, 0]])
)
#: Turned about all axes, and with axes of the same hand.
MAGNETOMETER = TriaxialSensor.from_axes(
    (2.357, 2.407, 2.418),
    (2.422, 2.397, 2.764),
    Rotation.from_rotvec([0.5, -0.8, 1.9]).as_matrix() + 0.01 * np.array([[0, 1, 0], [0, 0, -2], [1, 0, 0]]),
)
NOISE = (0.0134, 0.0136, 0.0146, 0.0085, 0.0068, 0.0117)
ANGLE_DEG = float(np.degrees(np.arccos(0.94111 / np.linalg.norm([0.33591, 0.03839, 0.94111]))))


def rig(magnetometer: TriaxialSensor = MAGNETOMETER, environment: Environment = ENVIRONMENT) -> Rig:
    acquisition = Acquisition(noise_V=NOISE, range_V=None, bits=None, decimation=1)
    return Rig(None, environment, ACCELEROMETER, magnetometer, acquisition)


def tumbled(seed: int = 1, sensors: Rig | None = None, duration_s: float = 60.0) -> Recording:
    maneuver = HandTumble(seed=seed, duration_s=duration_s, rate_Hz=100.0, speed_deg_per_s=120.0)
    return (rig() if sensors is None else sensors).simulate(maneuver, np.random.default_rng(seed), name="tumble")


def stopped(seed: int = 1) -> Recording:
    maneuver = HandTumble(
        seed=seed,
        duration_s=160.0,
        rate_Hz=50.0,
        speed_deg_per_s=60.0,
        sway_m=0.05,
        sway_Hz=1.0,
        hold_s=2.5,
        move_s=1.5,
    )
    return rig().simulate(maneuver, np.random.default_rng(seed), motion="inertial", name="stopped")


def own_frame(sensor: TriaxialSensor) -> Array:
    """(3, 3) from frame 6 to the frame in which the gain is symmetric: S P = A Q."""
    return np.asarray(polar(np.asarray(sensor.sensitivity)[:, None] * sensor.axes, side="left")[0])


def rotation_error(found: Array, magnetometer: TriaxialSensor = MAGNETOMETER) -> Array:
    """(3,) [deg] in the accelerometer's frame."""
    true = own_frame(ACCELEROMETER) @ own_frame(magnetometer).T
    return np.degrees(Rotation.from_matrix(found @ true.T).as_rotvec())


def truth_of(sensor: TriaxialSensor) -> Array:
    """Sensitivities, angles [deg], offsets."""
    axes = sensor.axes
    angles = [np.degrees(np.arccos(axes[i] @ axes[j])) for i, j in ((0, 1), (0, 2), (1, 2))]
    return np.array([*sensor.sensitivity, *angles, *sensor.offset])


def test_both_sensors_in_one_frame() -> None:
    """22 figures within 4.5 standard deviations: a false failure in 7,000."""
    run = tumbled()
    found = calibrate_attitude_free(run, run.sensors, options=Options(rest="all"))
    for name, truth in (("accelerometer", ACCELEROMETER), ("magnetometer", MAGNETOMETER)):
        calibration = found.sensors[name]
        error = calibration.values - truth_of(truth)
        assert (np.abs(error) < 4.5 * np.sqrt(calibration.covariance.diagonal())).all()
        assert calibration.field_direction is None
        assert not calibration.axes
    alignment = found.extra["alignment"]
    spread = np.sqrt(np.diagonal(alignment["covariance_deg2"]))
    assert (np.abs(rotation_error(np.array(alignment["R_accelerometer_magnetometer"]))) < 4.5 * spread[:3]).all()
    assert abs(alignment["angle_deg"] - ANGLE_DEG) < 4.5 * alignment["angle_std_deg"]
    assert alignment["angle_std_deg"] == spread[3]
    assert len(alignment["cannot_tell"]) == 2
    # In one frame the two calibrated fields stand at that angle, sample by sample.
    fields = apply(Calibration(found.sensors), run)
    gravity, magnetic = fields.readings("accelerometer"), fields.readings("magnetometer")
    cosine = (gravity * magnetic).sum(axis=1) / np.linalg.norm(gravity, axis=1) / np.linalg.norm(magnetic, axis=1)
    assert np.degrees(np.arccos(cosine.mean())) == pytest.approx(ANGLE_DEG, abs=0.1)
    assert cosine.std() < 0.01


def test_the_alignment_s_covariance_is_that_of_its_errors() -> None:
    """200 draws: a standard deviation to 5 %, a mean to 0.07 of one. Within 5 of these: a false failure in 2e5 runs."""
    rng = np.random.default_rng(5)
    attitudes = Rotation.random(300, rng=rng).as_matrix()
    gravity, magnetic = ENVIRONMENT.gravity @ attitudes, ENVIRONMENT.magnetic @ attitudes
    noise = np.array(NOISE)
    scores = []
    for _ in range(200):
        a = gravity @ (ACCELEROMETER.axes.T * ACCELEROMETER.sensitivity) + ACCELEROMETER.offset
        m = magnetic @ (MAGNETOMETER.axes.T * MAGNETOMETER.sensitivity) + MAGNETOMETER.offset
        a = a + noise[:3] * rng.standard_normal(a.shape)
        m = m + noise[3:] * rng.standard_normal(m.shape)
        first = fit_ellipsoid(a, 9.80292, noise=noise[:3])
        second = fit_ellipsoid(m, 0.55176, noise=noise[3:])
        found = align(first, second, a, m)
        error = [*rotation_error(found.R_accelerometer_magnetometer), found.angle_deg - ANGLE_DEG]
        scores.append(np.array(error) / np.sqrt(found.covariance.diagonal()))
    assert np.std(scores, axis=0) == pytest.approx(np.ones(4), abs=0.25)
    assert np.abs(np.mean(scores, axis=0)).max() < 0.36


def test_handedness_is_told_by_where_the_field_points_only() -> None:
    """One sensor with left-handed axes: -R and the other angle fit as well."""
    mirrored = TriaxialSensor.from_axes(
        MAGNETOMETER.sensitivity, MAGNETOMETER.offset, np.diag([1, 1, -1]) @ MAGNETOMETER.axes
    )
    run = tumbled(sensors=rig(mirrored))
    fits = [
        fit_ellipsoid(run.readings(name), magnitude)
        for name, magnitude in (("accelerometer", 9.80292), ("magnetometer", 0.55176))
    ]
    readings = [run.readings(name) for name in run.sensors]
    alone = align(fits[0], fits[1], readings[0], readings[1])
    assert np.linalg.det(alone.R_accelerometer_magnetometer) == pytest.approx(1.0)
    assert alone.angle_deg == pytest.approx(180.0 - ANGLE_DEG, abs=0.2)
    told = align(fits[0], fits[1], readings[0], readings[1], field_points="down")
    assert told.angle_deg == pytest.approx(ANGLE_DEG, abs=0.2)
    assert rotation_error(told.R_accelerometer_magnetometer, mirrored) == pytest.approx(np.zeros(3), abs=0.3)
    same = align(fits[0], fits[1], readings[0], readings[1], field_points="up")
    assert (same.R_accelerometer_magnetometer == alone.R_accelerometer_magnetometer).all()


def test_parallel_fields_are_refused() -> None:
    pole = replace(ENVIRONMENT, magnetic_direction=(0.02, 0.0, -1.0))
    run = tumbled(sensors=rig(environment=pole))
    found = calibrate_attitude_free(run, run.sensors, options=Options(rest="all"))
    assert "within 5 deg of parallel" in found.extra["alignment"]["refused"]
    assert np.allclose(found.sensors["magnetometer"].matrix, found.sensors["magnetometer"].matrix.T)


def test_attitudes_about_one_axis_are_refused() -> None:
    """Even with known sensors: turning about gravity tells nothing of a rotation about it."""
    run = tumbled()
    fits = [fit_ellipsoid(run.readings(n), h) for n, h in (("accelerometer", 9.80292), ("magnetometer", 0.55176))]
    rng = np.random.default_rng(3)
    turns = Rotation.from_euler("z", rng.uniform(0.0, 360.0, (500, 1)), degrees=True).as_matrix()
    a = ENVIRONMENT.gravity @ turns @ (ACCELEROMETER.axes.T * ACCELEROMETER.sensitivity) + ACCELEROMETER.offset
    m = ENVIRONMENT.magnetic @ turns @ (MAGNETOMETER.axes.T * MAGNETOMETER.sensitivity) + MAGNETOMETER.offset
    noise = rng.standard_normal((500, 6)) * NOISE
    with pytest.raises(RefusedFit, match=r"alignment: .*turn the sensors about at least two axes"):
        align(fits[0], fits[1], a + noise[:, :3], m + noise[:, 3:])


def test_the_accelerometer_is_calibrated_at_rest() -> None:
    """All samples together, those in motion among them, lie on no ellipsoid."""
    run = stopped()
    found = calibrate_attitude_free(run, ["accelerometer"])
    calibration = found.sensors["accelerometer"]
    error = calibration.values - truth_of(ACCELEROMETER)
    assert (np.abs(error) < 4.5 * np.sqrt(calibration.covariance.diagonal())).all()
    assert not calibration.quality.warnings
    still = average_poses(run, find_still(run, sensors=["accelerometer"]))
    assert calibration.samples == still.counts.sum()
    same = calibrate_attitude_free(still.recording, ["accelerometer"]).sensors["accelerometer"]
    assert same.values.tolist() == calibration.values.tolist()
    with pytest.raises(RefusedFit, match="no ellipsoid"):
        calibrate_attitude_free(run, ["accelerometer"], options=Options(rest="all", robust=False))


def test_never_at_rest() -> None:
    run = tumbled(duration_s=20.0)
    found = calibrate_attitude_free(run, ["accelerometer"]).sensors["accelerometer"]
    assert any("never at rest: all samples were taken" in warning for warning in found.quality.warnings)
    with pytest.raises(RefusedFit, match="never stands still"):
        calibrate_attitude_free(run, ["accelerometer"], options=Options(rest="poses"))


def test_the_calibration_is_written_and_read_again() -> None:
    run = tumbled()
    found = calibrate_attitude_free(run, run.sensors, options=Options(rest="all"))
    calibration = Calibration(found.sensors, run.name, None, found.extra)
    assert Calibration.from_text(calibration.to_text()).to_text() == calibration.to_text()
    text = str(calibration)
    assert "angle1-2" in text
    assert "sensitivity3" in text
    sensor = calibration["magnetometer"]
    assert sensor.method == "ellipsoid"
    low, high = sensor.interval("gain12")
    assert low < sensor.value("gain12") < high
    assert sensor.std("angle1-3_deg") > 0.0
    own = sensor.matrix @ np.linalg.inv(sensor.matrix)
    assert own == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize("parameters", [6, 9])
def test_sensitivities_and_angles_are_propagated(parameters: int) -> None:
    """Against differences: the covariance of the two forms is one and the same."""
    run = tumbled(duration_s=20.0)
    made = calibrate_attitude_free(run, ["magnetometer"], options=Options(parameters=parameters)).sensors[
        "magnetometer"
    ]  # type: ignore[arg-type]
    gain = made.vector_values[: parameters - 3]

    def physical(entries: Array) -> Array:
        matrix = np.diag(entries[:3])
        for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), entries[3:], strict=False):
            matrix[i, j] = matrix[j, i] = value
        length = np.linalg.norm(matrix, axis=1)
        unit = matrix / length[:, None]
        pairs = ((0, 1), (0, 2), (1, 2)) if parameters == 9 else ()
        return np.array([*length, *(np.degrees(np.arccos(unit[i] @ unit[j])) for i, j in pairs)])

    assert made.values[: parameters - 3] == pytest.approx(physical(gain), rel=1e-12)
    step = 1e-6
    slope = np.array(
        [(physical(gain + step * e) - physical(gain - step * e)) / (2 * step) for e in np.eye(len(gain))]
    ).T
    expected = slope @ made.vector_covariance[: len(gain), : len(gain)] @ slope.T
    assert made.covariance[: len(gain), : len(gain)] == pytest.approx(expected, rel=1e-5)


def test_a_given_floor_is_held_against_the_residuals() -> None:
    run = tumbled()
    noise = np.array(NOISE[3:])
    right = calibrate_attitude_free(run, ["magnetometer"], {"magnetometer": (noise, np.zeros(3))}, "locked recording")
    quality = right.sensors["magnetometer"].quality
    assert quality.chi_square is not None
    assert quality.chi_square["p_value"] > 1e-5
    assert np.abs(np.array(quality.chi_square["residual_over_floor"]) - 1.0).max() < 0.1
    assert right.sensors["magnetometer"].noise_source == "locked recording"
    wrong = calibrate_attitude_free(run, ["magnetometer"], {"magnetometer": (0.5 * noise, np.zeros(3))})
    quality = wrong.sensors["magnetometer"].quality
    assert any("times the noise floor" in warning for warning in quality.warnings)


def test_relative_and_as_in_the_paper() -> None:
    run = tumbled(duration_s=20.0)
    stated = calibrate_attitude_free(run, ["magnetometer"]).sensors["magnetometer"]
    relative = calibrate_attitude_free(run, ["magnetometer"], options=Options(relative=True)).sensors["magnetometer"]
    assert relative.reference_magnitude == 1.0
    assert relative.matrix == pytest.approx(stated.matrix / 0.55176, rel=1e-12)
    assert relative.bias == pytest.approx(stated.bias, rel=1e-12)
    paper = calibrate_attitude_free(run, ["magnetometer"], options=Options(start={"magnetometer": Start(2.4, 2.5)}))
    assert paper.sensors["magnetometer"].method == "ellipsoid, levenberg-marquardt"
    assert paper.sensors["magnetometer"].bias == pytest.approx(stated.bias, abs=5.0 * stated.std("offset1"))


def test_a_file_is_read_in_constant_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tumbled()
    run.write(tmp_path / "run.parquet")
    seen: list[int] = []
    whole = calibrate_attitude_free(
        scan_recording(tmp_path / "run.parquet", batch_rows=1000),
        run.sensors,
        options=Options(rest="all"),
        progress=seen.append,
    )
    memory = calibrate_attitude_free(run, run.sensors, options=Options(rest="all"))
    assert whole.sensors["accelerometer"].values.tolist() == memory.sensors["accelerometer"].values.tolist()
    assert sum(seen) == len(run)
    monkeypatch.setattr(calibrate, "MOST_SAMPLES", 2000)
    part = calibrate_attitude_free(scan_recording(tmp_path / "run.parquet", batch_rows=700), run.sensors)
    every = calibrate_attitude_free(run.select(slice(None, None, 4)), run.sensors)
    assert part.sensors["magnetometer"].values.tolist() == every.sensors["magnetometer"].values.tolist()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parameters": 12}, "parameters: found 12, expected 6 or 9"),
        ({"rest": "pose"}, "nearest: 'poses'"),
        ({"field_points": "dwn"}, "nearest: 'down'"),
    ],
)
def test_wrong_options(options: dict[str, object], message: str) -> None:
    with pytest.raises(RigError, match=message):
        Options(**options)  # type: ignore[arg-type]
