"""``rig calibrate``: what it prints and writes, its options, and its verdict."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from matplotlib.image import imread

import scenarios
from estimators import Calibration, noise_floor
from rig.recording import read_recording

ROOT = Path(__file__).parents[1]


def test_calibrate_prints_a_table_and_writes_the_contract(rig: Rig, swept: Path) -> None:
    text = rig.done("calibrate", "run.parquet", "-o", "cal.json")
    for words in (
        "accelerometer",
        "magnetometer",
        "V/(m/s²)",
        "V/G",
        "±",
        "root sum of squares",
        "chi-square",
        "angles of axes",
    ):
        assert words in text
    calibration = Calibration.read("cal.json")
    assert json.loads(rig.done("calibrate", "run.parquet", "--json")) == json.loads((swept / "cal.json").read_text())
    truth = scenarios.load("small.toml").truth
    for sensor in truth.sensors:
        assert calibration[sensor].noise_source == "locked recording"
        # A normal error passes 6 standard deviations once in 5e8; the seed is the scenario's own.
        assert abs(calibration[sensor].value("offset1") - truth.values(sensor)["offset1"]) < 6 * calibration[
            sensor
        ].std("offset1")


def test_calibrate_says_whether_it_is_good(rig: Rig, swept: Path) -> None:
    """One in a thousand good calibrations is called not good; the seed is the scenario's own."""
    text = rig.done("calibrate", "run.parquet", "-o", "cal.json")
    assert text.count("verdict         good: residuals over noise floor") == 2
    assert "rig diagnose" not in text
    verdict = Calibration.read("cal.json")["magnetometer"].quality.verdict
    assert verdict is not None
    assert verdict["good"] is True
    run = read_recording("run.parquet")
    assert run.accelerometer is not None
    replace(run, accelerometer=np.minimum(run.accelerometer, 3.0)).write("clipped.parquet")
    text = rig.not_good("calibrate", "clipped.parquet", "-o", "cal.json")
    assert "verdict         not good: because " in text
    assert "What is wrong: rig diagnose clipped.parquet looks for the cause." in " ".join(text.split())
    assert text.count("readings are clipped") == 1
    verdict = Calibration.read("cal.json")["accelerometer"].quality.verdict
    assert verdict is not None
    assert verdict["good"] is False
    assert any(reason.startswith("readings are clipped") for reason in verdict["reasons"])


@pytest.mark.parametrize(
    ("unit", "option", "words"),
    [
        ("G", "0.55uT", "--field: 0.55 uT is 0.01 times the 0.55 G that stated.parquet states: its unit?"),
        ("G", "55uT", ""),
        ("G", "0.3G", ""),
        ("uT", "0.55G", "--field: 0.55 G is 100 times the 0.55 uT that stated.parquet states: its unit?"),
        (None, "55", "--field: 55 is 100 times the 0.55 that stated.parquet states: its unit?"),
        (None, "55uT", ""),
    ],
)
def test_a_field_that_contradicts_the_recording_is_said(
    rig: Rig, swept: Path, unit: str | None, option: str, words: str
) -> None:
    run = read_recording("run.parquet")
    own = replace(run.metadata, magnetic_field=0.55, magnetic_field_unit=unit, assumed=())
    replace(run, metadata=own).write("stated.parquet")
    found = rig("calibrate", "stated.parquet", "--field", option)
    assert found.err == (f"rig: {words}\n" if words else "")


def test_a_gravity_that_contradicts_the_recording_is_said(rig: Rig, swept: Path) -> None:
    assert (
        "--gravity: 1 m/s^2 is 0.102 times the 9.8 m/s^2 that run.parquet states"
        in rig("calibrate", "run.parquet", "--gravity", "1").err
    )


@pytest.mark.parametrize(("factor", "words"), [(1.0, "accel1 equals accel2"), (-0.5, "accel1 is -2 times accel2")])
def test_a_copied_axis_is_never_good(rig: Rig, swept: Path, factor: float, words: str) -> None:
    run = read_recording("run.parquet")
    volts = np.array(run.accelerometer)
    volts[:, 1] = factor * volts[:, 0]
    replace(run, accelerometer=volts).write("copied.parquet")
    (swept / "run.locked.parquet").unlink()
    assert f"{words}: one of them is a copy" in rig.not_good("calibrate", "copied.parquet")


def test_calibrate_does_without_the_attitude_where_there_is_none(rig: Rig, swept: Path) -> None:
    replace(read_recording("run.parquet"), q=None).write("tumble.parquet")
    text = rig.done("calibrate", "tumble.parquet", "-o", "cal.json")
    assert text.startswith("tumble.parquet: has no pose: calibrated by the magnitude of the fields")
    for words in ("S [V/G]", "±", "angles of axes  1-2", "both in one frame", "cannot be told: how", "verdict"):
        assert words in text
    assert Calibration.read("cal.json")["magnetometer"].method.startswith("ellipsoid")
    insisted = rig.done("calibrate", "tumble.parquet", "--method", "ellipsoid", "--json")
    assert json.loads(insisted) == json.loads((swept / "cal.json").read_text())
    six = json.loads(rig.not_good("calibrate", "run.parquet", "--method", "ellipsoid", "--parameters", "6", "--json"))
    assert len(six["sensors"]["magnetometer"]["parameters"]) == 6


