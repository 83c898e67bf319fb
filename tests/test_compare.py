"""``rig compare``: calibrations, the truth, a recording and its simulation, in standard deviations, and as words."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig
from diagnosed_recordings import backlash, recorded, scenario
from rich.text import Text
from scipy.special import chdtri

import estimators
import scenarios
from estimators import calibrate, noise_floor
from estimators.calibration.turned import turned
from rig.effects import EFFECTS, make_effect
from rig.errors import RigError
from rig.number_text import with_std
from scenarios.comparison import apart, compare, compare_two
from scenarios.terminal.calibration import symbol
from scenarios.terminal.tables import effect_record, plus_minus, shortened, show, table


def test_two_calibrations_of_one_rig_differ_as_their_covariances_say() -> None:
    total, freedom = 0.0, 0
    for seed in range(10):
        pair = []
        for each in (2 * seed, 2 * seed + 1):
            run, locked = recorded(seed=each)
            pair.append(calibrate(run, noise=noise_floor(locked)))
        rows = compare_two(*pair)
        assert [row.parameter for row in rows if row.sensor == "magnetometer"] == list(
            pair[0]["magnetometer"].parameters
        )
        for found in apart(rows, *pair).values():
            total, freedom = total + found.chi_square, freedom + found.degrees_of_freedom
        one = apart(compare(scenario().truth, pair[0]), pair[0])
        assert all(each.degrees_of_freedom >= 12 for each in one.values())
    # floors of 1,400 samples each; false failures once in 10,000
    wide = (1.0 + 3.0 / np.sqrt(2.0 * 1400.0)) ** 2
    assert chdtri(freedom, 1.0 - 5e-5) / wide < total < wide * chdtri(freedom, 5e-5)


def test_how_far_apart_two_calibrations_are_does_not_depend_on_the_side_of_one() -> None:
    """Elevations change their signs together with what they are correlated with; to rounding of the inverse."""
    pair = [calibrate(run, noise=noise_floor(locked)) for run, locked in (recorded(seed=0), recorded(seed=1))]
    other = replace(pair[1], sensors={name: turned(own) for name, own in pair[1].sensors.items()})
    same = apart(compare_two(*pair), *pair)
    for sensor, found in apart(compare_two(pair[0], other), pair[0], other).items():
        assert found.chi_square == pytest.approx(same[sensor].chi_square, rel=1e-6)


def test_the_other_side_of_the_ambiguity_is_the_same_calibration() -> None:
    run, locked = recorded()
    floor = noise_floor(locked)
    rows = compare_two(calibrate(run, noise=floor), calibrate(run, noise=floor, field_points="up"))
    assert max(abs(row.error_sigmas) for row in rows if row.error_sigmas is not None) < 1e-6


def test_a_recording_is_held_against_the_rig_that_made_it(rig: Rig, here: Path) -> None:
    run, _ = recorded(backlash())
    replace(run, t=run.t + 100.0).write("run.parquet")  # its clock does not matter
    Path("fitted.toml").write_text(scenario().with_effects([backlash()]).to_toml())
    found = json.loads(rig.done("compare", "run.parquet", "fitted.toml", "--json", "-o", "apart.png"))
    assert found["alike"]
    assert Path("apart.png").stat().st_size > 10_000
    for row in found["channels"]:
        # RMS of 600 samples, five sigma of 1/sqrt(1200)
        assert abs(row["rms_sigmas"] - 1.0) < 5.0 / np.sqrt(1200.0)
    result = rig("compare", "small.toml", "run.parquet")
    assert result.status == 1
    assert "they differ by more than the noise that the scenario states" in result.out


def test_noise_of_the_scenario_counts(rig: Rig, here: Path) -> None:
    noisy = scenario().with_effects([make_effect("noise_excess", {"where": "mag1", "extra_sigma": 0.05})])
    noisy.simulate(0).write("run.parquet")
    Path("noisy.toml").write_text(noisy.to_toml())
    assert json.loads(rig.done("compare", "run.parquet", "noisy.toml", "--json"))["alike"]
    assert rig("compare", "run.parquet", "small.toml").status == 1


def test_a_calibration_that_the_gap_has_spoilt_is_not_the_truth(rig: Rig, here: Path) -> None:
    for effects, name in (((), "good"), ((backlash(),), "bad")):
        run, locked = recorded(*effects)
        calibrate(run, noise=noise_floor(locked)).write(f"{name}.json")
    assert json.loads(rig.done("compare", "good.json", "small.toml", "--json"))["alike"]
    result = rig("compare", "bad.json", "small.toml", "-o", "bad.png")
    assert result.status == 1
    assert "they differ" in result.out
    assert Path("bad.png").exists()
    assert rig("compare", "good.json", "bad.json").status == 1


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ("run.parquet", "run.parquet", "found a recording and a recording, expected two calibrations"),
        ("small.toml", "small.toml", "found a scenario and a scenario"),
        ("cal.json", "run.parquet", "found a calibration and a recording"),
        ("cal.json", "other.json", "accelerometer.unit: found V and mV, expected the same"),
        ("run.parquet", "renk2005-accelerometer", "has no magnetometer, expected the sensors of run.parquet"),
        ("run.parquet", "camps2009-accelerometer", "found no arm, expected 6 joints, as run.parquet has"),
        ("missing.json", "small.toml", "missing.json: no such file"),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_line(rig: Rig, here: Path, first: str, second: str, words: str) -> None:
    run, _ = recorded()
    run.write("run.parquet")
    found = calibrate(run)
    found.write("cal.json")
    other = replace(found, sensors={name: replace(each, unit="mV") for name, each in found.sensors.items()})
    other.write("other.json")
    result = rig("compare", first, second)
    assert result.status == 2
    assert words in result.err
    assert result.err.count("\n") == 1


# Without an attitude (camps) or with effects the calibration does not model (renk2005-gap) there is no truth to meet.
MODELLED = [name for name in scenarios.names() if not name.startswith("camps") and not scenarios.load(name).rig.effects]


@pytest.mark.parametrize("name", MODELLED)
def test_three_lines_of_python_recover_the_truth(name: str) -> None:
    scenario = scenarios.load(name)
    calibration = estimators.calibrate(scenario.simulate(seed=0))
    rows = compare(scenario.truth, calibration)
    errors = np.array([row.error_sigmas for row in rows if row.error_sigmas is not None])
    assert len(rows) == 14 * len(scenario.truth.sensors)
    # The seed is fixed; of other seeds one in 60,000 would have one of 28 normal errors beyond 5 standard deviations.
    assert np.abs(errors).max() < 5.0
    untold = {row.parameter for row in rows if row.error_sigmas is None}
    assert all(row.why for row in rows if row.sigma is None)
    if name == "ann-arbor":
        assert not untold
    elif "magnetometer" not in name:
        assert "psi_deg" in untold, "gravity lies along joint 1"


@pytest.mark.parametrize("points", ["down", "up"])
@pytest.mark.parametrize("method", ["simultaneous", "separate"])
def test_the_truth_is_turned_to_the_calibrations_side(points: str, method: str) -> None:
    scenario = scenarios.load("renk2005-magnetometer").scaled_noise(1e-3)
    calibration = estimators.calibrate(scenario.simulate(seed=0), method=method, field_points=points)  # type: ignore[arg-type]
    rows = compare(scenario.truth, calibration)
    assert len(rows) == (14 if method == "simultaneous" else 18)
    # Without the turn errors would be 10,000 standard deviations; what the converter rounds is told by the residuals.
    assert max(abs(row.error_sigmas) for row in rows if row.error_sigmas is not None) < 6.0
    phi = next(row for row in rows if row.parameter.startswith("phi"))
    assert phi.truth == pytest.approx(59.4127 if points == "down" else -59.4127, abs=1e-9)


def test_angles_differ_by_the_shorter_way_round() -> None:
    scenario = scenarios.load("renk2005-table2")
    calibration = estimators.calibrate(scenario.simulate(seed=0))
    found = calibration["accelerometer"]
    values = np.array(found.values)
    values[found.parameters.index("gamma3_deg")] = 0.5  # the truth is 358
    turned = replace(calibration, sensors={"accelerometer": replace(found, values=values)})
    row = next(row for row in compare(scenario.truth, turned) if row.parameter == "gamma3_deg")
    assert row.error_sigmas == pytest.approx(2.5 / found.std("gamma3_deg"), rel=1e-9)


def test_units_follow_the_recording() -> None:
    scenario = scenarios.load("ann-arbor")
    calibration = estimators.calibrate(scenario.simulate(seed=0))
    names = ("sensitivity1", "offset2", "phi_deg", "axis1_x")
    magnetic = calibration["magnetometer"]
    assert [magnetic.unit_of(name) for name in names] == ["V/G", "V", "deg", ""]
    assert [calibration["accelerometer"].unit_of(name) for name in names] == ["V/(m/s²)", "V", "deg", ""]
    assert replace(magnetic, field_unit=None).unit_of("sensitivity1") == "V/field"
    assert "V/G" in str(calibration)
    for rows in (compare(scenario.truth, calibration), compare_two(calibration, calibration)):
        assert [row.unit for row in rows if row.parameter == "sensitivity1"] == ["V/(m/s²)", "V/G"]


def test_a_calibration_without_its_fields_unit_is_compared_as_that_of_the_other() -> None:
    """As of an earlier version's file; one that says another unit is not the same field."""
    scenario = scenarios.load("ann-arbor")
    calibration = estimators.calibrate(scenario.simulate(seed=0))
    magnetic = calibration["magnetometer"]
    old, other = (
        replace(calibration, sensors={"magnetometer": replace(magnetic, field_unit=unit)}) for unit in (None, "uT")
    )
    for rows in (compare(scenario.truth, old), compare_two(old, calibration), compare_two(calibration, old)):
        assert rows[0].unit == "V/G"
    with pytest.raises(RigError, match=r"^magnetometer.field_unit: found uT and G, expected the same$"):
        compare(scenario.truth, other)
    with pytest.raises(RigError, match=r"^magnetometer.field_unit: found G and uT, expected the same$"):
        compare_two(calibration, other)


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [
        (2.37551, 0.000164, ("2.37551", "0.00016")),
        (85.30889, 0.0134, ("85.309", "0.013")),
        (235.0, 17.3, ("235", "17")),
        (-1.0, 0.0996, ("-1.000", "0.100")),
        (1.0, None, ("1", "–")),
        (1.5, math.nan, ("1.5", "–")),
        (1.5, 0.0, ("1.5", "–")),
    ],
)
def test_numbers_end_where_their_uncertainty_does(value: float, sigma: float | None, expected: tuple[str, str]) -> None:
    assert with_std(value, sigma) == expected
    assert plus_minus(value, sigma) == (f"({value:.4g})" if expected[1] == "–" else " ± ".join(expected))


def test_names_are_written_short() -> None:
    assert shortened(["joint1", "joint2", "joint3", "joint5", "base"]) == "joint1-3, joint5, base"
    assert [symbol(name) for name in ("sensitivity1", "beta3_deg", "phi_deg", "matrix11")] == [
        "S1",
        "β3",
        "φ",
        "matrix11",
    ]


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_described_in_full(name: str) -> None:
    record = effect_record(EFFECTS[name])
    assert record["description"]
    assert all(item["unit"] and item["typical"] for item in record["parameters"])


def test_names_from_files_do_not_speak_to_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    rows = table("arm")
    rows.add_row(Text("a\x1b[31mred\x07"))
    show(rows, Text("title\x1b]0;x\x9b"))
    printed = capsys.readouterr().out
    assert "red" in printed
    assert all(letter == "\n" or letter.isprintable() for letter in printed)
