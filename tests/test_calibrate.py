"""From recordings, in memory and on disk, to calibrations, and from these to fields."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kinematic_examples import BOTH_NOISES, BOTH_SENSORS, TRUTHS, run_of, sweep_angles
from scipy.spatial.transform import Rotation
from statistics_draws import draw

import estimators
from estimators.calibration.fields import apply_file, field_of
from estimators.known_angle.from_recording import summarise
from estimators.known_angle.model import METHODS, Method
from rig.arm import Arm
from rig.channels import COLUMNS_OF
from rig.errors import RefusedFit, RigError
from rig.recording import Metadata, Recording, read_recording, scan_recording


def locked(seed: int = 100, scale: float = 1.0, count: int = 4000) -> Recording:
    """Two held poses with the two sensors' noise."""
    q = np.repeat(
        np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0], [0.0, 90.0, -90.0, 0.0, 60.0, 90.0]]), count // 2, axis=0
    )
    return run_of(BOTH_SENSORS, scale * BOTH_NOISES, seed, q, t=np.arange(count) / 100.0)


def tool_poses(run: Recording) -> Recording:
    """The same run with the tool's orientation in place of joint angles."""
    R = Arm.a465().poses(run.q).R_base_tool
    turns = Rotation.from_matrix(R).as_quat(scalar_first=True)
    return replace(run, q=None, tool_quaternion=turns)


@pytest.mark.parametrize("method", METHODS)
def test_both_sensors_of_a_run_come_back(method: Method) -> None:
    """Within six standard deviations each: a chance of 2e-9 a parameter. The angles between the axes likewise."""
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 0)
    found = estimators.calibrate(run, method)
    assert list(found.sensors) == ["accelerometer", "magnetometer"]
    for sensor, truth in BOTH_SENSORS.items():
        result = found[sensor]
        for k in range(3):
            for name, expected in ((f"sensitivity{k + 1}", truth.sensitivity[k]), (f"offset{k + 1}", truth.offset[k])):
                assert abs(result.value(name) - expected) < 6.0 * result.std(name)
            for axis, component in enumerate("xyz"):
                name = f"axis{k + 1}_{component}"
                assert abs(result.value(name) - truth.axes[k, axis]) < 6.0 * result.std(name) + 1e-6
        for i, j in ((0, 1), (0, 2), (1, 2)):
            pair = f"{i + 1}-{j + 1}"
            angle = np.degrees(np.arccos(truth.axes[i] @ truth.axes[j]))
            assert abs(result.angles_between_deg[pair] - angle) < 6.0 * result.angles_between_std_deg[pair]
        assert result.field_direction is not None
        assert np.degrees(np.arccos(min(1.0, float(result.field_direction.vector @ truth.fields[0])))) < 0.1
        assert np.isclose(result.fit_rms_root_sum_square, np.sqrt((result.fit_rms**2).sum()))
        assert (np.abs(result.fit_rms / BOTH_NOISES[int(sensor == "magnetometer")] - 1.0) < 0.05).all()
        assert (result.axes[0].field is not None) == (method == "separate")
        assert (result.quality.field_agreement is not None) == (method == "separate")


def test_separate_fits_agree_on_one_field_as_often_as_they_should() -> None:
    """The p-values of 200 runs without any gap are uniform: Kolmogorov's distance exceeds 2.2/sqrt(n) once in 8,000."""
    values = []
    rng = np.random.default_rng(1)
    run = run_of({"magnetometer": TRUTHS["table10"][0]}, 0.0, 0)
    summed = summarise(run, ["magnetometer"])
    for _ in range(200):
        statistics = draw(summed.statistics, rng, TRUTHS["table10"][0].coefficients, BOTH_NOISES[1])
        fit = estimators.known_angle.fit.fit_sensor(statistics, 1.0, method="separate", noise=BOTH_NOISES[1])
        agreement = estimators.known_angle.assemble.assemble(fit, noise_source="given").quality.field_agreement
        assert agreement is not None
        values.append(agreement["p_value"])
    uniform = np.sort(values)
    assert np.abs(uniform - (np.arange(200) + 0.5) / 200).max() < 2.2 / np.sqrt(200)


