"""A diagnosis on the terminal: the sentence, then the numbers behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from estimators.gap.diagnosis import Diagnosis, percent
from scenarios.gap_report.units import shown_units
from scenarios.gap_report.words import (
    VERDICTS,
    cause_title,
    cause_words,
    closed_words,
    estimate_for_people,
    estimate_words,
    grouped_untold,
    p_words,
    sentence,
)
from scenarios.report import table

_COLOURS = {"no-gap": "green", "named": "bold blue", "ambiguous": "bold yellow", "unknown": "bold red"}
_SHIFTS = 3


def diagnosis_tables(diagnosis: Diagnosis, units: Mapping[str, str]) -> Group:
    """One recording's diagnosis: verdict, causes, channels, shift of the calibration, what cannot be told.

    Args:
        units: sensor -> recorded unit.
    """
    parts: list[RenderableType] = [
        Text(f"{diagnosis.recording}  ", style="bold").append(
            VERDICTS[diagnosis.verdict].lower(), style=_COLOURS[diagnosis.verdict]
        ),
        Text(sentence(diagnosis)),
    ]
    if diagnosis.causes:
        parts += [Text(""), _causes(diagnosis)]
    if diagnosis.channels:
        parts += [Text(""), _channels(diagnosis, units)]
    if lines := list(_lines(diagnosis)):
        parts += [Text(""), *(Text(line) for line in lines)]
    parts += [Text(f"warning: {warning}", style="yellow") for warning in diagnosis.warnings]
    return Group(*parts)


def _causes(diagnosis: Diagnosis) -> Table:
    numbers = ("probability", "p-value", "closes")
    result = table("cause", "parameters", *numbers, numbers=numbers)
    for cause in diagnosis.causes:
        parameters = [
            f"{name} {estimate_words(value)}" + (f" = {people}" if (people := estimate_for_people(value)) else "")
            for name, value in cause.parameters.items()
        ]
        others = [f"or {cause_title(each['effect'], each['where'])}" for each in cause.equivalent]
        words = "\n".join([cause_title(cause.effect, cause.where), *others])
        sizes = (percent(cause.probability), p_words(cause.p_value), percent(cause.closed))
        result.add_row(*map(Text, (words, "\n".join(parameters), *sizes)))
    return result


def _channels(diagnosis: Diagnosis, units: Mapping[str, str]) -> Table:
    shown = shown_units(units)
    numbers = ("floor", "RMS", "gap", "gap after", "closed")
    result = table("channel", *numbers, "unit", numbers=numbers)
    for name, row in diagnosis.channels.items():
        factor = shown[name].factor
        sizes = (row.noise_floor, row.rms_before, row.gap_before, row.gap_after)
        result.add_row(name, *(f"{factor * size:.3g}" for size in sizes), percent(row.closed), shown[name].name)
    return result


def _lines(diagnosis: Diagnosis) -> list[str]:
    lines = []
    follows = diagnosis.follows[:4]
    if follows:
        lines.append("follows      " + ", ".join(f"{each['variable']} {percent(each['share'])}" for each in follows))
    shifts = sorted(diagnosis.calibration_shift.items(), key=lambda item: -abs(item[1]["sigmas"]))[:_SHIFTS]
    if shifts:
        lines.append("shifted      " + ", ".join(f"{name} by {abs(shift['sigmas']):.1f} σ" for name, shift in shifts))
    left = [str(each["variable"]) for each in diagnosis.remainder_follows[:4]]
    lines.append(f"left over    {diagnosis.remainder}" + (f": follows {', '.join(left)}" if left else ""))
    if diagnosis.next:
        lines.append(f"next         {diagnosis.next['why']}")
        if diagnosis.next.get("maneuver"):
            lines.append(f"maneuver     {diagnosis.next['maneuver']}")
    for why, effects in grouped_untold(diagnosis.cannot_tell).items():
        lines.append(f"cannot tell  {', '.join(effects)}: {why}")
    return lines


def summary_table(diagnoses: Sequence[Diagnosis]) -> Table:
    """One line a recording."""
    result = table("recording", "verdict", "cause", "closed", "left over")
    for diagnosis in diagnoses:
        causes = "\n".join(
            line
            for cause in diagnosis.causes
            for line in (
                cause_words(cause),
                *(f"  or {cause_title(each['effect'], each['where'])}" for each in cause.equivalent),
            )
        )
        verdict = Text(VERDICTS[diagnosis.verdict].lower(), style=_COLOURS[diagnosis.verdict])
        left = ", ".join(str(each["variable"]) for each in diagnosis.remainder_follows[:2]) or diagnosis.remainder
        result.add_row(Text(diagnosis.recording), verdict, Text(causes), closed_words(diagnosis), Text(left))
    return result
