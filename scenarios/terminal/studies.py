"""Studies as tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

from rich.console import Group, RenderableType, group
from rich.padding import Padding
from rich.text import Text

from estimators.p_words import p_words
from rig.number_text import with_std
from scenarios.parameter_names import shown_name
from scenarios.shown_units import shown_unit
from scenarios.studies.error_summary import Cell, Summary
from scenarios.studies.intervals import LEVEL
from scenarios.studies.subset_results import FieldAgreement, SubsetChannel, SubsetStudy
from scenarios.studies.verdict import verdicts
from scenarios.terminal.tables import table

_SHOWN_COUNTS: Final = 3


@group()
def consistency_report(summary: Summary, parameters: Sequence[str]) -> Iterable[RenderableType]:
    """Bias, RMSE and coverage of some parameters at some sample counts, then the verdicts."""
    columns = ("fit", "noise", "order", "parameter", "samples", "bias/s.e.", "bound", "RMSE/bound", "coverage")
    rows = []
    shown = summary.some_counts(_SHOWN_COUNTS)
    sensors = list(dict.fromkeys(cell.sensor for cell in summary.cells))
    # The table of the study's folder has the others.
    orders = list(dict.fromkeys(cell.order for cell in summary.cells))
    order = "every-kth" if "every-kth" in orders else orders[0]
    for cell in summary.cells:
        if cell.count not in shown or cell.parameter not in parameters or cell.order != order:
            continue
        fit = cell.method if len(sensors) == 1 else f"{cell.sensor}, {cell.method}"
        numbers = (f"{cell.count:,}", f"{cell.bias / cell.bias_std:+.1f}", f"{cell.bound:.3g}", _ratio(cell))
        which = (fit, f"×{cell.noise_factor:g}", cell.order, shown_name(cell.parameter))
        rows.append((*which, *numbers, f"{cell.coverage:.1%}" if cell.small else f"({cell.coverage:.1%})"))
    yield table(*columns, numbers=columns[4:], rows=rows)
    for verdict in verdicts(summary):
        yield Text(f"\n{verdict.title}", style="bold")
        yield from (Padding(Text(sentence), (0, 0, 0, 2)) for sentence in verdict.sentences)


def _ratio(cell: Cell) -> str:
    if not cell.small:
        return f"({cell.ratio:.3g})"
    return f"{cell.ratio:.3f} ({cell.ratio_low:.3f}-{cell.ratio_high:.3f})"


def subsets_report(study: SubsetStudy) -> RenderableType:
    """Every parameter beside the bound, the fit errors taken apart, and whether the separate fits agree."""
    columns = ("sensor", "parameter", "unit", "all samples", "mean", "std", "bound", "std/bound")
    rows = []
    for row in study.parameters:
        mean, std = with_std(row.mean, row.std)
        whole = with_std(row.whole, row.std)[0]
        told = math.isfinite(row.ratio)
        ratio = f"{row.ratio:.2f} ({row.ratio_low:.2f}-{row.ratio_high:.2f})" if told else "cannot be told"
        bound = with_std(row.bound, row.std)[0] if told else "–"
        name = shown_name(row.parameter)
        rows.append((row.sensor, name, row.unit, whole, mean, std, bound, ratio))
    headings = ("channel", "fit error", "noise floor", "noise-like", "systematic", "noise-like share")
    source = {"locked recording": "of the locked arm", "given": "as given", "residuals": "from the residuals"}
    title = (
        f"{study.recording}: {study.samples:,} samples in {study.subsets} interleaved subsets, {study.method} fits,"
        f" noise of the bound {source[study.noise_source]}\n"
    )
    untold = [row for row in study.parameters if row.why]
    why = [f"  {row.sensor} {shown_name(row.parameter)}: {row.why}" for row in untold]
    return Group(
        Text(title),
        table(*columns, numbers=columns[3:], rows=rows),
        *map(Text, why),
        Text(f"\nThe separate fits' error, taken apart by the subsets' scatter ({LEVEL:.0%} intervals)\n"),
        table(*headings, numbers=headings[1:], rows=map(_channel, study.channels)),
        Text(""),
        *(Text(_agreement(agreement, study.subsets)) for agreement in study.agreements),
    )


def _channel(row: SubsetChannel) -> Iterable[str]:
    shown = shown_unit(row.unit)

    def text(value: float, low: float | None = None, high: float | None = None) -> str:
        if not math.isfinite(value):
            return "–"
        interval = "" if low is None or high is None else f" ({shown.factor * low:.3g}-{shown.factor * high:.3g})"
        return f"{shown.factor * value:.3g}{interval} {shown.name}"

    return (
        row.channel,
        text(row.fit_error),
        text(row.floor),
        text(row.noise_like, row.noise_low, row.noise_high),
        text(row.systematic, row.systematic_low, row.systematic_high),
        f"{row.share:.1%} ({row.share_low:.1%}-{row.share_high:.1%})",
    )


def _agreement(row: FieldAgreement, subsets: int) -> str:
    verdict = "agree on" if row.p_value > 1e-3 else "do not agree on"
    p_value = p_words(row.p_value)
    return (
        f"The separate fits of the {row.sensor} {verdict} one field direction: chi-square {row.chi_square:.1f} for"
        f" {row.degrees_of_freedom} degrees of freedom, {p_value}; they lie up to {row.apart_deg:.3g}° apart,"
        f" with standard deviations up to {row.uncertainty_deg:.2g}°. {row.disagreeing} of {subsets} subsets"
        " disagree at 1 %."
    )