def test_residuals_are_judged_against_the_floor() -> None:
    """Without a gap p is uniform (below 1e-6 once in a million); with a cubic error of half the noise it is not."""
    floor = estimators.noise_floor(locked())
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 2)
    for result in estimators.calibrate(run, noise=floor).sensors.values():
        chi_square = result.quality.chi_square
        assert chi_square is not None
        assert abs(chi_square["degrees_of_freedom"] - (3 * 6656 - 14)) < 1e-6
        assert chi_square["p_value"] > 1e-6
        assert not [warning for warning in result.quality.warnings if "noise floor" in warning]
        assert result.noise_source == "locked recording"
        assert result.noise_degrees_of_freedom is None
    volts = run.readings("magnetometer").copy()
    volts[:, 1] += 0.02 * ((volts[:, 1] - 2.4) / 1.3) ** 3
    spoilt = estimators.calibrate(replace(run, magnetometer=volts), noise=floor)["magnetometer"]
    assert spoilt.quality.chi_square is not None
    assert spoilt.quality.chi_square["p_value"] < 1e-6
    assert any("times the noise floor" in warning for warning in spoilt.quality.warnings)


def test_a_short_locked_recording_is_not_trusted_beyond_its_length() -> None:
    """Floors from 200 samples are off by 5 %; with the floor's own uncertainty p stays uniform (Kolmogorov, 1 in
    8,000)."""
    truth = TRUTHS["table10"][0]
    base = summarise(run_of({"magnetometer": truth}, 0.0, 0), ["magnetometer"]).statistics
    rng = np.random.default_rng(3)
    values = []
    for seed in range(150):
        floor = estimators.noise_floor(locked(seed, count=200)).of("magnetometer")
        assert floor is not None
        statistics = draw(base, rng, truth.coefficients, BOTH_NOISES[1])
        fit = estimators.known_angle.fit.fit_sensor(statistics, 1.0, noise=floor[0])
        values.append(estimators.known_angle.assemble.chi_square_of(fit, floor[1])["p_value"])
    uniform = np.sort(values)
    assert np.abs(uniform - (np.arange(150) + 0.5) / 150).max() < 2.2 / np.sqrt(150)


def test_a_file_in_batches_is_the_recording_in_memory(tmp_path: Path) -> None:
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 4)
    run.write(tmp_path / "run.parquet")
    whole = estimators.calibrate(run)
    for source in (tmp_path / "run.parquet", str(tmp_path / "run.parquet")):
        found = estimators.calibrate(source)
        assert found.recording == "run"
        assert found["accelerometer"].noise_source == "residuals"
        for sensor in found.sensors:
            # The same numbers, summed in the same blocks.
            assert np.abs(found[sensor].vector_values - whole[sensor].vector_values).max() < 1e-12
    parts = summarise(scan_recording(tmp_path / "run.parquet", batch_rows=1000), ["accelerometer", "magnetometer"])
    direct = summarise(run, ["accelerometer", "magnetometer"])
    assert np.abs(parts.statistics.cross / direct.statistics.cross - 1.0).max() < 1e-9
    assert parts.statistics.count == direct.statistics.count


def test_a_file_is_calibrated_in_constant_memory(tmp_path: Path) -> None:
    """Forty batches need no more than four do, give or take two batches (13 columns of 8,192 doubles), which a garbage
    collection at another moment makes; all at once they would need 36 more."""
    rows = 8192
    peaks = []
    for batches in (4, 40):
        q = np.resize(sweep_angles(), (batches * rows, 6))
        volts = np.random.default_rng(5).normal(2.5, 1.0, (len(q), 3))
        run = Recording(t=np.arange(len(q)) / 100.0, q=q, accelerometer=volts, magnetometer=volts)
        run.write(tmp_path / "long.parquet")
        del run, q, volts
        tracemalloc.start()
        summed = summarise(scan_recording(tmp_path / "long.parquet", batch_rows=rows), ["accelerometer"])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert summed.statistics.count == batches * rows
    assert peaks[1] < peaks[0] + 2 * 13 * rows * 8


