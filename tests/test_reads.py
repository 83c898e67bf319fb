"""Accelerometers that read a - g, up at rest, as the common chips do: everything comes out in what they read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import estimators
import scenarios
from estimators import Calibration
from estimators.calibration.export import export
from estimators.calibration.turned import turned
from estimators.gap.data.basefit import fitted_pipeline
from estimators.gap.diagnosis import Cause, Closed, Estimate
from estimators.gap.report.recorded_units import in_recorded_units
from rig.arm import Arm
from rig.errors import RigError
from rig.maneuver import TorusSweep
from rig.recording import Recording
from scenarios.comparison import compare
from scenarios.loader import from_toml
from scenarios.scenario import Scenario


@pytest.fixture(scope="module")
def chip() -> Scenario:
    """A right-handed chip that lies nearly as its tool does and reads a - g."""
    text = scenarios.load("ann-arbor").to_toml()
    text = text.replace("[acquisition]", '[acquisition]\naccelerometer_reads = "a-g"')
    lines = text.splitlines()
    at = lines.index("[accelerometer]")
    for index, line in enumerate(lines[at:], at):
        if line.startswith("beta_deg"):
            lines[index] = "beta_deg = [2.0, -1.0, -88.0]"
        if line.startswith("gamma_deg"):
            lines[index] = "gamma_deg = [1.0, 91.5, 30.0]"
            break
    found = from_toml("\n".join(lines), "chip.toml")
    return replace(found, maneuver=TorusSweep(duration_s=400.0, yaw_passes=5, pitch_passes=3))


@pytest.fixture(scope="module")
def run(chip: Scenario) -> Recording:
    return chip.simulate(seed=3)


@pytest.fixture(scope="module")
def found(run: Recording) -> Calibration:
    return estimators.calibrate(run)


def test_the_axes_are_those_on_the_chip(chip: Scenario, run: Recording, found: Calibration) -> None:
    own = found["accelerometer"]
    assert run.metadata.accelerometer_reads == own.reads == "a-g"
    assert found["magnetometer"].reads is None
    truth = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    assert np.degrees(np.arccos(np.sum(own.axis_vectors * truth, axis=1))).max() < 3.0  # as the file has them
    assert own.field_direction is not None
    assert own.field_direction.vector[2] > 0.9
    # Against the scenario's truth: ten sigmas fail once in 1e22 draws.
    rows = [row for row in compare(chip.truth, found) if row.error_sigmas is not None]
    assert len(rows) == 28
    assert max(abs(row.error_sigmas) for row in rows) < 10.0
    assert not own.quality.warnings


def test_applied_it_points_up(run: Recording, found: Calibration) -> None:
    applied = estimators.apply(found, run)
    up = np.einsum("nij,nj->ni", Arm.a465().poses(run.q).R_base_tool, applied.accelerometer)
    assert up.mean(axis=0)[2] == pytest.approx(9.8, abs=0.1)  # the base is 3 deg out of level: 9.787
    again = estimators.calibrate(applied)["accelerometer"]
    assert again.matrix == pytest.approx(np.eye(3), abs=0.01)


def test_exports_say_which_it_is(found: Calibration) -> None:
    own = found["accelerometer"]
    ros = export(found, "ros")
    first = float(ros.split("matrix: [")[1].split(",")[0])
    assert first == pytest.approx(own.matrix[0, 0])  # sensor_msgs/Imu has a - g as well
    assert "a - g, the specific force" in export(found, "yaml")
    other = replace(found, sensors={"accelerometer": turned(own)})
    assert float(export(other, "ros").split("matrix: [")[1].split(",")[0]) == pytest.approx(own.matrix[0, 0])
    assert "g - a" in export(other, "c")


def test_turned_round_it_is_the_calibration_of_the_opposite_convention(run: Recording, found: Calibration) -> None:
    down = replace(run, metadata=replace(run.metadata, accelerometer_reads="g-a"))
    expected, own = estimators.calibrate(down)["accelerometer"], turned(found["accelerometer"])
    assert own.reads == expected.reads == "g-a"
    for name in ("matrix", "bias", "values", "covariance", "vector_values", "vector_covariance"):
        value, other = getattr(own, name), getattr(expected, name)
        # The same statistics, solved from the other side: floating point of a fit with condition below 1e3.
        assert value == pytest.approx(other, rel=1e-7, abs=1e-9 * np.abs(other).max()), name
    assert turned(own).axis_vectors == pytest.approx(found["accelerometer"].axis_vectors, abs=0)


def test_a_file_keeps_it(found: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "cal.json"
    found.write(path)
    assert Calibration.read(path)["accelerometer"].reads == "a-g"
    text = found.to_text().replace('"a-g"', '"up"')
    with pytest.raises(RigError, match=r"accelerometer\.reads: found 'up', expected g-a or a-g"):
        Calibration.from_text(text)


def test_the_rig_behind_it_is_the_same(chip: Scenario, run: Recording, found: Calibration) -> None:
    pipeline = fitted_pipeline(found, run)
    assert pipeline.environment.gravity[2] < -9.0
    assert pipeline.accelerometer is not None
    assert chip.rig.accelerometer is not None
    apart = np.degrees(np.arccos(np.sum(pipeline.accelerometer.axes * chip.rig.accelerometer.axes, axis=1)))
    assert apart.max() < 1.0
    text = chip.to_toml()
    assert "beta_deg = [2.0, -1.0, -88.0]" in text
    assert from_toml(text, "chip.toml").rig.accelerometer == chip.rig.accelerometer


def test_parameters_are_in_the_unit_of_the_readings() -> None:
    units = {"accelerometer": "m_s2", "magnetometer": "uT"}
    nothing = Closed(None, None, None)
    volts = {"volts": Estimate(0.1, 0.01, "V"), "at_s": Estimate(5.0, 1.0, "s"), "rate": Estimate(1.0, 0.1, "V/degC")}
    causes = [Cause("bias_step", where, 1.0, (), volts, nothing) for where in ("accel2", "magnetometer", "acquisition")]
    found = [[each.unit for each in cause.parameters.values()] for cause in in_recorded_units(causes, units)]
    assert found == [["m/s^2", "s", "m/s^2/degC"], ["uT", "s", "uT/degC"], ["recorded unit", "s", "recorded unit/degC"]]
    volt = {"accelerometer": "V", "magnetometer": "V"}
    assert in_recorded_units(causes, volt) == tuple(causes)
