"""Bars: the gap by channel, what it follows, how far it closes, how far the calibration had moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from estimators.gap.choices import sigmas_words
from estimators.gap.diagnosis import Diagnosis, chance, percent
from estimators.gap.remainder_words import variable_words
from rig.channels import CHANNELS_OF
from scenarios.gap_report.svg import Drawing, Scale, nice_step, tick_label
from scenarios.gap_report.words import ANSWERS, closed_words, part_words, place_words
from scenarios.shown_units import Shown

_WIDTH: Final = 1000.0
_NARROW: Final = 360.0  # what a telephone shows
_BAR: Final = 36.0
_LABEL: Final = 92.0  # left of the bars
_VALUES: Final = 190.0  # right of them
_ROW: Final = 34.0
_FOLLOWS: Final = 10  # bars of what the gap follows, at most
_FIFTHS: Final = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def channel_bars(diagnosis: Diagnosis, shown: Mapping[str, Shown]) -> str:
    """Each channel's gap before and after, with its noise floor; one scale a sensor. ``shown``: units by channel.

    Without a gap it is the residual that stands beside the floor.
    """
    sensors = [[name for name in names if name in diagnosis.channels] for names in CHANNELS_OF.values()]
    groups = [names for names in sensors if names]
    height = sum(46.0 + _ROW * len(names) for names in groups)
    explained, quiet = bool(diagnosis.leading), diagnosis.verdict == "no-gap"
    what = "residual of each channel" if quiet else "gap of each channel" + " before and after" * explained
    drawing = Drawing(_WIDTH, height, f"{what}, beside its noise floor")
    top = 0.0
    for names in groups:
        unit = shown[names[0]]
        rows = [diagnosis.channels[name] for name in names]
        sizes = [row.rms_before if quiet else row.gap_before for row in rows]
        after = [row.gap_after for row in rows] if explained else []
        largest = max([row.noise_floor for row in rows] + sizes + after) * unit.factor
        scale = Scale(0.0, max(largest, 1e-12) * 1.04, _LABEL, _WIDTH - _VALUES)
        bottom = top + 14 + _ROW * len(names)
        for tick in scale.ticks():
            drawing.line(scale.at(tick), top + 8, scale.at(tick), bottom, "grid")
        for number, (name, row) in enumerate(zip(names, rows, strict=True)):
            y = top + 14 + _ROW * number
            before, left, floor = (unit.factor * size for size in (sizes[number], row.gap_after, row.noise_floor))
            drawing.text(_LABEL - 10, y + 16, name, "name", "end")
            drawing.rect(_LABEL, y, scale.at(before) - _LABEL, 11, "before")
            if explained:
                drawing.rect(_LABEL, y + 13, scale.at(left) - _LABEL, 11, "after")
            drawing.line(scale.at(floor), y - 3, scale.at(floor), y + 27, "floor")
            told = f"{before:.3g} → {left:.3g} {unit.name}" if explained else f"{before:.3g} {unit.name}"
            drawing.text(_WIDTH - _VALUES + 14, y + 10, told, "value")
            drawing.text(_WIDTH - _VALUES + 14, y + 24, _beside(row.closed, before / max(floor, 1e-300)), "note")
        drawing.x_axis(scale, bottom)
        drawing.text(_WIDTH - _VALUES + 14, bottom + 15, f"RMS [{unit.name}]", "tick")
        top = bottom + 32
    return str(drawing)


def _beside(closed: float | None, relative: float) -> str:
    near = 0.95 <= relative < 9.995  # 1.01 beside 1.00 tells something
    of_floor = f"{relative:.2f} × floor" if near else f"{relative:.{2 if relative < 1.0 else 3}g} × floor"
    return of_floor if closed is None else f"{of_floor}, {part_words(closed)} closed"


def follow_bars(follows: Sequence[Mapping[str, Any]]) -> str:
    """Shares of the squared gap by what it follows, the largest first."""
    bars = []
    for each in sorted(follows, key=lambda each: -float(each["share"]))[:_FOLLOWS]:
        share, channel = _within_one(float(each["share"])), each.get("channel")
        words = place_words(variable_words(str(each["variable"])))
        words += f", {channel}" if channel and channel != "all" else ""
        bars.append((words, percent(share), share, "share"))
    ticks = {tick: f"{100 * tick:.0f} %" for tick in (0.0, 0.25, 0.5, 0.75, 1.0)}
    return _bars(bars, ticks, "shares of the squared gap by what it follows")


def posterior_bar(diagnosis: Diagnosis) -> str:
    """The probabilities of the three answers, one bar each."""
    chances = diagnosis.posterior
    bars = [
        (words, chance(chances[name]), chances[name], "before" if name == "other" else "after")
        for name, words in ANSWERS.items()
    ]
    ticks = {tick: tick_label(tick) for tick in _FIFTHS}
    return _bars(bars, ticks, "probability of each of three answers")


def _bars(bars: Sequence[tuple[str, str, float, str]], ticks: Mapping[float, str], label: str) -> str:
    """Bars from 0 to 1, each below its words and its value, so that a narrow screen shows them whole.

    Args:
        bars: words, the value in words, the value, and its style.
    """
    drawing = Drawing(_NARROW, _BAR * len(bars) + 24, label)
    scale = Scale(0.0, 1.0, 14.0, _NARROW - 18.0)
    bottom = _BAR * len(bars) + 2
    for tick, words in ticks.items():
        drawing.line(scale.at(tick), 0, scale.at(tick), bottom, "grid")
        drawing.text(scale.at(tick), bottom + 15, words, "tick", "middle")
    for number, (words, told, value, css) in enumerate(bars):
        y = _BAR * number
        drawing.text(scale.start, y + 14, words, "name")
        drawing.text(scale.end, y + 14, told, "value", "end")
        drawing.rect(scale.start, y + 19, scale.at(_within_one(value)) - scale.start, 10, css)
    return str(drawing)


def _within_one(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def closed_bar(diagnosis: Diagnosis) -> str:
    """The share of the squared gap that is gone, with its interval."""
    drawing = Drawing(_NARROW, 76, f"share of the squared gap that closes: {closed_words(diagnosis)}")
    scale = Scale(0.0, 1.0, 14.0, _NARROW - 18.0)
    value = _within_one(diagnosis.closed.value or 0.0)
    drawing.text(scale.start, 14, f"{closed_words(diagnosis)} of the squared gap", "value")
    drawing.rect(scale.at(0), 28, scale.at(1) - scale.at(0), 20, "left")
    drawing.rect(scale.at(0), 28, scale.at(value) - scale.at(0), 20, "after")
    ends = diagnosis.closed.low, diagnosis.closed.high
    if ends[0] is not None and ends[1] is not None:
        low, high = (scale.at(_within_one(each)) for each in ends if each is not None)
        drawing.line(low, 38, high, 38, "interval")
        for end in (low, high):
            drawing.line(end, 31, end, 45, "interval")
    for tick in _FIFTHS:
        drawing.line(scale.at(tick), 48, scale.at(tick), 53, "axis")
        drawing.text(scale.at(tick), 66, f"{100 * tick:.0f} %", "tick", "middle")
    return str(drawing)


def shift_bars(rows: Sequence[tuple[str, float]]) -> str:
    """Shifts in standard deviations of named parameters, in the order given."""
    left = 170.0
    drawing = Drawing(480, 22.0 * len(rows) + 24, "shift of calibration parameters in standard deviations")
    reach = max(1.0, *(abs(sigmas) for _, sigmas in rows))
    scale = Scale(-reach, reach, left, 420)
    bottom = 22.0 * len(rows) + 2
    step = nice_step(reach / 2.5)
    for tick in (-step, 0.0, step):
        drawing.line(scale.at(tick), 0, scale.at(tick), bottom, "grid" if tick else "axis")
        drawing.text(scale.at(tick), bottom + 15, f"{tick_label(tick)}σ", "tick", "middle")
    for number, (name, sigmas) in enumerate(rows):
        y = 22.0 * number + 4
        drawing.text(left - 12, y + 11, name, "name", "end")
        start, end = sorted((scale.at(0.0), scale.at(sigmas)))
        drawing.rect(start, y, end - start, 14, "before")
        drawing.text(478, y + 11, f"{'−' if sigmas < 0.0 else '+'}{sigmas_words(sigmas)}", "value", "end")
    return str(drawing)
