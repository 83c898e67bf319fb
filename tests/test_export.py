"""Exports apply a calibration elsewhere and give the same numbers, to the last bit of every constant."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_support import SMALL, Rig
from diagnosed_recordings import recorded

import scenarios
from estimators import Calibration, calibrate
from estimators.calibration.export import FORMULA, contents, export
from estimators.calibration.fields import apply, field_of
from estimators.calibration.parts import Quality
from rig.errors import RigError
from rig.number_text import number

#: A float as YAML 1.1 and 1.2 resolve it (yaml.org/type/float.html; YAML 1.2.2, section 10.3.2): with a point, and a
#: sign in the exponent.
YAML_FLOAT = re.compile(r"[-+]?[0-9]+\.[0-9]*(e[-+][0-9]+)?")


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    path = tmp_path_factory.mktemp("export") / "small.toml"
    path.write_text(SMALL)
    return calibrate(scenarios.load(path).simulate(seed=0))


def nasty(calibration: Calibration) -> Calibration:
    """With a name, a warning and numbers that ask for quoting."""
    sensor = calibration["accelerometer"]
    bias = np.array([1e-7, -1e22, 3.0])
    quality = replace(sensor.quality, warnings=('a "quote", */ and ??/ end\nµ',))
    changed = replace(sensor, bias=bias, quality=quality)
    return replace(calibration, recording='run "1": #2 */', sensors={"accelerometer": changed})


def expected(calibration: Calibration, sensor: str) -> tuple[np.ndarray, np.ndarray]:
    return calibration[sensor].matrix, calibration[sensor].bias


def test_json_holds_the_same_bits(calibration: Calibration) -> None:
    found = json.loads(export(calibration, "json"))
    assert found == contents(calibration)
    assert found["format"] == "rig-export/1"
    assert found["formula"] == FORMULA
    for sensor in calibration.sensors:
        matrix, bias = expected(calibration, sensor)
        assert np.array(found["sensors"][sensor]["matrix"]).tobytes() == matrix.tobytes()
        assert np.array(found["sensors"][sensor]["bias"]).tobytes() == bias.tobytes()
        assert found["sensors"][sensor]["bias_std"][0] == calibration[sensor].std("offset1")


def test_the_formula_is_that_of_apply(calibration: Calibration) -> None:
    readings = np.random.default_rng(0).normal(2.5, 1.0, (20, 3))
    sensor = json.loads(export(calibration, "json"))["sensors"]["magnetometer"]
    field = (readings - np.array(sensor["bias"])) @ np.array(sensor["matrix"]).T
    assert np.array_equal(field, field_of(calibration["magnetometer"], readings))


@pytest.mark.parametrize("nastily", [False, True])
def test_yaml_holds_the_same_bits(calibration: Calibration, nastily: bool) -> None:
    used = nasty(calibration) if nastily else calibration
    text = export(used, "yaml", "G")
    assert text.startswith(f"# {FORMULA}\n")
    assert read_yaml(text) == contents(used, "G")


def test_yaml_is_what_a_library_reads(calibration: Calibration) -> None:
    for used in (calibration, nasty(calibration)):
        assert yaml.safe_load(export(used, "yaml")) == contents(used)


def read_yaml(text: str) -> object:
    """The little of YAML that exports are written in; anything else fails.

    Block mappings of plain keys, a block sequence of flow sequences, and scalars on one line that are JSON and, if
    floats, also of the form that YAML takes for a float.
    """
    top: dict[str, object] = {}
    stack: list[tuple[int, dict[str, object]]] = [(0, top)]
    rows: list[object] = []
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        indent = len(line) - len(line.lstrip(" "))
        body = line.strip()
        if body.startswith("- "):
            rows.append(read_flow(body[2:]))
            continue
        key, rest = re.fullmatch(r"([a-z_0-9]+):(.*)", body).groups()  # type: ignore[union-attr]
        while stack[-1][0] > indent:
            stack.pop()
        assert stack[-1][0] == indent
        if rest:
            assert rest[0] == " "
            stack[-1][1][key] = read_flow(rest[1:])
        elif key == "matrix":
            rows = []
            stack[-1][1][key] = rows
        else:
            inner: dict[str, object] = {}
            stack[-1][1][key] = inner
            stack.append((indent + 2, inner))
    return top


def read_flow(text: str) -> object:
    for token in re.findall(r"(?<![\w\"])[-+]?[0-9][^,\] ]*", re.sub(r'"(\\.|[^"\\])*"', '""', text)):
        assert re.fullmatch(r"[0-9]+", token) or YAML_FLOAT.fullmatch(token), token
    return json.loads(text)


def test_floats_have_all_their_digits_and_a_point() -> None:
    for value in (0.1, 1e-5, -1e16, 1e22, 5.0, 0.0, 5e-324, 1.7976931348623157e308, 2.0 / 3.0):
        text = number(value)
        assert YAML_FLOAT.fullmatch(text), text
        assert float(text) == value


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.parametrize(
    "options", [["-std=c99"], ["-std=c11", "-O2"], ["-x", "c++", "-std=c++11"]], ids=["c99", "c11", "c++"]
)
def test_the_header_compiles_without_a_warning_and_computes_the_same(
    calibration: Calibration, tmp_path: Path, options: list[str]
) -> None:
    """Sums of three products in another order, or fused, differ by some units in the last place of their largest."""
    readings = np.random.default_rng(1).normal(2.5, 1.0, (50, 3))
    (tmp_path / "calibration.h").write_text(export(calibration, "c"))
    (tmp_path / "main.c").write_text(
        """
        #include <stdio.h>
        #include "calibration.h"
        #include "calibration.h"
        int main(void)
        {
            double reading[3], field[3];
            while (scanf("%lf %lf %lf", &reading[0], &reading[1], &reading[2]) == 3) {
                rig_accelerometer_field(reading, field);
                printf("%.17g %.17g %.17g ", field[0], field[1], field[2]);
                rig_magnetometer_field(reading, field);
                printf("%.17g %.17g %.17g\\n", field[0], field[1], field[2]);
            }
            return 0;
        }
        """
    )
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run(["gcc", *strict, *options, "main.c", "-o", "apply"], cwd=tmp_path, check=True, capture_output=True)
    typed = "\n".join(" ".join(repr(float(value)) for value in row) for row in readings)
    done = subprocess.run([str(tmp_path / "apply")], input=typed, capture_output=True, text=True, check=True)
    found = np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])
    for columns, sensor in ((slice(0, 3), "accelerometer"), (slice(3, 6), "magnetometer")):
        matrix, bias = expected(calibration, sensor)
        largest = np.abs(readings - bias) @ np.abs(matrix).T
        difference = np.abs(found[:, columns] - field_of(calibration[sensor], readings))
        assert (difference <= 4.0 * np.finfo(float).eps * largest).all()


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_no_name_or_warning_breaks_the_header(calibration: Calibration, tmp_path: Path) -> None:
    (tmp_path / "nasty.h").write_text(export(nasty(calibration), "c"))
    (tmp_path / "main.c").write_text('#include "nasty.h"\nint main(void) { return 0; }\n')
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wtrigraphs", "-Werror"]
    subprocess.run(["gcc", *strict, "main.c", "-o", "nasty"], cwd=tmp_path, check=True, capture_output=True)
    assert "-1.0e+22" in (tmp_path / "nasty.h").read_text()


def test_what_cannot_be_applied_is_refused(calibration: Calibration) -> None:
    with pytest.raises(RigError, match="nearest: 'yaml'"):
        export(calibration, "yml")
    flat = replace(calibration["accelerometer"], matrix=np.full((3, 3), np.nan))
    with pytest.raises(RigError, match="accelerometer: its axes do not span space"):
        export(replace(calibration, sensors={"accelerometer": flat}), "c")


def test_without_attitude_the_frame_is_the_sensors_own(calibration: Calibration) -> None:
    sensor = replace(
        calibration["magnetometer"], axes=(), parameters=(), vector_parameters=(), noise=None, quality=Quality()
    )
    found = contents(replace(calibration, sensors={"magnetometer": sensor}), "G")["sensors"]["magnetometer"]
    assert "sensor's own frame" in found["field"]
    assert found["field_unit"] == "G"
    assert found["bias_std"] == [None, None, None]
    assert found["noise"] is None


def test_rig_export_writes_and_prints(rig: Rig, calibration: Calibration, tmp_path: Path) -> None:
    calibration.write(tmp_path / "cal.json")
    read = Calibration.read(tmp_path / "cal.json")
    for target, ending in (("yaml", "yml"), ("json", "json"), ("c", "h")):
        text = rig.done("export", tmp_path / "cal.json", "--to", target)
        assert text == export(read, target)
        output = tmp_path / f"out.{ending}"
        assert "written" in rig.done("export", tmp_path / "cal.json", "--to", target, "-o", output)
        assert output.read_text() == text
    said = json.loads(rig.done("export", tmp_path / "cal.json", "--to", "yaml", "--field-unit", "G", "--json"))
    assert said == {"to": "yaml", "file": None, "text": export(read, "yaml", "G")}
    assert "expected .h" in rig.refused("export", tmp_path / "cal.json", "--to", "c", "-o", tmp_path / "x.c")
    assert "nearest: 'yaml'" in rig.refused("export", tmp_path / "cal.json", "--to", "yml")


def test_ros_has_the_specific_force_and_tesla(calibration: Calibration) -> None:
    found = yaml.safe_load(export(calibration, "ros", "G"))["accelerometer"]
    readings = np.random.default_rng(2).uniform(1.0, 4.0, (5, 3))
    matrix = np.reshape(found["matrix"], (3, 3))
    felt = field_of(calibration["accelerometer"], readings)
    np.testing.assert_allclose((readings - found["bias"]) @ matrix.T, -felt, rtol=1e-12)
    covariance = np.reshape(found["linear_acceleration_covariance"], (3, 3))
    noise = np.asarray(calibration["accelerometer"].noise)
    drawn = np.random.default_rng(0).standard_normal((20_000, 3)) * noise @ matrix.T
    # a sample covariance of n draws is off by about sqrt(2 / n): six of these
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=6 * np.sqrt(2 / 20_000) * covariance.max())
    assert found["orientation_covariance"][0] == -1.0


def test_a_unit_from_elsewhere_stays_in_its_comment(calibration: Calibration) -> None:
    """Made in Python it may be anything; of a file, one that recordings have."""
    sensors = {"accelerometer": replace(calibration["accelerometer"], unit="V] */ int evil; /*\x1b")}
    found = replace(calibration, sensors=sensors)
    code = re.sub(r"/\*.*?\*/", "", export(found, "c"), flags=re.DOTALL)
    assert "evil" not in code
    assert export(found, "c").isascii()
    with pytest.raises(RigError, match=r"accelerometer.unit: unknown unit 'V\] "):
        Calibration.from_text(found.to_text())


@pytest.mark.parametrize(("unit", "tesla"), [("G", 1e-4), ("uT", 1e-6), ("nT", 1e-9)])
def test_ros_is_in_tesla_whatever_unit_the_calibration_is_in(calibration: Calibration, unit: str, tesla: float) -> None:
    """By the calibration's own word, or by the option's where it says nothing: the same file."""
    magnetic = replace(calibration["magnetometer"], field_unit=unit)
    said = replace(calibration, sensors={"magnetometer": magnetic})
    unsaid = replace(calibration, sensors={"magnetometer": replace(magnetic, field_unit=None)})
    text = export(said, "ros")
    assert text == export(said, "ros", unit) == export(unsaid, "ros", unit)
    found = yaml.safe_load(text)["magnetometer"]
    assert found["unit"] == "T"
    readings = np.random.default_rng(3).uniform(1.0, 4.0, (5, 3))
    felt = tesla * field_of(magnetic, readings)
    np.testing.assert_allclose((readings - found["bias"]) @ np.reshape(found["matrix"], (3, 3)).T, felt, rtol=1e-12)


def test_an_export_says_the_unit_that_the_calibration_says(rig: Rig, here: Path) -> None:
    """Of the recording, through the file; without one what it is relative to."""
    scenario = replace(scenarios.load("small.toml"), magnetic_field_unit="uT")
    calibrate(scenario.simulate(seed=0)).write("cal.json")
    for target in ("yaml", "json"):
        found = yaml.safe_load(rig.done("export", "cal.json", "--to", target))
        assert found["sensors"]["magnetometer"]["field_unit"] == "uT"
    assert "the magnetic field, in the tool frame [uT]" in rig.done("export", "cal.json", "--to", "c")
    refused = rig.refused("export", "cal.json", "--to", "ros", "--field-unit", "G")
    assert "field_unit: found G, expected uT, which the calibration says its field is in" in refused
    document = json.loads(Path("cal.json").read_text())
    del document["sensors"]["magnetometer"]["field_unit"]
    Path("old.json").write_text(json.dumps(document))
    size = document["sensors"]["magnetometer"]["reference_magnitude"]
    relative = yaml.safe_load(rig.done("export", "old.json", "--to", "ros"))["magnetometer"]
    assert relative["unit"] == f"not stated, one in which the field's magnitude is {number(size)}"
    assert "[that of reference_magnitude]" in rig.done("export", "old.json", "--to", "c")


def test_fields_are_in_the_unit_that_their_recording_states(calibration: Calibration) -> None:
    run = recorded()[0]
    run = replace(run, metadata=replace(run.metadata, magnetic_field_unit="uT"))
    magnetic = replace(calibration["magnetometer"], field_unit="G")
    found = apply(replace(calibration, sensors={"magnetometer": magnetic}), run)
    assert found.units == {"magnetometer": "uT"}
    expected = 100.0 * field_of(magnetic, run.readings("magnetometer"))
    np.testing.assert_allclose(found.readings("magnetometer"), expected, rtol=1e-12)
