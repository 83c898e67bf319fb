"""``rig compare``: two calibrations, a calibration and the truth, a recording and its simulation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click

from rig.errors import RigError
from scenarios.cli._options import PATH, RECORDING_SUFFIXES, answer, check_picture, json_option, memory_option

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

#: Differences less probable than this are no chance.
_BY_CHANCE: Final = 1e-3
_CALIBRATION, _RECORDING, _SCENARIO = "calibration", "recording", "scenario"
#: Memory that a comparison takes [bytes a sample].
_BYTES_A_SAMPLE: Final = 4000.0


@click.command(short_help="Two calibrations, a calibration and the truth, or a recording and its simulation.")
@click.argument("first", type=PATH, metavar="A")
@click.argument("second", type=PATH, metavar="B")
@click.option("-o", "--output", type=PATH, metavar="F.png", help="Draw the differences: .png, .svg or .pdf.")
@memory_option
@json_option
def compare(first: Path, second: Path, output: Path | None, as_json: bool) -> int:
    """Hold A against B, parameter by parameter or channel by channel, in standard deviations.

    Two calibrations (.json) of independent recordings; a calibration and a scenario, whose rig is the truth; or a
    recording (.parquet, .csv) and a scenario, whose rig is made to repeat the recorded maneuver. The exit status is 1
    where the two differ by more than chance: less than once in a thousand.

    \b
    Example:
      rig compare monday.json friday.json
      rig compare cal.json ann-arbor -o errors.png
      rig compare run.parquet fitted.toml
    """
    kinds = {path: _kind(path) for path in (first, second)}
    pair = [kinds[first], kinds[second]]
    if pair not in ([_CALIBRATION] * 2, [_CALIBRATION, _SCENARIO], [_RECORDING, _SCENARIO]):
        if pair[::-1] not in ([_CALIBRATION, _SCENARIO], [_RECORDING, _SCENARIO]):
            raise RigError(
                f"{first} and {second}: found a {pair[0]} and a {pair[1]}, expected two calibrations, or a calibration "
                "or a recording and a scenario"
            )
        first, second = second, first
    check_picture(output, first, second)
    beside = kinds[first] == _RECORDING
    found = _recording(first, second) if beside else _calibrations(first, second, kinds[second])
    if output is not None:
        from scenarios.plots import save

        save(found.figure(), output)
    answer(as_json, found.document, lambda _: found.shown, output)
    return 0 if found.document["alike"] else 1


class _Found(NamedTuple):
    """A comparison: its JSON object, what is shown on the terminal, and its picture, made where it is wanted."""

    document: dict[str, Any]
    shown: RenderableType
    figure: Callable[[], Figure]


def _kind(path: Path) -> str:
    if path.suffix in RECORDING_SUFFIXES:
        return _RECORDING
    return _CALIBRATION if path.suffix == ".json" else _SCENARIO


def _calibrations(first: Path, second: Path, kind: str) -> _Found:
    """A calibration beside another, or beside the truth of a scenario."""
    from rich.console import Group
    from rich.text import Text

    from estimators.calibration import Calibration
    from estimators.p_words import p_words
    from scenarios.comparison import apart, compare, compare_two
    from scenarios.loader import load
    from scenarios.plots import errors_figure
    from scenarios.terminal.calibration import comparison_table

    one = Calibration.read(first)
    if kind == _SCENARIO:
        rows, members = compare(load(second).truth, one), [one]
        names = ("truth", "estimate")
        if not rows:
            raise RigError(f"{first}: has no parameter that scenario {second} states, expected axes and offsets")
    else:
        two = Calibration.read(second)
        rows, members, names = compare_two(one, two), [one, two], ("A", "B")
    total = apart(rows, *members)
    alike = all(each.p_value >= _BY_CHANCE for each in total.values())
    document = {
        "first": first,
        "second": second,
        "alike": alike,
        "parameters": [vars(row) for row in rows],
        "together": {sensor: vars(each) for sensor, each in total.items()},
    }
    shown: list[RenderableType] = [comparison_table(rows, names), Text("")]
    for sensor, each in total.items():
        verdict = "alike, as far as chance goes" if each.p_value >= _BY_CHANCE else "they differ"
        shown.append(
            Text(
                f"{sensor}: {verdict}: chi-square {each.chi_square:.1f} for {each.degrees_of_freedom} parameters, "
                f"{p_words(each.p_value)}"
            )
        )
    return _Found(document, Group(*shown), lambda: errors_figure(rows, f"({names[1]} − {names[0]}) / σ"))


def _recording(first: Path, second: Path) -> _Found:
    """A recording beside what a scenario's rig makes of its maneuver."""
    from rich.console import Group
    from rich.text import Text

    from rig.recording import whole_or_means
    from scenarios.beside_simulation import beside_simulation
    from scenarios.loader import load
    from scenarios.plots import residuals_figure
    from scenarios.shown_units import shown_unit
    from scenarios.terminal.tables import table

    scenario = load(second)
    arm = scenario.rig.arm
    recording, block = whole_or_means(first, None if arm is None else arm.dof, _BYTES_A_SAMPLE)
    rows, laid = beside_simulation(recording, scenario)
    known = [row.p_value for row in rows if row.p_value is not None]
    # the smallest of several is small by chance more often
    alike = not known or min(known) * len(known) >= _BY_CHANCE
    document = {
        "first": first,
        "second": second,
        "alike": alike,
        "averaged": block,
        "channels": [vars(row) for row in rows],
    }
    numbers = ("σ", "mean", "RMS", "RMS / σ", "recalibrated")
    cells = []
    for row in rows:
        own = shown_unit(row.unit)
        ratios = ("–" if each is None else f"{each:.3g}" for each in (row.rms_sigmas, row.recalibrated_sigmas))
        sizes = (f"{own.factor * each:.3g}" for each in (row.sigma, row.mean, row.rms))
        cells.append((row.channel, *sizes, *ratios, own.name))
    shown = table("channel", *numbers, "unit", numbers=numbers, rows=cells)
    words = "alike, as far as chance goes" if alike else "they differ by more than the noise that the scenario states"
    if not known:
        words = "the scenario states no noise, so that nothing is said of chance"
    note = "recalibrated: RMS / σ once sensitivities, offsets and directions are fitted to the recording"
    return _Found(document, Group(shown, Text(f"\n{words}"), Text(note)), lambda: residuals_figure(recording.t, laid))
