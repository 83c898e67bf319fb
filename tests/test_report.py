"""A calibration beside the truth, and how numbers are written."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rich.text import Text

import estimators
import scenarios
from rig.effects import EFFECTS
from rig.number_text import with_std
from scenarios.comparison import compare, units
from scenarios.terminal.calibration import symbol
from scenarios.terminal.tables import effect_record, plus_minus, shortened, show, table

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
    magnetic = units("magnetometer", calibration["magnetometer"], "G")
    assert (magnetic["sensitivity1"], magnetic["offset2"], magnetic["phi_deg"]) == ("V/G", "V", "deg")
    assert units("magnetometer", calibration["magnetometer"], None)["sensitivity1"] == "V/field"
    assert units("accelerometer", calibration["accelerometer"], None)["sensitivity1"] == "V/(m/s²)"


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