def test_the_locked_recording_beside_a_file_is_its_floor(tmp_path: Path) -> None:
    run_of(BOTH_SENSORS, BOTH_NOISES, 6).write(tmp_path / "run.parquet")
    locked().write(tmp_path / "run.locked.parquet")
    found = estimators.calibrate(tmp_path / "run.parquet")["magnetometer"]
    assert found.noise_source == "locked recording"
    assert found.noise is not None
    assert (np.abs(found.noise / BOTH_NOISES[1] - 1.0) < 0.06).all()  # 4,000 samples: 1.1 %, five of it
    assert estimators.calibrate(tmp_path / "run.parquet", noise="residuals")["magnetometer"].noise_source == "residuals"
    given = estimators.calibrate(tmp_path / "run.parquet", noise={"magnetometer": BOTH_NOISES[1]})
    assert given["magnetometer"].noise_source == "given"
    assert given["accelerometer"].noise_source == "residuals"
    six = estimators.calibrate(tmp_path / "run.parquet", noise=BOTH_NOISES.ravel())
    assert six["accelerometer"].noise_source == "given"


def test_tool_poses_give_what_joint_angles_give() -> None:
    """Orientations differ by rounding, some 1e-15."""
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 7)
    joints, tool = estimators.calibrate(run), estimators.calibrate(tool_poses(run))
    assert (joints.arm, tool.arm) == ("a465", None)
    for sensor in joints.sensors:
        assert np.abs(joints[sensor].vector_values - tool[sensor].vector_values).max() < 1e-11


def test_an_arm_that_is_asked_for_comes_before_the_tools_pose() -> None:
    """Tool poses that are wrong by 10 deg are used unless an arm is given."""
    run = run_of(BOTH_SENSORS, 0.0, 8)
    poses = tool_poses(run).tool_quaternion
    turned = Rotation.from_quat(poses, scalar_first=True) * Rotation.from_euler("x", 10.0, degrees=True)
    both = replace(run, tool_quaternion=turned.as_quat(scalar_first=True))
    assert estimators.calibrate(both).arm is None
    found = estimators.calibrate(both, arm=Arm.a465())
    assert found.arm == "a465"
    assert np.abs(found["accelerometer"].axis_vectors - BOTH_SENSORS["accelerometer"].axes).max() < 1e-9
    assert (
        np.abs(estimators.calibrate(both)["accelerometer"].axis_vectors - found["accelerometer"].axis_vectors).max()
        > 0.1
    )


def test_other_units_and_magnitudes_are_taken_as_they_are() -> None:
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 9)
    reference = estimators.calibrate(run)
    other = replace(
        run,
        accelerometer=1e3 * run.readings("accelerometer"),
        units={"accelerometer": "mV", "magnetometer": "raw"},
        metadata=Metadata(gravity_m_s2=9.80292, magnetic_field=0.5518, magnetic_field_unit="G"),
    )
    found = estimators.calibrate(other)
    assert (found["accelerometer"].unit, found["magnetometer"].unit) == ("mV", "raw")
    ratio = found["accelerometer"].sensitivity / reference["accelerometer"].sensitivity
    assert np.abs(ratio - 1e3 * 9.8 / 9.80292).max() < 1e-6
    ratio = found["magnetometer"].sensitivity / reference["magnetometer"].sensitivity
    assert np.abs(ratio - 1.0 / 0.5518).max() < 1e-6
    assert np.abs(found["accelerometer"].offset - 1e3 * reference["accelerometer"].offset).max() < 1e-6
    floor = estimators.noise_floor(locked())
    assert np.allclose(
        estimators.calibrate(other, noise=floor, sensors=["accelerometer"])["accelerometer"].noise,
        1e3 * floor.rms[COLUMNS_OF["accelerometer"]],
    )


