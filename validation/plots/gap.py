"""The picture of the page on the paper's gap: fit errors and scatter, published and of the rig that is to be alike."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.channels import SENSORS
from scenarios.colours import BLACK, BLUE, GREY, ORANGE, VERMILLION
from scenarios.plots.style import new_figure, style
from scenarios.studies.subset_results import SubsetStudy
from validation.paper.renk import spread_limits
from validation.paper.renk_text import misfits
from validation.paper.twin import spread_ratios


def gap_figure(found: SubsetStudy) -> Figure:
    """Left the fit errors with their noise-like part, right the rig's scatter over the published one."""
    with style():
        figure = new_figure(10.0, 5.2)
        left, right = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
        _errors(left, found)
        _spreads(right, found)
    return figure


def _errors(axis: Axes, found: SubsetStudy) -> None:
    published = [row for sensor in SENSORS for row in misfits(sensor)]
    for place, (paper, rig) in enumerate(zip(published, found.channels, strict=True)):
        axis.plot([place - 0.36, place + 0.36], [1e3 * paper.noise] * 2, color=BLACK, linestyle="--", linewidth=1.2)
        for shift, colour, row in ((-0.19, ORANGE, paper), (0.19, BLUE, rig)):
            axis.bar(place + shift, 1e3 * row.fit_error, width=0.34, color=colour, alpha=0.45)
            reach = [[1e3 * (row.noise_like - row.noise_low)], [1e3 * (row.noise_high - row.noise_like)]]
            axis.errorbar(place + shift, 1e3 * row.noise_like, reach, fmt="o", color=colour, markersize=4.5, capsize=3)
    axis.set_yscale("log")
    axis.set_ylim(5.0, 400.0)
    axis.set_yticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
    axis.minorticks_off()
    axis.set_xticks(range(len(published)), [rig.channel for rig in found.channels])
    axis.set_ylabel("mV")
    axis.set_title("Fit errors (bars) and their noise-like part (points, 95 %)")
    axis.grid(axis="x", visible=False)
    axis.plot([], [], "s", color=ORANGE, alpha=0.6, label="published")
    axis.plot([], [], "s", color=BLUE, alpha=0.6, label="the rig's")
    axis.plot([], [], "--", color=BLACK, label="noise, arm locked")
    axis.legend(loc="upper left", fontsize=8)


def _spreads(axis: Axes, found: SubsetStudy) -> None:
    low, high = spread_limits()
    ratios = spread_ratios(found)
    axis.axvspan(low, high, color=GREY, alpha=0.18, linewidth=0)
    axis.axvline(1.0, color=GREY, linewidth=0.8)
    labels = []
    for place, ((table, name), ratio) in enumerate(ratios.items()):
        inside = low <= ratio <= high
        axis.plot(ratio, -place, "o" if inside else "D", color=BLUE if inside else VERMILLION, markersize=5)
        labels.append(f"{name.removesuffix('_deg')} ({table})")
    axis.set_xscale("log")
    axis.set_xticks([0.25, 0.5, 1.0, 2.0], ["1/4", "1/2", "1", "2"])
    axis.minorticks_off()
    axis.set_xlim(0.2, 3.0)
    axis.set_yticks(-np.arange(len(labels)), labels, fontsize=6.5)
    axis.set_ylim(-len(labels) + 0.4, 0.6)
    axis.set_xlabel("scatter of 25 subsets, the rig's over the published (table)")
    axis.set_title("Shaded: 95 % of such ratios, were both alike")
    axis.grid(axis="y", visible=False)
