"""The tables as they are kept, digit by digit against the papers' own texts, where those are at hand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from validation.paper.published import (
    angle_table,
    camps,
    ellipsoid_table,
    parameter_table,
    renk,
    spread_table,
)

TEXTS = Path(__file__).parents[1].parent / "shared" / "papers"
RENK, CAMPS = TEXTS / "000_16478c8100e2d393.txt", TEXTS / "003_7303e88cd2879f98.txt"

pytestmark = pytest.mark.skipif(not RENK.is_file(), reason="the papers' texts are not at hand")


def rows_after_title(number: str) -> list[list[str]]:
    """The cells of a table of Renk et al.: the lines with bars from its title on, but for titles and rules."""
    lines = RENK.read_text(encoding="utf-8").split("\n")
    title = re.compile(rf"^(\*\*|\| |\| <b>)Table {number}\.")
    [first] = [place for place, line in enumerate(lines) if title.match(line)]
    found: list[list[str]] = []
    for line in lines[first + 1 :]:
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and re.match(r"[0-9]|Magnetic|gravity", cells[0]):
            found.append(cells)
        elif found and not line.startswith("|"):
            break
    return found


def plain(text: str) -> str:
    """2.8356e-5 of $2.8356 \\times 10^{-5}$."""
    match = re.fullmatch(r"\$([0-9.]+) \\times 10\^\{(-?[0-9]+)\}\$", text)
    return f"{match[1]}e{match[2]}" if match else text


@pytest.mark.parametrize("number", ["2", "3", "5", "8", "10"])
def test_parameters(number: str) -> None:
    table = parameter_table(number)
    kept = [[f"{k + 1}", *(printed.text for printed in row)] for k, row in enumerate(table.rows)]
    assert rows_after_title(number) == kept


@pytest.mark.parametrize("number", ["4", "6", "9", "11"])
def test_angles(number: str) -> None:
    kept = [[pair.replace("-", " and "), angle.text] for pair, angle in angle_table(number).angles.items()]
    assert rows_after_title(number) == kept


@pytest.mark.parametrize("number", ["7", "12"])
def test_means_and_standard_deviations(number: str) -> None:
    table = spread_table(number)
    stems = {"S": "sensitivity", r"\delta": "offset", r"\beta": "beta", r"\gamma": "gamma"}
    stems |= {r"\phi": "phi", r"\psi": "psi"}
    rows = rows_after_title(number)
    assert len(rows) == len(table.mean) == 14
    for (_, what, mean, std), name in zip(rows, table.mean, strict=True):
        match = re.match(r"\$(S|\\[a-z]+)_?([123]?)\$ +\((.+)\)", what)
        assert match, what
        stem, axis, unit = match.groups()
        assert f"{stems[stem]}{axis}" == name.removesuffix("_deg")
        assert (plain(mean), plain(std)) == (table.mean[name].text, table.std[name].text)
        if name in table.printed_units:
            assert unit == table.printed_units[name]
        else:
            assert ("circ" in unit or unit == "°") == name.endswith("_deg")


@pytest.mark.parametrize("number", ["1", "2", "3", "4"])
def test_three_tests(number: str) -> None:
    text = CAMPS.read_text(encoding="utf-8")
    part = text.partition(f"Table {number} – Computed")[2]
    part = part[: part.find("Table", 1)] if number != "4" else part
    names = {r"\alpha_x": "gain11", r"\alpha_y": "gain22", r"\alpha_z": "gain33"}
    names |= {"S_{xy}": "gain12", "S_{xz}": "gain13", "S_{yz}": "gain23"}
    names |= {r"\beta_x": "offset1", r"\beta_y": "offset2", r"\beta_z": "offset3"}
    found = {}
    for line in part.split("\n"):
        cells = line.split("\t")
        if len(cells) == 4 and cells[0].strip("$") in names:
            found[names[cells[0].strip("$")]] = cells[1:]
    assert found == {name: [one.text for one in row] for name, row in ellipsoid_table(number).rows.items()}


def test_figures_in_the_running_text() -> None:
    text = " ".join(RENK.read_text(encoding="utf-8").split())
    numbers = renk()
    assert f"takes {numbers['duration_min']} min" in text
    assert f"{numbers['all_samples']:,} joint orientations at a sampling rate of {numbers['rate_Hz']} Hz" in text
    assert f"{numbers['samples']:,} joint orientations" in text
    for sensor, errors in (("accelerometer", "18, 26, and 26 mV"), ("magnetometer", "0.1179, 0.150, and 0.1257 V")):
        assert errors in text
        scale = 1e3 if "mV" in errors else 1.0
        stated = [float(value) * scale for value in numbers[sensor]["separate_error"]]
        assert stated == pytest.approx([float(value) for value in re.findall(r"[0-9.]+", errors)])
        noise = [f"{1e3 * float(value):.1f}" for value in numbers[sensor]["noise"]]
        assert f"{noise[0]}, {noise[1]}, and {noise[2]} mV" in text
        ranges, bits = numbers[sensor]["dynamic_range_dB"], numbers[sensor]["bits"]
        assert f"{ranges[0]}, {ranges[1]}, and {ranges[2]} dB" in text
        assert f"{bits[0]}, {bits[1]}, and {bits[2]} bits" in text
    assert "is 41 mV" in text
    assert numbers["accelerometer"]["simultaneous_error"] == "0.041"
    assert f"is {numbers['magnetometer']['simultaneous_error']} V" in text
    for entry in numbers["within"]:
        assert entry["limit"] in text, entry["what"]


def test_figures_in_the_other_running_text() -> None:
    text = " ".join(CAMPS.read_text(encoding="utf-8").split())
    numbers = camps()
    assert f"{numbers['magnetometer']['field']}\\text{{gauss}}" in text
    assert f"{numbers['readings']} data points" in text
    assert f"about {numbers['iterations']} iterations" in text
    assert f"theoretical gains are {numbers['magnetometer']['nominal_gain']} and biases are 0" in text
    assert f"theoretical gains are {numbers['accelerometer']['nominal_gain']} and biases are 0" in text
    assert f"For the magnetometer the theoretical gains are {numbers['magnetometer']['gain_in_words']}" in text