def test_the_field_may_point_up_for_one_sensor() -> None:
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 10)
    found = estimators.calibrate(run, field_points={"magnetometer": "up"})
    for sensor, sign in (("accelerometer", -1.0), ("magnetometer", 1.0)):
        direction = found[sensor].field_direction
        assert direction is not None
        assert direction.vector[2] * sign > 0
        assert f"(0, 0, {sign:g})" in str(found[sensor].convention)
    sideways = estimators.calibrate(run, sensors=["magnetometer"], field_points=(0.0, -1.0, 0.0))
    assert list(sideways.sensors) == ["magnetometer"]
    with pytest.raises(RigError, match=r"unknown field_points 'dwon'.*nearest: 'down'"):
        estimators.calibrate(run, field_points="dwon")
    with pytest.raises(RigError, match="expected 'down', 'up' or three numbers"):
        estimators.calibrate(run, field_points=(0.0, 0.0, 0.0))


def test_a_horizontal_field_is_warned_about() -> None:
    truth = replace(TRUTHS["table10"][0], fields=np.tile([0.6, 0.8, 0.0], (3, 1)))
    found = estimators.calibrate(run_of({"magnetometer": truth}, BOTH_NOISES[1], 11))["magnetometer"]
    assert any("its sign" in warning for warning in found.quality.warnings)


def test_what_cannot_be_calibrated_is_refused_by_name() -> None:
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 12)
    with pytest.raises(RigError, match=r"has no pose.*attitude-free"):
        estimators.calibrate(replace(run, q=None), method="simultaneous")
    with pytest.raises(RigError, match="arm 'ur5' is not built in"):
        estimators.calibrate(replace(run, metadata=Metadata(arm="ur5")))
    with pytest.raises(RigError, match="unknown recorded sensor 'gyro'"):
        estimators.calibrate(run, sensors=["gyro"])
    with pytest.raises(RigError, match=r"unknown noise 'residual'.*nearest: 'residuals'"):
        estimators.calibrate(run, noise="residual")  # type: ignore[arg-type]
    with pytest.raises(RigError, match=r"noise: found an array of shape \(5,\)"):
        estimators.calibrate(run, noise=np.ones(5))
    beyond = np.array(run.q)
    beyond[77, 4] = np.radians(120.0)
    with pytest.raises(RigError, match="joint5 is at 120 deg in sample 77"):
        estimators.calibrate(replace(run, q=beyond))
    with pytest.raises(RigError, match="found 10 samples for the 14 parameters") as caught:
        estimators.calibrate(run.select(slice(0, 10)))
    assert not isinstance(caught.value, RefusedFit)
    with pytest.raises(RefusedFit, match="recording: accelerometer: "):
        estimators.calibrate(replace(run, q=np.tile(run.q[0], (len(run), 1))))


def test_a_roll_joint_may_turn_for_ever() -> None:
    assert np.degrees(sweep_angles()[:, 5]).max() > 20_000
    estimators.calibrate(run_of(BOTH_SENSORS, BOTH_NOISES, 13))


def test_applying_gives_the_field_in_the_tools_frame(tmp_path: Path) -> None:
    """Exactly without noise: rounding of readings near 3 V over sensitivities near 0.14 is 1e-13. Files likewise."""
    run = run_of(BOTH_SENSORS, 0.0, 14, metadata=Metadata(magnetic_field_unit="G"))
    found = estimators.calibrate(run)
    applied = estimators.apply(found, run)
    R = Arm.a465().poses(run.q).R_base_tool
    for sensor, truth in BOTH_SENSORS.items():
        expected = truth.reference_magnitude * np.einsum("nij,i->nj", R, truth.fields[0])
        assert np.abs(applied.readings(sensor) - expected).max() < 1e-10
    assert dict(applied.units) == {"accelerometer": "m_s2", "magnetometer": "G"}
    run.write(tmp_path / "run.parquet")
    done: list[int] = []
    assert apply_file(found, tmp_path / "run.parquet", tmp_path / "out.csv", done.append) == len(run) == sum(done)
    for sensor in BOTH_SENSORS:
        assert np.array_equal(read_recording(tmp_path / "out.csv").readings(sensor), applied.readings(sensor))
    # A calibration of calibrated readings finds unit sensitivity and no offset.
    again = estimators.calibrate(applied)
    assert np.abs(again["accelerometer"].sensitivity - 1.0).max() < 1e-10
    assert np.abs(again["accelerometer"].offset).max() < 1e-10


