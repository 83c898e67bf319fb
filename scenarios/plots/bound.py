"""What a maneuver can tell: how its Cramer-Rao bound falls minute by minute, and which effects it tells apart."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from estimators.design.isolability import SEEN
from estimators.design.maneuver_bound import Growth
from rig.arrays import Array
from scenarios.bound import ScenarioBound, SensorBound
from scenarios.colours import AXES_ON_PAPER, BLUE, GREY, PURPLE, SKY_BLUE
from scenarios.isolability import EffectsBound
from scenarios.plots.style import in_words, new_figure, style
from scenarios.terminal.bound import names

_FREE_LABELS: Final = ("A11", "A22", "A33", "A12", "A13", "A23")


def bound_figure(bound: ScenarioBound) -> Figure:
    """A column for each sensor: standard deviations against the time from the start, and what each interval pays.

    The dashed lines fall with the square root of time: a maneuver whose minutes are all worth the same follows them.
    """
    with style():
        rows = 5 if bound.attitude else 3
        title = f"{bound.scenario}: what the maneuver can tell (Cramér-Rao bound)"
        figure = new_figure(4.9 * len(bound.sensors), 1.75 * rows + 0.4, title)
        panels = figure.subplots(rows, len(bound.sensors), sharex=True, squeeze=False)
        for column, (name, sensor) in enumerate(bound.sensors.items()):
            own = panels[:, column]
            for panel, (label, values, labels) in zip(own, _series(sensor), strict=False):
                _falling(panel, bound.time_s / 60.0, values, labels)
                panel.set_ylabel(label)
            own[0].set_title(f"{name.capitalize()}, {sensor.prediction.samples:,} samples")
            _paying(own[-1], bound.time_s / 60.0, sensor.growth.share)
            own[-1].set_xlabel("time from the start [min]")
            own[-1].set_xlim(left=0.0)
    return figure


def _series(sensor: SensorBound) -> list[tuple[str, Array, tuple[str, ...]]]:
    """Label, values (b, k) and the k names of each panel."""
    grown = sensor.growth
    axes = ("axis 1", "axis 2", "axis 3")
    if not isinstance(grown, Growth):
        return [
            ("std of the gain A\n[% of the largest]", 100.0 * grown.gain, _FREE_LABELS[: grown.gain.shape[1]]),
            ("std of offset\n[mV]", 1e3 * grown.offset, axes),
        ]
    fields = ("field",) if grown.field_deg.shape[1] == 1 else tuple(f"field of {axis}" for axis in axes)
    return [
        ("std of S [%]", 100.0 * grown.sensitivity, axes),
        ("std of δ [mV]", 1e3 * grown.offset, axes),
        ("RMS angle of axes\n[deg]", grown.axis_deg, axes),
        ("RMS angle of field\n[deg]", grown.field_deg, fields),
    ]


def _falling(panel: Axes, minutes: Array, values: Array, labels: tuple[str, ...]) -> None:
    for index, (series, label) in enumerate(zip(values.T, labels, strict=True)):
        colour = PURPLE if len(labels) == 1 else AXES_ON_PAPER[index % 3]
        panel.plot(minutes, series, ":" if index > 2 else "-", color=colour, marker="o", markersize=2.2, label=label)
    if np.isfinite(values[-1]).all():
        panel.plot(minutes, values[-1].max() * np.sqrt(minutes[-1] / minutes), "--", color=GREY, linewidth=0.8)
    if np.isfinite(values).any():
        panel.set_yscale("log")
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter(NullFormatter())
    else:
        in_words(panel, 0.5, 0.5, transform=panel.transAxes)
    panel.legend(loc="upper right", ncols=min(len(labels), 3))


def _paying(panel: Axes, minutes: Array, share: Array) -> None:
    """Bars over the intervals; the dashed line is what each would pay if all paid alike."""
    starts = np.concatenate([[0.0], minutes[:-1]])
    if np.isfinite(share).all():
        panel.bar(
            starts, 100.0 * share, width=minutes - starts, align="edge", color=SKY_BLUE, edgecolor="white", lw=0.4
        )
        panel.stairs(100.0 * (minutes - starts) / minutes[-1], np.append(0.0, minutes), color=GREY, ls="--", lw=0.8)
    else:
        in_words(panel, 0.5, 0.5, "something stays open", transform=panel.transAxes)
    panel.set_ylabel("share of what is\nlearned [%]")
    panel.yaxis.set_major_locator(MaxNLocator(4))


#: Bounds of the classes [σ], and their colours: from not at all to well.
_BOUNDS: Final = (0.0, 1.0, 5.0, 10.0, 30.0, 1e9)
_COLOURS: Final = ("#7A1F00", "#D55E00", "#F6D8B8", "#A9CDE6", "#0072B2")
_LABELS: Final = ("below 1", "1-5", "5-10", "10-30", "above 30")


def isolability_figure(found: EffectsBound) -> Figure:
    """Rows are the truth, columns what explains it instead; seen effects only."""
    here = found.here
    shown = np.flatnonzero(here.visible)
    labels = [names([here.effects[place]], found.names) for place in shown]
    side = max(4.5, 0.145 * len(shown))
    with style():
        figure = new_figure(side + 4.2, side + 2.6)
        if not len(shown):
            figure.text(0.5, 0.5, "no effect of typical size is seen", ha="center")
            return figure
        left, right = figure.subplots(1, 2, width_ratios=[1.1, side], sharey=True)
        left.barh(np.arange(len(shown)), here.seen[shown], color=BLUE, height=0.7)
        left.axvline(SEEN, color=GREY, linewidth=0.8)
        left.set_xscale("log")
        left.set_xlabel("seen [σ]")
        left.set_yticks(range(len(shown)), labels, fontsize=6.5)
        left.grid(axis="y", visible=False)
        matrix = here.apart[np.ix_(shown, shown)].copy()
        np.fill_diagonal(matrix, np.nan)
        colours = ListedColormap(list(_COLOURS)).with_extremes(bad="#FFFFFF")
        image = right.imshow(matrix, cmap=colours, norm=BoundaryNorm(_BOUNDS, len(_COLOURS)), aspect="auto")
        right.set_xticks(range(len(shown)), labels, fontsize=6.5, rotation=90)
        right.set_xlabel("explained by")
        right.grid(visible=False)
        right.set_title(f"{found.scenario}: what is left of each effect (rows) beside another (columns)")
        bar = figure.colorbar(image, ax=right, shrink=0.5, pad=0.01)
        bar.set_ticks([0.5, 3.0, 7.5, 20.0, 0.5e9], labels=list(_LABELS))
        bar.set_label("left [σ]")
    return figure
