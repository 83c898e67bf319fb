"""The pictures of the page on the two papers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rig.channels import CHANNELS_OF, SENSORS
from scenarios.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from scenarios.plots.study_subsets import logarithmic
from scenarios.plots.style import new_figure, style
from scenarios.studies.coordinates import RADIAN_DEG
from validation.paper.camps import tumbles
from validation.paper.published import EllipsoidTable, ellipsoid_table, spread_table
from validation.paper.renk import on_spread, printed_bounds, ratio_limits
from validation.paper.renk_text import PublishedMisfit
from validation.paper.simulated import subsets


def scatter_figure() -> Figure:
    """Renk et al., Tables 7 and 12: standard deviations over 25 subsets, over the bound; published and the rig's."""
    with style():
        figure = new_figure(10.0, 4.9)
        for axis, (number, sensor) in zip(figure.subplots(1, 2), zip(("7", "12"), SENSORS, strict=True), strict=True):
            _scatter(axis, number, sensor)
        marks = [
            Line2D([], [], marker="o", color=BLUE, linestyle="none", markersize=5),
            Line2D([], [], marker="D", color=VERMILLION, linestyle="none", markersize=5),
            Line2D([], [], marker="|", color=BLACK, linestyle="none", markersize=9),
        ]
        labels = ["published, as the noise lets expect", "published, not so", "the rig's own 25 subsets"]
        figure.legend(marks, labels, loc="outside lower center", ncols=3)
    return figure


def _scatter(axis: Axes, number: str, sensor: str) -> None:
    table, bounds = spread_table(number), printed_bounds(sensor)
    simulated = {row.parameter: row.std for row in subsets(sensor).parameters}
    names = [name for name in table.std if np.isfinite(bounds[name])]
    low, high = ratio_limits(25)
    axis.axvspan(low, high, color=GREY, alpha=0.18, linewidth=0)
    axis.axvline(1.0, color=GREY, linewidth=0.8)
    values = []
    for place, name in enumerate(names):
        ratio = table.std[name].value / bounds[name]
        rig = simulated[name] / bounds[name]
        word, why = on_spread(ratio, name)
        colour = BLUE if word == "agrees" else VERMILLION
        axis.plot(ratio, -place, "o" if word == "agrees" else "D", color=colour, markersize=5.5)
        axis.plot(rig, -place, "|", color=BLACK, markersize=10, markeredgewidth=1.4)
        values += [ratio, rig]
        if "radians" in why:
            arrow = {"arrowstyle": "->", "color": GREEN, "linewidth": 1.1}
            axis.annotate("", (ratio * RADIAN_DEG, -place), (ratio, -place), arrowprops=arrow)
            axis.text(ratio * 1.35, -place + 0.12, "if in radians", color=GREEN, fontsize=7.5)
    logarithmic(axis, values)
    axis.set_yticks(-np.arange(len(names)), [name.removesuffix("_deg") for name in names])
    axis.set_xlabel("standard deviation of 25 subsets / Cramér-Rao bound")
    axis.set_title(f"Table {number}, {sensor}")
    axis.grid(axis="y", visible=False)


def misfit_figure(misfits: Sequence[PublishedMisfit]) -> Figure:
    """The published fit errors beside the noise and beside what the published scatter of 25 subsets tells of it."""
    with style():
        figure = new_figure(7.6, 3.5)
        axis = figure.subplots()
        for place, row in enumerate(misfits):
            axis.bar(place, 1e3 * row.fit_error, color=ORANGE, width=0.66, alpha=0.55)
            axis.plot([place - 0.33, place + 0.33], [1e3 * row.noise] * 2, color=BLACK, linestyle="--", linewidth=1.5)
            reach = [[1e3 * (row.noise_like - row.noise_low)], [1e3 * (row.noise_high - row.noise_like)]]
            axis.errorbar(place, 1e3 * row.noise_like, reach, fmt="o", color=BLUE, markersize=5, capsize=3)
            text = f"{row.share:.0%} noise-like" if row.share >= 0.01 else f"{row.share:.1%} noise-like"
            axis.text(place, 1.08e3 * max(row.fit_error, row.noise_high), text, ha="center", fontsize=7.5)
        axis.set_yscale("log")
        axis.set_ylim(4.0, 320.0)
        axis.set_yticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
        axis.minorticks_off()
        axis.set_xticks(range(len(misfits)), [CHANNELS_OF[row.sensor][row.channel] for row in misfits])
        axis.set_ylabel("mV")
        axis.set_title("Published fit errors, and how much of them is noise")
        axis.grid(axis="x", visible=False)
        marks = [
            Line2D([], [], marker="s", color=ORANGE, alpha=0.55, linestyle="none", markersize=9),
            Line2D([], [], color=BLACK, linestyle="--"),
            Line2D([], [], marker="o", color=BLUE, linestyle="none"),
        ]
        labels = ["fit error", "noise with the arm locked", "noise that the scatter of 25 subsets tells, 95 %"]
        axis.legend(marks, labels, loc="upper left", fontsize=7.5)
    return figure


def camps_figure() -> Figure:
    """Camps et al., Tables 1 to 4: the three tests less the rig's mean, in standard deviations of one of the rig's."""
    with style():
        figure = new_figure(10.0, 4.6)
        panels = figure.subplots(1, 4, width_ratios=[1, 1, 1, 1])
        for axis, number in zip(panels, ("1", "2", "3", "4"), strict=True):
            _tests(axis, ellipsoid_table(number))
    return figure


def _tests(axis: Axes, table: EllipsoidTable) -> None:
    many = tumbles(table.sensor)
    names = many.names[table.parameters]
    own = many.estimates[table.parameters]
    mean, std = own.mean(axis=0), own.std(axis=0)
    axis.axvspan(-1.96, 1.96, color=GREY, alpha=0.18, linewidth=0)
    limit = 9.0
    for place, (name, tests) in enumerate(table.rows.items()):
        column = names.index(name)
        for test, printed in enumerate(tests):
            value = (printed.value - mean[column]) / std[column]
            colour, marker = (BLUE, VERMILLION, GREEN)[test], "osD"[test]
            if abs(value) > limit:
                marker = "<" if value < 0.0 else ">"
            axis.plot(np.clip(value, -limit, limit), -place, marker, color=colour, markersize=4.5, clip_on=False)
    axis.set_xlim(-limit, limit)
    axis.set_yticks(-np.arange(len(table.rows)), list(table.rows))
    axis.set_ylim(-len(table.rows) + 0.3, 0.7)
    axis.set_xlabel("(test − rig's mean) / σ")
    axis.set_title(f"Table {table.number}, {table.sensor}", fontsize=8.5)
    axis.grid(axis="y", visible=False)
    if table.number == "1":
        pairs = zip("osD", (BLUE, VERMILLION, GREEN), strict=True)
        marks = [Line2D([], [], marker=mark, color=colour, linestyle="none") for mark, colour in pairs]
        axis.legend(marks, ["test 1", "test 2", "test 3"], loc="lower left", fontsize=7)
