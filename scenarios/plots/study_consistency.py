"""Figures 3 and 4 of Renk et al. for thousands of draws: estimates, RMSE and bound against the number of samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from estimators.known_angle.reported import NORMAL_95
from rig.arrays import Array
from rig.errors import RigError, check_name
from scenarios.colours import BLACK, BLUE, GREY, ORDERS, VERMILLION
from scenarios.parameter_names import shown_name
from scenarios.plots.style import new_figure, style
from scenarios.studies.error_summary import Cell, Summary, first_draw

_ORDER_NAMES: Final = {"first": "first n", "every-kth": "every k-th", "random": "random"}
#: Estimates are drawn within so many bounds of the sample count in the middle.
_HEIGHT: Final = 5.0


def consistency_figure(
    summary: Summary,
    sensor: str,
    method: str,
    parameters: Sequence[str] = ("sensitivity1", "offset1"),
    one_draw: pa.Table | None = None,
) -> Figure:
    """A row for each parameter: estimates at each noise level, RMSE beside the bound, and their ratio.

    Args:
        summary: of a study.
        sensor, method: which fits.
        parameters: of ``Cell.parameter``.
        one_draw: rows of the study's table; draw 0 in the order of the estimates is drawn, as the paper does.

    Raises:
        RigError: nothing of the kind in the summary.
    """
    cells = [cell for cell in summary.cells if cell.sensor == sensor and cell.method == method]
    if not cells:
        raise RigError(f"study: found no {method} fits of the {sensor}, expected some")
    names = list(dict.fromkeys(cell.parameter for cell in cells))
    for parameter in parameters:
        check_name("parameter", parameter, names)
    levels = sorted({cell.noise_factor for cell in cells})
    orders = list(dict.fromkeys(cell.order for cell in cells))
    with style():
        columns = len(levels) + 2
        title = (
            f"{sensor.capitalize()}, {method} fit, {cells[0].draws:,} draws; estimates of the {_ORDER_NAMES[orders[0]]}"
            " samples, ratios with 95 % intervals"
        )
        figure = new_figure(3.5 * columns, 2.8 * len(parameters) + 0.5, title)
        panels = figure.subplots(len(parameters), columns, squeeze=False)
        for number, (row, parameter) in enumerate(zip(panels, parameters, strict=True)):
            own = [cell for cell in cells if cell.parameter == parameter]
            for axis, level in zip(row, levels, strict=False):
                shown = _of(own, level, orders[0])
                _estimates(axis, shown, first_draw(one_draw, shown))
                if number == 0 and level == levels[0]:
                    axis.legend(loc="upper right", fontsize=6.5)
            _rmse(row[-2], own, levels, orders)
            _ratio(row[-1], own, levels, orders)
    return figure


def _of(cells: Iterable[Cell], level: float, order: str) -> list[Cell]:
    found = [cell for cell in cells if cell.noise_factor == level and cell.order == order]
    return sorted(found, key=lambda cell: cell.count)


def _estimates(axis: Axes, cells: Sequence[Cell], one: Array | None) -> None:
    n = np.array([cell.count for cell in cells])
    truth = np.array([cell.truth for cell in cells])
    bound = np.array([cell.bound for cell in cells])
    low, high = truth - NORMAL_95 * bound, truth + NORMAL_95 * bound
    axis.fill_between(n, low, high, color=GREY, alpha=0.2, linewidth=0, label="±1.96 bounds")
    axis.plot(n, truth, color=BLACK, linewidth=0.7, label="truth")
    if one is not None:
        axis.plot(n, truth + one, color=BLUE, linewidth=1.1, label="one draw")
    bias = np.array([cell.bias for cell in cells])
    std = np.array([cell.bias_std for cell in cells])
    axis.errorbar(
        n,
        truth + bias,
        3.5 * std,
        fmt="o",
        color=VERMILLION,
        markersize=2.5,
        elinewidth=0.9,
        label="mean of all, ±3.5 standard errors",
    )
    cell = cells[0]
    middle = float(bound[len(bound) // 2])
    axis.set_ylim(cell.truth - _HEIGHT * middle, cell.truth + _HEIGHT * middle)
    axis.set_title(f"{shown_name(cell.parameter)} [{cell.unit}], noise ×{cell.noise_factor:g}")
    axis.ticklabel_format(axis="y", useOffset=False)
    _samples(axis, n)


def _rmse(axis: Axes, cells: Sequence[Cell], levels: Sequence[float], orders: Sequence[str]) -> None:
    for order in orders:
        for level in levels:
            shown = _of(cells, level, order)
            n = [cell.count for cell in shown]
            colour, marker = ORDERS[order], "o" if level == levels[0] else "s"
            axis.plot(n, [cell.bound for cell in shown], color=colour, linewidth=0.9)
            face = "none" if order == "random" else colour  # it lies on top of every k-th
            points = [cell.rmse for cell in shown]
            axis.plot(n, points, marker, color=colour, markerfacecolor=face, markersize=3.2, linestyle="none")
    axis.set_xscale("log")
    axis.set_yscale("log")
    finite = [cell.bound for cell in cells if np.isfinite(cell.bound)]
    axis.set_ylim(0.5 * min(finite), min(2.0 * max(finite), 3e3 * min(finite)))
    axis.set_title(f"RMSE (points) and bound (lines) [{cells[0].unit}]")
    _samples(axis, np.array([cell.count for cell in cells]))
    lines = [Line2D([], [], color=ORDERS[order]) for order in orders]
    labels = [_ORDER_NAMES[order] for order in orders]
    marks = ["os"[min(k, 1)] for k in range(len(levels))]
    lines += [Line2D([], [], color=GREY, marker=mark, linestyle="none", markersize=3) for mark in marks]
    labels += [f"noise ×{level:g}" for level in levels]
    axis.legend(lines, labels, loc="upper right", fontsize=6.5)


def _ratio(axis: Axes, cells: Sequence[Cell], levels: Sequence[float], orders: Sequence[str]) -> None:
    """Cells of small bound only: the points of one n stand side by side."""
    series = [(order, level) for order in orders for level in levels]
    low, high = 1.0, 1.0
    for place, (order, level) in enumerate(series):
        shown = [cell for cell in _of(cells, level, order) if cell.small]
        if not shown:
            continue
        shift = 1.0 + 0.012 * (place - 0.5 * (len(series) - 1))
        ratio = np.array([cell.ratio for cell in shown])
        reach = np.array([[cell.ratio - cell.ratio_low, cell.ratio_high - cell.ratio] for cell in shown]).T
        axis.errorbar(
            shift * np.array([cell.count for cell in shown]),
            ratio,
            reach,
            fmt="o" if level == levels[0] else "s",
            color=ORDERS[order],
            markersize=2.2,
            elinewidth=0.6,
        )
        low, high = min(low, float((ratio - reach[0]).min())), max(high, float((ratio + reach[1]).max()))
    axis.axhline(1.0, color=BLACK, linewidth=0.7)
    half = 1.1 * max(high - 1.0, 1.0 - low, 0.02)
    axis.set_ylim(1.0 - half, 1.0 + half)
    axis.set_title("RMSE / bound, where the bound is small")
    _samples(axis, np.array([cell.count for cell in cells]))


def _samples(axis: Axes, counts: NDArray[np.int_]) -> None:
    axis.set_xscale("log")
    axis.set_xlim(0.9 * counts.min(), 1.1 * counts.max())
    ticks = [n for n in (10, 30, 100, 300, 1000, 3000, 10_000, 30_000, 100_000) if counts.min() <= n <= counts.max()]
    axis.set_xticks(ticks)
    axis.xaxis.set_major_formatter("{x:,.0f}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel("samples n")
