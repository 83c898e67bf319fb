"""Bars: the gap by channel, what it follows, how far it closes, how far the calibration had moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from estimators.gap.choices import sigmas_words
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.readable_units import rms_text
from estimators.gap.remainder_words import variable_words
from estimators.gap.share_words import chance, percent
from rig.channels import CHANNELS_OF
from scenarios.colours import BLACK, BLUE, VERMILLION
from scenarios.gap_report import html
from scenarios.gap_report.words import ANSWERS, part_words, place_words, share_words
from scenarios.plots.inline_svg import inline_svg, page_panels
from scenarios.plots.style import style
from scenarios.shown_units import Shown

_FOLLOWS: Final = 10  # bars of what the gap follows, at most


def channel_bars(diagnosis: Diagnosis, shown: Mapping[str, Shown]) -> str:
    """Each channel's gap before and after, with its noise floor; one scale a sensor. ``shown``: units by channel.

    Without a gap it is the residual that stands beside the floor.
    """
    sensors = [[name for name in names if name in diagnosis.channels] for names in CHANNELS_OF.values()]
    groups = [names for names in sensors if names]
    explained, quiet = bool(diagnosis.leading), diagnosis.verdict == "no-gap"
    counts = [len(names) for names in groups]
    with style():
        height, margins = 58.0 * len(groups) + 36.0 * sum(counts), (70.0, 190.0, 6.0, 42.0)
        figure, axes = page_panels((1000.0, height), len(groups), 1, margins, (0.0, 54.0), height_ratios=counts)
        for axis, names in zip(axes[:, 0], groups, strict=True):
            unit = shown[names[0]]
            for place, name in enumerate(names):
                row = diagnosis.channels[name]
                size = row.rms_before if quiet else row.gap_before
                sizes = (size, row.gap_after, row.noise_floor)
                before, after, floor = (unit.factor * each for each in sizes)
                words, words_after, _ = (
                    rms_text(each, row.noise_floor, diagnosis.samples, unit.factor) for each in sizes
                )
                axis.barh(place - 0.2 * explained, before, 0.34, color=VERMILLION)
                if explained:
                    axis.barh(place + 0.2, after, 0.34, color=BLUE)
                axis.vlines(floor, place - 0.44, place + 0.44, color=BLACK, linewidth=1.5)
                told = f"{words} → {words_after} {unit.name}" if explained else f"{words} {unit.name}"
                beside = axis.get_yaxis_transform()
                axis.text(1.015, place - 0.06, told, weight="bold", va="bottom", transform=beside)
                below = _beside(row.closed, before / max(floor, 1e-300))
                axis.text(1.015, place + 0.06, below, fontsize=8, va="top", transform=beside)
            axis.set_yticks(range(len(names)), names)
            axis.set_ylim(len(names) - 0.5, -0.5)
            axis.set_xlim(0.0, max(axis.get_xlim()[1], 1e-12))
            axis.set_xlabel(f"RMS [{unit.name}]")
            axis.grid(axis="y", visible=False)
    what = "residual of each channel" if quiet else "gap of each channel" + " before and after" * explained
    return inline_svg(figure, f"{what}, beside its noise floor")


def _beside(closed: float | None, relative: float) -> str:
    near = 0.95 <= relative < 9.995  # 1.01 beside 1.00 tells something
    of_floor = f"{relative:.2f} × floor" if near else f"{relative:.{2 if relative < 1.0 else 3}g} × floor"
    return of_floor if closed is None else f"{of_floor}, {part_words(closed)} closed"


def follow_bars(follows: Sequence[Mapping[str, Any]]) -> str:
    """Shares of the squared gap by what it follows, the largest first."""
    bars = []
    for each in sorted(follows, key=lambda each: -float(each["share"]))[:_FOLLOWS]:
        share, channel = float(each["share"]), each.get("channel")
        words = place_words(variable_words(str(each["variable"])))
        words += f", {channel}" if channel and channel != "all" else ""
        bars.append(html.bar(words, percent(share), share, "after"))
    return html.bars(bars, "shares of the squared gap by what it follows")


def posterior_bars(diagnosis: Diagnosis) -> str:
    """The probabilities of the three answers, one bar each."""
    chances = diagnosis.posterior
    bars = [
        html.bar(words, chance(chances[name]), chances[name], "before" if name == "other" else "after")
        for name, words in ANSWERS.items()
    ]
    return html.bars(bars, "probability of each of three answers")


def closed_bar(diagnosis: Diagnosis) -> str:
    """The share of the squared gap that is gone, with its interval."""
    closed = diagnosis.closed
    ends = None if closed.low is None or closed.high is None else (closed.low, closed.high)
    told = html.bar("of the squared gap", share_words(diagnosis.closed), closed.value or 0.0, "after", ends)
    return html.bars([told], "share of the squared gap that closes, with its 95 % interval")


def shift_bars(rows: Sequence[tuple[str, float]]) -> str:
    """Shifts in standard deviations of named parameters, in the order given."""
    with style():
        figure, axes = page_panels((470.0, 24.0 * len(rows) + 46.0), 1, 1, (150.0, 70.0, 2.0, 44.0))
        axis = axes[0, 0]
        axis.barh(range(len(rows)), [sigmas for _, sigmas in rows], 0.64, color=VERMILLION)
        for place, (_, sigmas) in enumerate(rows):
            told = f"{'−' if sigmas < 0.0 else '+'}{sigmas_words(sigmas)}"
            axis.text(1.03, place, told, weight="bold", va="center", transform=axis.get_yaxis_transform())
        axis.axvline(0.0, color=BLACK, linewidth=0.7)
        axis.set_yticks(range(len(rows)), [name for name, _ in rows])
        axis.set_ylim(len(rows) - 0.5, -0.5)
        reach = 1.05 * max(1.0, *(abs(sigmas) for _, sigmas in rows))
        axis.set_xlim(-reach, reach)
        axis.set_xlabel("shift [standard deviations]")
        axis.grid(axis="y", visible=False)
    return inline_svg(figure, "shift of calibration parameters in standard deviations")