def test_the_noise_of_the_helps_example_is_that_of_two_sensors(rig: Rig, swept: Path) -> None:
    """As its neighbours' run has."""
    (example,) = re.findall(r"rig (calibrate run.csv --noise .*)", rig.done("calibrate", "--help"))
    read_recording("run.parquet").write("run.csv")
    assert "noise as given" in rig(*example.split()).out


def test_calibrate_leaves_out_outliers_where_it_is_asked_to(rig: Rig, swept: Path) -> None:
    """Ten readings a volt off, 70 times the noise: what is left is the calibration without them."""
    run = read_recording("run.parquet")
    odd = np.arange(7, 600, 60)
    volts = np.array(run.accelerometer)
    volts[odd, 1] += 1.0
    replace(run, accelerometer=volts).write("odd.parquet")
    (swept / "run.locked.parquet").rename("odd.locked.parquet")
    assert "10 readings are outliers" in rig.not_good("calibrate", "odd.parquet")
    text = rig.done("calibrate", "odd.parquet", "--robust", "-o", "cal.json", "--coverage", "seen.png")
    assert "10 of 600 samples were left out as outliers" in text
    assert "10 samples were left out" in text
    assert "not good" not in text
    assert imread("seen.png").std() > 0.01
    run.select(np.setdiff1d(np.arange(600), odd)).write("rest.parquet")
    rest = json.loads(rig.done("calibrate", "rest.parquet", "--locked", "odd.locked.parquet", "--json"))["sensors"]
    found = Calibration.read("cal.json")["accelerometer"]
    assert found.noise_source == "locked recording"
    assert found.values == pytest.approx(rest["accelerometer"]["values"], rel=1e-12)


def test_calibrate_says_what_cannot_be_told_and_why(rig: Rig, swept: Path) -> None:
    rig.done("sweep", "renk2005-table2", "-o", "table2.parquet")
    text = rig.done("calibrate", "table2.parquet")
    assert "cannot be told: ψ: the field lies" in text
    assert "noise from the residuals" in text


def test_calibrate_takes_the_noise_floor_from_where_it_is_told(rig: Rig, swept: Path) -> None:
    def noise(*options: str) -> list[float]:
        found = json.loads(rig("calibrate", "run.parquet", "--json", *options).out)["sensors"]
        return [value for sensor in ("accelerometer", "magnetometer") for value in found[sensor]["noise"]]

    assert noise("--noise", "1,2,3,4,5,6") == pytest.approx([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3], rel=1e-14)
    beside = noise()
    (swept / "run.locked.parquet").rename(swept / "elsewhere.parquet")
    assert noise("--locked", "elsewhere.parquet") == beside
    assert beside == pytest.approx(noise_floor(read_recording("elsewhere.parquet")).rms, rel=1e-14)
    assert noise() != beside  # from the residuals


def test_calibrate_options_reach_the_estimator(rig: Rig, swept: Path) -> None:
    separate = json.loads(rig.done("calibrate", "run.parquet", "--method", "separate", "--json"))
    assert separate["sensors"]["magnetometer"]["method"] == "separate"
    assert "one field?" in rig.done("calibrate", "run.parquet", "--method", "separate")
    up = json.loads(rig.done("calibrate", "run.parquet", "--field-points", "up", "--json"))
    assert up["sensors"]["accelerometer"]["field"]["vector"][2] > 0.9
    equal = json.loads(rig.done("calibrate", "run.parquet", "--equal-weights", "--json"))
    assert equal["sensors"]["accelerometer"]["weighting"] == "equal"


def test_calibrate_takes_the_users_own_arm(rig: Rig, swept: Path) -> None:
    urdf = ROOT / "models" / "a465" / "a465.urdf"
    one = json.loads(rig.done("calibrate", "run.parquet", "--json"))["sensors"]["accelerometer"]
    two = json.loads(rig.done("calibrate", "run.parquet", "--arm", urdf, "--tip", "imu", "--json"))["sensors"][
        "accelerometer"
    ]
    assert two["values"] == pytest.approx(one["values"], abs=1e-9)  # the same arm to 1e-12, through a fit


def test_the_search_of_renk_is_beside_the_calibration(rig: Rig, swept: Path) -> None:
    """It weighs all channels alike, the calibration by their noise: they differ by less than one standard deviation."""
    text = rig.done("calibrate", "run.parquet", "--fminunc", "-o", "cal.json")
    assert "as Renk et al. (quasi-Newton)" in text
    ends = json.loads(Path("cal.json").read_text())["fminunc"]
    assert set(ends) == {"accelerometer", "magnetometer"}
    assert all(abs(end["sigmas"]) < 1.0 for end in ends.values()), ends


def test_of_several_recordings_only_the_samples_at_rest_count(rig: Rig, here: Path) -> None:
    """Twelve poses of a second with four seconds between them, at ten samples a second: a fifth of all, or fewer."""
    poses = 'kind = "static-poses"\ncount = 12\nhold_s = 1.0\nmove_s = 4.0\nrate_Hz = 100.0'
    Path("poses.toml").write_text(SMALL.replace('kind = "torus-sweep"\nduration_s = 60.0', poses))
    for seed in ("1", "2"):
        rig.done("sweep", "poses.toml", "-o", f"{seed}.parquet", "--seed", seed)
    rig.done("calibrate", "1.parquet", "2.parquet", "--still", "-o", "cal.json")
    recorded = sum(len(read_recording(f"{seed}.parquet")) for seed in (1, 2))
    assert 0 < Calibration.read("cal.json")["accelerometer"].samples < 0.25 * recorded
