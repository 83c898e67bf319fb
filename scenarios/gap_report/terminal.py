"""A diagnosis on the terminal: the sentence, then the numbers behind it."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from estimators.gap.choices import sigmas_words
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.parameter_words import parameter_name, told_parameters
from estimators.gap.readable_units import rms_text, two_digits
from estimators.gap.remainder_words import variable_words
from estimators.gap.share_words import chance, percent
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.own_names import in_own_names
from scenarios.gap_report.untold import grouped_untold
from scenarios.gap_report.words import (
    ITS_SHARE,
    RIG_COLUMNS,
    VERDICTS,
    alike_title,
    cause_title,
    estimate_words,
    explanation_rows,
    hidden_words,
    left_words,
    noise_words,
    one_of_words,
    parameter_for_people,
    part_words,
    place_words,
    posterior_words,
    rig_rows,
    rig_words,
    sentence,
    share_words,
    status_words,
    worth_shifts,
)
from scenarios.shown_units import shown_units
from scenarios.terminal.tables import table

_COLOURS = {
    "no-gap": "green",
    "named": "bold blue",
    "ambiguous": "bold yellow",
    "partly": "bold magenta",
    "unknown": "bold red",
}
_SHIFTS = 3


def diagnosis_tables(diagnosis: Diagnosis, units: Mapping[str, str]) -> Group:
    """One recording's diagnosis: verdict, explanations, causes, channels, what is left, what to do next.

    Args:
        units: sensor -> recorded unit.
    """
    diagnosis = in_own_names(diagnosis)
    beside = "" if diagnosis.rig is None else f", beside the fitted rig {diagnosis.rig['name']}"
    parts: list[RenderableType] = [
        Text(f"{diagnosis.recording}  ", style="bold")
        .append(VERDICTS[diagnosis.verdict].lower(), style=_COLOURS[diagnosis.verdict])
        .append(beside, style="not bold"),
        Text(sentence(diagnosis)),
        Text(""),
        _explanations(diagnosis),
    ]
    if diagnosis.rig is not None:
        numbers, rows = RIG_COLUMNS.values(), rig_rows(diagnosis.rig, units, diagnosis.samples)
        against = table("channel", *numbers, "unit", numbers=numbers, rows=rows)
        parts[2:2] = [Text(""), against, *map(Text, rig_words(diagnosis))]
    if diagnosis.causes:
        parts += [Text(""), _causes(diagnosis)]
    if diagnosis.channels:
        parts += [Text(""), _channels(diagnosis, units)]
    if len(diagnosis.recordings) > 1:
        parts += [Text(""), _recordings(diagnosis)]
    parts += [Text(""), *(Text(line) for line in _lines(diagnosis))]
    parts += [Text(f"warning: {warning}", style="yellow") for warning in diagnosis.warnings]
    parts += [Text("\nWhat to do next", style="bold")]
    parts += [Text(f"{number}. {step}") for number, step in enumerate(next_steps(diagnosis), start=1)]
    if diagnosis.next and diagnosis.next.get("maneuver"):
        parts += [Text(f"maneuver: {diagnosis.next['maneuver']}"), Text(str(diagnosis.next["why"]))]
    return Group(*parts)


def _explanations(diagnosis: Diagnosis) -> Table:
    rows, rest = explanation_rows(diagnosis)
    rest_cells = [(Text(words, style="dim"), told) for words, told in rest]
    return table("explanation", "probability", numbers=("probability",), rows=[*rows, *rest_cells])


def _causes(diagnosis: Diagnosis) -> Table:
    numbers = ("probability", "its share")
    rows = []
    for cause in diagnosis.causes:
        parameters = [
            f"{parameter_name(name)} {estimate_words(value)}"
            + (f" = {people}" if (people := parameter_for_people(cause, name)) else "")
            for name, value in told_parameters(cause).items()
        ]
        names = [alike_title(cause), f"({status_words(cause, diagnosis)})"]
        if cause.equivalent:
            names.append("(parameters of the first)")
        sizes = (chance(cause.probability), share_words(cause.closed))
        rows.append(("\n".join(names), "\n".join(parameters), *sizes))
    return table("cause", "parameters", *numbers, numbers=numbers, rows=rows)


def _channels(diagnosis: Diagnosis, units: Mapping[str, str]) -> Table:
    """The noise floor and the residual of each channel; its gap where there is one, before and after the causes."""
    shown = shown_units(units)
    gap = ("gap", "gap after", "closed") if diagnosis.leading else () if diagnosis.verdict == "no-gap" else ("gap",)
    numbers = ("floor", "RMS", "RMS / floor", *gap)
    rows = []
    for name, row in diagnosis.channels.items():
        every = (row.noise_floor, row.rms_before, row.gap_before, row.gap_after)
        own, residual, *gaps = (
            rms_text(each, row.noise_floor, diagnosis.samples, shown[name].factor) for each in every
        )
        ratio = f"{row.rms_before / row.noise_floor:.2f}" if row.noise_floor > 0 else "–"
        told = [*gaps, part_words(row.closed)]
        rows.append((name, own, residual, ratio, *told[: len(gap)], shown[name].name))
    return table("channel", *numbers, "unit", numbers=numbers, rows=rows)


def _recordings(diagnosis: Diagnosis) -> Table:
    """Of several recordings what each says for each cause, and where its gap is largest."""
    told = [cause for cause in diagnosis.causes if cause.evidence]
    titles = ["largest gap / floor", *(f"log likelihood for {cause_title(each.effect, each.where)}" for each in told)]
    rows = []
    for name in diagnosis.recordings:
        own = diagnosis.by_recording[name]
        ratio = max((row.gap_before / row.noise_floor for row in own.values() if row.noise_floor > 0), default=0.0)
        rows.append((name, two_digits(ratio), *(f"{cause.evidence.get(name, 0.0):,.1f}" for cause in told)))
    return table("recording", *titles, numbers=titles, rows=rows)


def _lines(diagnosis: Diagnosis) -> list[str]:
    lines = [f"probability  {posterior_words(diagnosis)}"]
    lines += [f"one of       {words}" for words in one_of_words(diagnosis)]
    follows = diagnosis.follows[:4]
    if follows:
        shares = [f"{place_words(variable_words(str(each['variable'])))} {percent(each['share'])}" for each in follows]
        overlap = "; these overlap" if len(shares) > 1 else ""
        lines.append("follows      " + "; ".join([f"{shares[0]} of the squared gap", *shares[1:]]) + overlap)
    if diagnosis.closed.value is not None:
        judged = "held-out blocks and on the other maneuver" if diagnosis.closed_on == "both" else diagnosis.closed_on
        lines.append(f"closes       {share_words(diagnosis.closed)} of the squared gap, judged on {judged}")
    shifts, none = worth_shifts(diagnosis)
    if shifts:
        sizes = [f"{name} by {sigmas_words(shift['sigmas'])}" for name, shift in shifts[:_SHIFTS]]
        lines.append("shifts       " + ", ".join([f"{sizes[0]} standard deviations", *sizes[1:]]))
    elif none:
        lines.append(f"shifts       {none}")
    if len(diagnosis.causes) > 1:
        lines.append(f"its share    of a cause: {ITS_SHARE}")
    left = left_words(diagnosis)
    kind = noise_words(diagnosis) if diagnosis.remainder.verdict == "noise" else diagnosis.remainder.verdict
    lines.append(f"left over    {kind}" + (f": {left}" if left else ""))
    if hidden := hidden_words(diagnosis):
        lines.append(f"hidden       {hidden}")
    for why, effects in grouped_untold(diagnosis).items():
        lines.append(f"cannot tell  {', '.join(effects)}: {why}")
    return lines
