"""Interleaved subsets: the scatter of their estimates beside the bound, and the fit error taken apart."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from scenarios.colours import BLACK, BLUE, GREY, ORANGE
from scenarios.parameter_names import shown_name
from scenarios.plots.style import in_words, judged_point, new_figure, parameter_rows, style
from scenarios.shown_units import shown_unit
from scenarios.studies.intervals import spread_interval
from scenarios.studies.subset_results import SubsetStudy

_TICKS: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)


def subsets_figure(study: SubsetStudy) -> Figure:
    """Left: standard deviation over bound, a panel a sensor; right: noise-like and systematic part of each channel.

    The grey band holds 95 % of the ratios if the noise of the bound is all there is.
    """
    sensors = list(dict.fromkeys(row.sensor for row in study.parameters))
    with style():
        most = max(sum(row.sensor == sensor for row in study.parameters) for sensor in sensors)
        figure = new_figure(4.2 * len(sensors) + 4.4, max(1.4 + 0.25 * most, 3.2))
        panels = figure.subplots(1, len(sensors) + 1, width_ratios=[1.0] * len(sensors) + [1.05])
        for axis, sensor in zip(panels, sensors, strict=False):
            _ratios(axis, study, sensor)
        _errors(panels[-1], study)
    return figure


def _ratios(axis: Axes, study: SubsetStudy, sensor: str) -> None:
    rows = [row for row in study.parameters if row.sensor == sensor]
    heights = parameter_rows(axis, [shown_name(row.parameter) for row in rows])
    low, high = spread_interval(study.subsets - 1)
    axis.axvspan(1.0 / high, 1.0 / low, color=GREY, alpha=0.18, linewidth=0)
    axis.axvline(1.0, color=GREY, linewidth=0.8)
    for row, height in zip(rows, heights, strict=True):
        if not np.isfinite(row.ratio):
            in_words(axis, 1.0, height, fontsize=7.5)
            continue
        inside = row.ratio_low <= 1.0 <= row.ratio_high
        judged_point(axis, height, row.ratio, (row.ratio_low, row.ratio_high), inside)
    logarithmic(axis, [value for row in rows for value in (row.ratio_low, row.ratio_high)])
    axis.set_xlabel("standard deviation / bound")
    axis.set_title(f"{sensor.capitalize()}: {study.subsets} subsets, {study.method} fits")


def logarithmic(axis: Axes, values: list[float]) -> None:
    """A logarithmic x axis with plain numbers that holds 1 and all finite values."""
    finite = [value for value in values if np.isfinite(value) and value > 0.0]
    low, high = 0.85 * min([0.6, *finite]), 1.15 * max([1.7, *finite])
    axis.set_xscale("log")
    axis.set_xlim(low, high)
    ticks = [tick for tick in _TICKS if low <= tick <= high]
    if len(ticks) > 8:
        ticks = [tick for tick in ticks if f"{tick:g}".strip("0.") in ("1", "2", "5")]
    axis.set_xticks(ticks)
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())


def _errors(axis: Axes, study: SubsetStudy) -> None:
    place = np.arange(len(study.channels), dtype=float)
    # Both parts' squares add to the fit error's, so bars of squares are stacked and labelled with their roots.
    share = np.array([row.share for row in study.channels])
    axis.bar(place, share, color=BLUE, width=0.65, label="noise-like")
    axis.bar(place, 1.0 - share, bottom=share, color=ORANGE, width=0.65, label="systematic")
    for x, row in zip(place, study.channels, strict=True):
        low, high = (min((level / row.fit_error) ** 2, 1.0) for level in (row.noise_low, row.noise_high))
        axis.plot([x, x], [low, high], color=BLACK, linewidth=1.0)
        if np.isfinite(row.floor):
            level = min((row.floor / row.fit_error) ** 2, 1.0)
            known = "noise with the arm locked" if study.noise_source == "locked recording" else "noise as given"
            axis.plot([x - 0.33, x + 0.33], [level] * 2, color=BLACK, linewidth=1.4, linestyle="--", label=known)
    shown = [(row, shown_unit(row.unit)) for row in study.channels]
    labels = [f"{row.channel}\n{unit.factor * row.fit_error:.3g} {unit.name}" for row, unit in shown]
    axis.set_xticks(place, labels)
    axis.set_ylim(0.0, 1.25)
    axis.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    axis.set_title("What the fit error is made of (of its square)")
    handles, names = axis.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    axis.legend(list(unique.values()), list(unique), loc="upper center", ncols=3, fontsize=7)
    axis.grid(axis="x", visible=False)
