"""The calibration contract: every key that is promised, the same numbers after writing and reading, clear refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kinematic_examples import BOTH_NOISES, BOTH_SENSORS, TRUTHS, run_of
from scipy.special import stdtrit

import estimators
from estimators.calibration import FORMAT, Calibration
from estimators.known_angle.model import METHODS, Method
from rig.errors import RigError

SIMULTANEOUS = [
    f"{name}{k}{unit}"
    for k in (1, 2, 3)
    for name, unit in (("sensitivity", ""), ("offset", ""), ("beta", "_deg"), ("gamma", "_deg"))
]


def calibration(method: Method = "simultaneous", noise: Any = None) -> Calibration:
    return estimators.calibrate(run_of(BOTH_SENSORS, BOTH_NOISES, 0), method, noise=noise)


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    return json.loads(calibration().to_text())


def test_every_promised_key_is_there(content: dict[str, Any]) -> None:
    assert content["format"] == FORMAT == "rig-calibration/1"
    assert set(content["sensors"]) == {"accelerometer", "magnetometer"}
    for sensor in content["sensors"].values():
        assert sensor["method"] == "simultaneous"
        assert sensor["reference_magnitude"] in (9.8, 1.0)
        assert len(sensor["axes"]) == 3
        for axis in sensor["axes"]:
            assert {"sensitivity", "offset", "beta_deg", "gamma_deg", "axis"} <= set(axis)
            assert abs(np.linalg.norm(axis["axis"]) - 1.0) < 1e-12
            assert axis["sensitivity"] > 0
            assert -90.0 <= axis["beta_deg"] <= 90.0
            assert 0.0 <= axis["gamma_deg"] < 360.0
        assert set(sensor["angles_between_deg"]) == {"1-2", "1-3", "2-3"}
        assert {"phi_deg", "psi_deg", "vector"} <= set(sensor["field"])
        assert 0.0 <= sensor["field"]["psi_deg"] < 360.0
        assert sensor["field"]["vector"][2] < 0.0
        assert len(sensor["fit_rms"]) == 3
        assert sensor["parameters"] == [*SIMULTANEOUS, "phi_deg", "psi_deg"]
        assert np.array(sensor["covariance"], dtype=float).shape == (14, 14)
        assert set(sensor["identifiable"]) == set(sensor["parameters"])
        assert sensor["samples"] == 6656
        assert {"chi_square", "condition", "coverage", "repeats", "clipped", "outliers", "warnings"} <= set(
            sensor["quality"]
        )
        assert np.shape(sensor["matrix"]) == (3, 3)
        assert np.shape(sensor["bias"]) == (3,)
        assert sensor["bias"] == [axis["offset"] for axis in sensor["axes"]]


def test_the_matrix_undoes_the_sensor(content: dict[str, Any]) -> None:
    for sensor in content["sensors"].values():
        gain = np.array([np.multiply(axis["sensitivity"], axis["axis"]) for axis in sensor["axes"]])
        assert np.abs(np.array(sensor["matrix"]) @ gain - np.eye(3)).max() < 1e-13


def test_what_cannot_be_told_is_null_with_a_reason(content: dict[str, Any]) -> None:
    """Gravity of Table 5 is 0.002 deg from the base z axis: psi has no meaning there; everything of Table 10 has."""
    sensor = content["sensors"]["accelerometer"]
    row = sensor["parameters"].index("psi_deg")
    assert sensor["covariance"][row] == [None] * 14
    assert [line[row] for line in sensor["covariance"]] == [None] * 14
    assert "the field lies 0.0" in sensor["identifiable"]["psi_deg"]
    others = {name: told for name, told in sensor["identifiable"].items() if name != "psi_deg"}
    assert set(others.values()) == {True}
    assert sum(value is None for line in sensor["covariance"] for value in line) == 14 + 13
    assert all(value is not None for value in sensor["field"]["vector_covariance"][0])
    assert set(content["sensors"]["magnetometer"]["identifiable"].values()) == {True}


def test_the_covariance_is_that_of_the_named_parameters(content: dict[str, Any]) -> None:
    """Against the published bound of this sweep (accelerometer 1: 2.4e-5, 1.64e-4, .0134 deg, .165 deg)."""
    sensor = content["sensors"]["accelerometer"]
    found = [np.sqrt(sensor["covariance"][i][i]) for i in range(4)]
    assert np.allclose(found, [2.38e-5, 1.64e-4, 0.0134, 0.165], rtol=0.02)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("noise", [None, BOTH_NOISES.ravel()], ids=["estimated", "given"])
def test_it_round_trips_to_the_last_bit(method: Method, noise: Any, tmp_path: Path) -> None:
    original = calibration(method, noise)
    original.write(tmp_path / "cal.json")
    again = Calibration.read(tmp_path / "cal.json")
    assert again.to_json() == original.to_json()
    for name, sensor in original.sensors.items():
        found = again[name]
        for attribute in (
            "matrix",
            "bias",
            "values",
            "covariance",
            "fit_rms",
            "vector_values",
            "vector_covariance",
            "noise",
        ):
            assert np.array_equal(getattr(found, attribute), getattr(sensor, attribute), equal_nan=True), attribute
        assert found.identifiable == sensor.identifiable
        assert found.quality.to_json() == sensor.quality.to_json()
        assert found.angles_between_deg == sensor.angles_between_deg
        assert (found.noise_degrees_of_freedom is None) == (noise is not None)
        for k in range(3):
            assert np.array_equal(found.axes[k].axis, sensor.axes[k].axis)
    assert str(again) == str(original)


def test_separate_fits_name_each_channels_field() -> None:
    sensor = json.loads(calibration("separate").to_text())["sensors"]["magnetometer"]
    assert sensor["parameters"][:7] == [*SIMULTANEOUS[:4], "phi1_deg", "psi1_deg", "sensitivity2"]
    assert len(sensor["parameters"]) == 18
    for k, axis in enumerate(sensor["axes"]):
        phi = sensor["parameters"].index(f"phi{k + 1}_deg")
        assert axis["field"]["phi_deg"] == sensor["values"][phi]
    assert sensor["quality"]["field_agreement"]["degrees_of_freedom"] == 4
    # Channels that were fitted apart are independent.
    covariance = np.array(sensor["covariance"])
    assert np.abs(covariance[:6, 6:]).max() == 0.0


def test_unknown_keys_are_kept(content: dict[str, Any]) -> None:
    content = json.loads(json.dumps(content))
    content["laboratory"] = {"room": "3"}
    content["sensors"]["accelerometer"]["serial"] = "A-17"
    again = json.loads(Calibration.from_text(json.dumps(content)).to_text())
    assert again["laboratory"] == {"room": "3"}
    assert again["sensors"]["accelerometer"]["serial"] == "A-17"


def test_the_contracts_own_keys_are_enough(content: dict[str, Any]) -> None:
    """A file of another program, with nothing beyond the contract, and one of an attitude-free method."""
    names = [
        "method",
        "reference_magnitude",
        "axes",
        "angles_between_deg",
        "field",
        "fit_rms",
        "parameters",
        "covariance",
        "identifiable",
        "samples",
        "quality",
        "matrix",
        "bias",
    ]
    sensor = {name: content["sensors"]["magnetometer"][name] for name in names}
    read = Calibration.from_text(json.dumps({"format": FORMAT, "sensors": {"magnetometer": sensor}}))["magnetometer"]
    assert read.value("sensitivity1") == sensor["axes"][0]["sensitivity"]
    assert read.value("psi_deg") == sensor["field"]["psi_deg"]
    assert read.std("beta1_deg") == np.sqrt(sensor["covariance"][2][2])
    free = {name: sensor[name] for name in ("reference_magnitude", "matrix", "bias", "fit_rms", "samples")}
    free |= {"method": "ellipsoid", "parameters": ["bias1"], "covariance": [[1e-6]], "identifiable": {"bias1": True}}
    read = Calibration.from_text(json.dumps({"format": FORMAT, "sensors": {"magnetometer": free}}))["magnetometer"]
    assert read.axes == ()
    assert read.field_direction is None
    assert read.std("bias1") == 1e-3


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ((), [], r"cal.json: found \[\], expected an object"),
        (("format",), "rig-calibration/2", "format: found 'rig-calibration/2', expected 'rig-calibration/1'"),
        (("sensors",), {}, "found no sensor, expected accelerometer or magnetometer"),
        (("sensors",), {"gyroscope": {}}, "unknown sensor 'gyroscope'"),
        (("sensors", "accelerometer"), 3, "sensors.accelerometer: found 3, expected an object"),
        (("sensors", "accelerometer", "method"), None, "method: found None, expected a text"),
        (("sensors", "accelerometer", "samples"), -1, "samples: found -1, expected a whole number"),
        (("sensors", "accelerometer", "samples"), 2.5, "samples: found 2.5, expected a whole number"),
        (("sensors", "accelerometer", "bias"), [1, 2], r"bias: found \[1, 2\], expected a list of 3"),
        (("sensors", "accelerometer", "bias", 1), "x", r"bias\[1\]: found 'x', expected a finite number"),
        (("sensors", "accelerometer", "bias", 1), True, r"bias\[1\]: found True, expected a finite number"),
        (("sensors", "accelerometer", "matrix", 0), [1.0], r"matrix\[0\]: found \[1.0\], expected a list of 3"),
        (("sensors", "accelerometer", "covariance"), [[1.0]], "covariance: found .*, expected a list of 14"),
        (("sensors", "accelerometer", "covariance", 0, 0), None, "covariance: is no covariance, expected variances"),
        (("sensors", "accelerometer", "covariance", 0, 1), None, "covariance: is no covariance"),
        (("sensors", "accelerometer", "covariance", 3, 3), -1e-9, "covariance: is no covariance"),
        (("sensors", "accelerometer", "vector_covariance", 0, 1), 1e308, "vector_covariance: is no covariance"),
        (("sensors", "accelerometer", "axes", 2, "axis"), None, r"axes\[2\].axis: found None, expected a list of 3"),
        (
            ("sensors", "accelerometer", "identifiable", "psi_deg"),
            False,
            "psi_deg: found False, expected true or the reason",
        ),
        (
            ("sensors", "accelerometer", "quality", "warnings"),
            "all good",
            "warnings: found 'all good', expected a list",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place(
    content: dict[str, Any], path: tuple[str | int, ...], value: Any, message: str
) -> None:
    spoilt = json.loads(json.dumps(content))
    if path:
        inside = spoilt
        for key in path[:-1]:
            inside = inside[key]
        inside[path[-1]] = value
    else:
        spoilt = value
    with pytest.raises(RigError, match=message):
        Calibration.from_text(json.dumps(spoilt), "cal.json")


def test_a_file_of_before_there_was_a_fields_unit_says_none_of_a_magnetic_one(content: dict[str, Any]) -> None:
    old = json.loads(json.dumps(content))
    for sensor in old["sensors"].values():
        sensor.pop("field_unit", None)
    found = Calibration.from_text(json.dumps(old))
    assert [found[name].field_unit for name in ("accelerometer", "magnetometer")] == ["m_s2", None]
    assert found.with_field_unit("nT")["magnetometer"].field_unit == "nT"
    assert found.with_field_unit("nT").with_field_unit("G")["magnetometer"].field_unit == "nT", "its own word counts"
    assert Calibration.from_text(found.with_field_unit("nT").to_text())["magnetometer"].field_unit == "nT"
    for name, unit in (("magnetometer", "m_s2"), ("accelerometer", "G"), ("magnetometer", "T")):
        old["sensors"][name]["field_unit"] = unit
        with pytest.raises(RigError, match=f"sensors.{name}.field_unit: unknown unit '{unit}'"):
            Calibration.from_text(json.dumps(old))
        del old["sensors"][name]["field_unit"]


def test_missing_keys_and_files_are_named(content: dict[str, Any], tmp_path: Path) -> None:
    spoilt = json.loads(json.dumps(content))
    spoilt["sensors"]["accelerometer"]["matrx"] = spoilt["sensors"]["accelerometer"].pop("matrix")
    with pytest.raises(RigError, match=r"sensors.accelerometer: no 'matrix' \(nearest: 'matrx'\)"):
        Calibration.from_text(json.dumps(spoilt))
    for text in ("", "{", "not json", '{"format": NaN}', "\udcff".encode("utf-8", "surrogateescape")):
        with pytest.raises(RigError, match=r"not (JSON|UTF-8 text)"):
            Calibration.from_text(text)
    with pytest.raises(RigError, match="no such file"):
        Calibration.read(tmp_path / "none.json")
    with pytest.raises(RigError, match="unknown calibrated sensor 'gyro'"):
        calibration()["gyro"]
    with pytest.raises(RigError, match=r"unknown parameter 'beta1'.*nearest: 'beta1_deg'"):
        calibration()["magnetometer"].value("beta1")


def test_intervals_use_students_t_where_the_noise_was_estimated() -> None:
    run = run_of({"magnetometer": TRUTHS["table10"][0]}, BOTH_NOISES[1], 1).select(slice(None, None, 333))
    estimated = estimators.calibrate(run)["magnetometer"]
    assert estimated.samples == 20
    low, high = estimated.interval("offset1")
    freedom = estimated.noise_degrees_of_freedom
    assert freedom is not None
    expected = stdtrit(freedom.min(), 0.975) * estimated.std("offset1")
    assert np.isclose((high - low) / 2.0, expected, rtol=1e-9)
    given = estimators.calibrate(run, noise={"magnetometer": BOTH_NOISES[1]})["magnetometer"]
    low, high = given.interval("offset1", 0.6826894921370859)
    assert np.isclose((high - low) / 2.0, given.std("offset1"), rtol=1e-9)
