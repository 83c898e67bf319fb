"""The page on both papers, as Markdown; every number in it comes from the comparison and the study."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from scenarios.studies.error_summary import Summary
from scenarios.studies.verdict import verdicts
from validation.markdown import list_of, page_of, table_of
from validation.paper.compare import BASES, Comparison, early_stop_words, findings
from validation.paper.dip import ALLOWED, EXCLUDED, dip_words
from validation.paper.figures_text import OneDraw
from validation.paper.page_camps import camps_section
from validation.paper.published import angle_table as angles_of
from validation.paper.published import camps, renk, spread_table
from validation.paper.published import parameter_table as parameters_of
from validation.paper.rows import Statement, published_rows

#: The pictures, beside the page in this folder.
FOLDER: Final = "paper"
PICTURES: Final = (
    "maneuver",
    "growing",
    "separate",
    "simultaneous",
    "scatter",
    "misfit",
    "camps",
    "coverage",
    "ellipsoids",
)
_SHOWN_COUNTS: Final = 6


def page(comparison: Comparison, summary: Summary) -> str:
    """The Markdown text of docs/paper.md."""
    return page_of(_blocks(comparison, summary))


def _blocks(comparison: Comparison, summary: Summary) -> Iterator[str]:
    yield "<!-- Written by `rig study paper -o docs`; do not edit. -->"
    yield "# Both papers, table by table"
    yield f"[1] {renk()['citation']}  \n[2] {camps()['citation']}"
    yield (
        "Every published table stands here beside what the rig gives under the same conditions, in the papers' frames"
        " and units. The verdicts and the findings are computed from the numbers by `rig study paper`; nothing on this"
        " page is typed by hand but the explanations around it."
    )
    yield "## What comes out"
    consistent = (f"Is the estimator consistent? {verdict.title}." for verdict in verdicts(summary))
    yield list_of((*findings(comparison), *consistent))
    yield from _agreement(comparison)
    yield from _maneuver()
    yield from _consistency(comparison, summary)
    yield from _renk(comparison)
    yield from _text("What the text of [1] says about its numbers", _of(comparison.statements, "renk"))
    yield from _dip(comparison)
    yield from _misfits(comparison)
    yield from _early_stops(comparison)
    yield from camps_section(comparison, FOLDER)
    yield from _text("What the text of [2] says about its numbers", _of(comparison.statements, "camps"))


def _agreement(comparison: Comparison) -> Iterator[str]:
    """How many rows agree, and on what that rests."""
    yield (
        "What a verdict rests on. *Tested*: the row could have come out otherwise than the rig predicts it. *By"
        " construction*: it went into the rig, as its truth or its noise, so the rig gives it back (Tables 2, 5 and"
        " 10 of [1]; all of [2], whose truth is the mean of Tables 3 and 4 and whose noise is set to their median"
        " scatter; only how evenly the parameters scatter is tested there, below). *Arithmetic*: it is held against"
        " other published rows alone (Tables 4, 6, 9 and 11 of [1])."
    )
    words = ("agrees", "differs", "cannot be told", "is the rig's truth")
    rows = [
        (basis, *(str(sum(row.basis == basis and row.word == word for row in comparison.rows)) for word in words))
        for basis in BASES
    ]
    yield table_of(("rests on", "agrees", "differs", "cannot be told", "is the rig's truth"), rows)


def _maneuver() -> Iterator[str]:
    yield "## The maneuver: Figures 1 and 2 of [1]"
    yield (
        "The same sweep with the rig's arm: 15 passes of joint 1, seven of joint 5, joint 6 rolling on; every bristle"
        " of the torus is the way from the wrist to the sensor at one instant. (The picture at the top of the README"
        " is the arm in it.)"
    )
    yield f"![Joint angles, and the torus of bristles]({FOLDER}/maneuver.png)"


def _consistency(comparison: Comparison, summary: Summary) -> Iterator[str]:
    draws = summary.cells[0].draws
    counts = sorted({cell.count for cell in summary.cells})
    yield "## Is the estimator consistent? Figures 3 and 4 of [1]"
    yield (
        "The paper draws the noise once and finds that the estimator might be slightly inconsistent. Here it is drawn"
        f" {draws:,} times, for {len(counts)} numbers of samples from {counts[0]:,} to {counts[-1]:,}, taken as in the"
        " paper (the first n), spread evenly (every k-th) and at random."
    )
    yield (
        "One draw on a linear axis, as the paper prints it, with the noise ×1 and ×10; in red, how near the text says"
        " that its estimates end. Before some 700 samples the sweep has not turned the sensor enough, so that the bound"
        " itself is wide: that is what looks like a slow convergence."
    )
    yield f"![Estimates of one draw on a linear axis]({FOLDER}/growing.png)"
    for method in ("separate", "simultaneous"):
        yield f"![{method.capitalize()} fit: estimates, RMSE and bound]({FOLDER}/{method}.png)"
    for verdict in verdicts(summary):
        yield f"**{verdict.title.capitalize()}.**"
        yield list_of(verdict.sentences)
    yield from _cells(summary)
    yield (
        "What the text reads off the end of its curves is what an efficient estimate does. Errors at n and at m > n"
        " samples of one growing data set are correlated by sqrt(n / m): a draw that is off at 2,500 samples is likely"
        " to be off at 6,656, and looks like a bias."
    )
    yield table_of(
        ("figure", "fit", "noise", "samples", "parameter", "off by at most", "bound there", "as close as that in"),
        [_one_draw(draw) for draw in comparison.one_draws],
    )


def _cells(summary: Summary) -> Iterator[str]:
    """S1 and delta1 at some sample counts, every k-th sample."""
    chosen = summary.some_counts(_SHOWN_COUNTS)
    rows = [
        (
            cell.method,
            f"×{cell.noise_factor:g}",
            cell.parameter,
            f"{cell.count:,}",
            f"{cell.bias / cell.bias_std:+.1f}",
            f"{cell.bound:.3g}",
            f"{cell.ratio:.3f} [{cell.ratio_low:.3f}, {cell.ratio_high:.3f}]",
            f"{cell.coverage:.1%} [{cell.coverage_low:.1%}, {cell.coverage_high:.1%}]",
        )
        for cell in summary.cells
        if cell.order == "every-kth" and cell.parameter in ("sensitivity1", "offset1") and cell.count in chosen
    ]
    yield "Every k-th sample:"
    yield table_of(
        ("fit", "noise", "parameter", "samples", "bias / its error", "bound", "RMSE / bound", "coverage of 95 %"),
        rows,
    )


def _one_draw(draw: OneDraw) -> tuple[str, ...]:
    return (
        draw.figure,
        draw.method,
        f"×{draw.noise_factor:g}",
        f"{draw.samples:,}",
        draw.parameter,
        f"{draw.within:g} {draw.unit}",
        f"{draw.bound:.2g} {draw.unit}, {draw.within / draw.bound:.1f} of them",
        f"{draw.probability:.0%} of draws",
    )


def _renk(comparison: Comparison) -> Iterator[str]:
    yield "## Tables 2 to 12 of [1]"
    yield (
        "The rig's truth are Tables 5 and 10, with the stated noise and the converter's steps; its numbers are mean ±"
        " standard deviation of 1,000 simulated experiments, of Tables 7 and 12 those of 25 subsets of one. Separate"
        " and simultaneous fits of one data set differ by far less than either scatters: Tables 3 and 8 are held"
        " against that."
    )
    for table in comparison.tables("renk"):
        yield f"### Table {table}: {_title(table)}"
        if table == "7":
            yield f"![Standard deviations over the bound]({FOLDER}/scatter.png)"
        yield published_rows(comparison.table("renk", table))


def _title(table: str) -> str:
    if table in ("4", "6", "9", "11"):
        return angles_of(table).title
    return spread_table(table).title if table in ("7", "12") else parameters_of(table).title


def _misfits(comparison: Comparison) -> Iterator[str]:
    yield "## Noise-like or systematic"
    yield (
        "Neighbouring samples see nearly the same pose, so what the model misses is the same in all 25 subsets: it is"
        " in the fit error, but not in the scatter of the estimates. The scatter of Tables 7 and 12 over the bound,"
        " times the noise, is therefore the noise-like part of the fit error. `rig study subsets` does the same with"
        " any recording."
    )
    yield f"![Fit errors and their noise-like part]({FOLDER}/misfit.png)"
    yield table_of(
        ("channel", "noise, arm locked", "fit error", "noise-like [95 %]", "systematic", "noise-like share"),
        [
            (
                f"{row.sensor} {row.channel + 1}",
                f"{1e3 * row.noise:.1f} mV",
                f"{1e3 * row.fit_error:.1f} mV",
                f"{1e3 * row.noise_like:.1f} [{1e3 * row.noise_low:.1f}, {1e3 * row.noise_high:.1f}] mV",
                f"{1e3 * row.systematic:.1f} mV",
                f"{row.share:.1%}",
            )
            for row in comparison.misfits
        ],
    )


def _dip(comparison: Comparison) -> Iterator[str]:
    dip = comparison.dip
    yield "## The dip of the magnetic field"
    yield dip_words(dip)
    rows = [
        (
            "phi of the magnetic field, Table 10",
            f"{dip.found_deg:.4f}°",
            f"{dip.found_std_deg:.2f}° (separate fits, Table 8)",
        ),
        ("gravity off the base's axis, Table 5", f"{dip.level_deg:.4f}°", f"{dip.level_std_deg:.3f}° (Table 7)"),
        ("dip of the Earth's field, IGRF-14", f"{dip.earth_deg:.2f}°", f"{dip.earth_std_deg:.1f}° (local rock, time)"),
        ("difference", f"{dip.turned_deg:.2f}°", f"{dip.turned_std_deg:.2f}°"),
        ("weakest stray field over the Earth's, sin", f"{dip.least:.3f}", f"95 %: {dip.low:.3f} to {dip.high:.3f}"),
    ]
    yield table_of(("", "value", "standard deviation"), rows)
    yield (
        "The unit of the sensitivities does not matter, nor does the base's heading: only the direction is used. It"
        " is a bound: a stray field that also lengthens or shortens the Earth's is stronger. It excludes"
    )
    yield list_of(f"{line};" for line in EXCLUDED)
    yield f"and leaves {'; '.join(ALLOWED)}."


def _early_stops(comparison: Comparison) -> Iterator[str]:
    published = spread_table("7").std
    yield "## Would an optimiser that stops early explain Tables 3 and 7?"
    yield (
        "Gravity's phi scatters four times the bound in Table 7, and the separate fits of Table 3 lie far apart. Both"
        " could come from searches that ended before the minimum. Here are 25 data sets, with the noise that the"
        " scatter of Table 7 shows, fitted as in the paper (BFGS, numerical gradients, its start) and ended by the"
        " relative fall of the cost."
    )
    rows = [
        (
            "the gradient" if one.tolerance is None else f"a fall below {one.tolerance:g}",
            f"{one.start_deg:g}°",
            f"some {round(one.iterations, -1):.0f}",
            f"{one.phi_deg:.2f}°",  # where an unfinished search ends moves with a processor's sums
            f"{one.beta2_deg:.2f}°",
            f"{1e3 * one.fit_error:.1f} mV",
            "yes" if one.like_table_7 else "no",
            f"{one.apart_deg:.2f}°",
            "yes" if one.like_table_3 else "no",
        )
        for one in comparison.early_stops
    ]
    rows.append(
        (
            "published",
            "–",
            "–",
            f"{published['phi_deg'].text}°",
            f"{published['beta2_deg'].text}°",
            "41 mV",
            "",
            "0.35°",
            "",
        )
    )
    titles = (
        "ended by",
        "phi at the start",
        "iterations",
        "phi scatters by",
        "beta2",
        "fit error",
        "both as in Table 7",
    )
    yield table_of((*titles, "separate fields apart", "as in Table 3"), rows)
    yield early_stop_words(comparison.early_stops)


def _text(title: str, statements: Iterable[Statement]) -> Iterator[str]:
    yield f"## {title}"
    rows = [(one.about, one.says, one.finds, "yes" if one.holds else "**no**") for one in statements]
    yield table_of(("about", "it says", "the numbers say", "holds"), rows)


def _of(statements: Iterable[Statement], paper: str) -> list[Statement]:
    return [one for one in statements if one.paper == paper]