def test_units_are_converted_where_they_can_be() -> None:
    run = run_of(BOTH_SENSORS, 0.0, 15)
    found = estimators.calibrate(run)
    volts = run.readings("accelerometer")
    expected = field_of(found["accelerometer"], volts)
    assert np.abs(field_of(found["accelerometer"], 1e3 * volts, "mV") - expected).max() < 1e-12 * 9.8 * 100
    with pytest.raises(RigError, match="unit 'g' cannot be converted to 'V'"):
        field_of(found["accelerometer"], volts, "g")
    only = replace(run, accelerometer=None, units={"magnetometer": "V"})
    missing = replace(found, sensors={"accelerometer": found["accelerometer"]})
    with pytest.raises(RigError, match="expected a sensor that was calibrated: accelerometer"):
        estimators.apply(missing, only)
    assert estimators.apply(missing, run).sensors == ("accelerometer",)


def test_parallel_axes_have_no_matrix() -> None:
    truth = TRUTHS["table10"][0]
    parallel = replace(truth, axes=truth.axes[[0, 0, 2]])
    run = run_of({"magnetometer": parallel}, 0.0, 16)
    found = estimators.calibrate(run)
    assert np.isnan(found["magnetometer"].matrix).all()
    assert any("do not span space" in warning for warning in found["magnetometer"].quality.warnings)
    with pytest.raises(RigError, match="do not span space"):
        estimators.apply(found, run)


SHARED = Path(__file__).parents[1].parent / "shared" / "practice"


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"needs the recordings of an independent simulator in {SHARED}")
def test_an_independent_simulators_quiet_recordings_come_back() -> None:
    """White noise and no effect: 30 numbers a recording within six standard deviations, with floors from some 6,000
    samples of the locked arm; signs, frames and names are those of the contract."""
    truths = json.loads((SHARED / "truth.json").read_text())
    quiet = [name for name, truth in truths.items() if truth["stratum"] == "null"]
    assert quiet
    for name in quiet:
        truth = truths[name]["calibration"]
        found = estimators.calibrate(SHARED / f"{name}.parquet")
        for sensor, (S, delta, axes) in {
            "accelerometer": ("S", "delta", "Pa"),
            "magnetometer": ("M", "dm", "Pm"),
        }.items():
            result = found[sensor]
            assert result.noise_source == "locked recording"
            assert result.quality.chi_square is not None
            assert result.quality.chi_square["p_value"] > 1e-6
            for k in range(3):
                expected = {f"sensitivity{k + 1}": truth[S][k], f"offset{k + 1}": truth[delta][k]}
                expected |= {f"axis{k + 1}_{axis}": truth[axes][k][i] for i, axis in enumerate("xyz")}
                for parameter, value in expected.items():
                    assert abs(result.value(parameter) - value) < 6.0 * result.std(parameter), (name, parameter)


def test_progress_counts_every_sample(tmp_path: Path) -> None:
    run = run_of(BOTH_SENSORS, BOTH_NOISES, 17)
    done: list[int] = []
    estimators.calibrate(run, progress=done.append)
    assert sum(done) == len(run)


def test_the_summary_shows_every_parameter_and_what_cannot_be_told() -> None:
    text = str(estimators.calibrate(run_of(BOTH_SENSORS, BOTH_NOISES, 18)))
    for name in ("sensitivity1", "offset3", "beta2", "gamma3", "phi", "psi", "field z", "angle 2-3", "root sum square"):
        assert name in text
    assert "not told: psi: the field lies" in text
