"""The papers' own figures, drawn from the rig: Renk et al., Figures 3 and 4; Camps et al., Figures 4 to 7."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators import calibrate
from estimators.ellipsoid import EllipsoidFit, fit_ellipsoid
from estimators.known_angle.reported import NORMAL_95
from rig.arrays import Array
from scenarios.colours import BLACK, BLUE, GREY, VERMILLION
from scenarios.overlay import overlays
from scenarios.plots.style import new_figure, style
from scenarios.studies.error_summary import Cell, Summary, first_draw
from validation.paper.camps import readings, scenario_of, truth, tumbles
from validation.paper.figures_text import OneDraw
from validation.plots.camps_directions import projection_figure

#: Estimates are drawn within so many bounds at this number of samples and the next.
_HEIGHT: Final = 4.5
_FROM: Final = 1000
_WIRES: Final = 25


def growing_figure(summary: Summary, one_draw: pa.Table, remarks: Sequence[OneDraw]) -> Figure:
    """S1 and delta1 of one draw against the number of samples, on a linear axis as in print; Renk, Figures 3 and 4.

    Args:
        summary: of the consistency study. one_draw: rows of its table; draw 0 of the first n samples is drawn.
        remarks: what the text reads off the ends of the curves.
    """
    columns = [(method, factor) for method in ("separate", "simultaneous") for factor in (1.0, 10.0)]
    with style():
        figure = new_figure(13.2, 5.4)
        panels = figure.subplots(2, len(columns), squeeze=False)
        for row, parameter in zip(panels, ("sensitivity1", "offset1"), strict=True):
            for axis, (method, factor) in zip(row, columns, strict=True):
                cells = [
                    cell
                    for cell in summary.cells
                    if (cell.method, cell.noise_factor, cell.parameter, cell.order)
                    == (method, factor, parameter, "first")
                ]
                cells.sort(key=lambda cell: cell.count)
                own = [
                    each
                    for each in remarks
                    if (each.method, each.noise_factor, each.parameter) == (method, factor, parameter)
                ]
                _growing(axis, cells, one_draw, own)
        panels[1][0].legend(loc="lower right", fontsize=7)
    return figure


def _growing(axis: Axes, cells: Sequence[Cell], table: pa.Table, remarks: Sequence[OneDraw]) -> None:
    first, errors = cells[0], first_draw(table, cells)
    assert errors is not None  # the study has made them
    n = np.array([cell.count for cell in cells])
    bound = np.array([cell.bound for cell in cells])
    axis.fill_between(
        n,
        first.truth - NORMAL_95 * bound,
        first.truth + NORMAL_95 * bound,
        color=GREY,
        alpha=0.2,
        linewidth=0,
        label="±1.96 bounds",
    )
    axis.axhline(first.truth, color=BLACK, linewidth=0.8, label="truth")
    axis.plot(n, first.truth + errors, color=BLUE, marker="o", markersize=2.5, label="one draw, the first n")
    for remark in remarks:
        end = [remark.samples if remark.samples < n[-1] - 200 else n[-1] - 600, n[-1]]
        for sign in (-1.0, 1.0):
            label = "as near as the paper's from there on" if sign > 0.0 else None
            axis.plot(end, [first.truth + sign * remark.within] * 2, color=VERMILLION, linewidth=1.6, label=label)
    height = _HEIGHT * float(np.interp(_FROM, n, bound))
    axis.set_ylim(first.truth - height, first.truth + height)
    axis.set_xlim(0.0, 1.02 * n[-1])
    axis.ticklabel_format(axis="y", useOffset=False)
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    axis.set_xlabel("samples n")
    figure_number = "3" if first.method == "separate" else "4"
    symbol = "S₁" if first.parameter == "sensitivity1" else "δ₁"
    axis.set_title(f"Figure {figure_number}: {symbol} [{first.unit}], noise ×{first.noise_factor:g}", fontsize=9)


def coverage_of_tumble() -> Figure:
    """The magnetometer's directions on the sphere and by their angles; Camps, Figures 4 and 5."""
    run = scenario_of("magnetometer").simulate()
    return projection_figure(run.t, overlays(run, calibrate(run, method="ellipsoid"), None))


def ellipsoid_figure() -> Figure:
    """The readings with the ellipsoid that fits them, and corrected with the sphere; Camps, Figures 6 and 7."""
    with style():
        figure = new_figure(9.6, 8.6)
        for row, sensor in enumerate(("magnetometer", "accelerometer")):  # as in the paper
            volts = readings(sensor, 0, tumbles(sensor).noise)
            magnitude = truth(sensor)[2]
            fit = fit_ellipsoid(volts, magnitude, parameters=9, name=sensor)
            unit = "G" if sensor == "magnetometer" else "g"
            number = 6 if sensor == "magnetometer" else 7
            left: Any = figure.add_subplot(2, 2, 2 * row + 1, projection="3d")
            _cloud(left, volts, _surface(fit, raw=True), f"Figure {number}: {sensor}, raw [V]", "V")
            right: Any = figure.add_subplot(2, 2, 2 * row + 2, projection="3d")
            _cloud(
                right,
                fit.field_of(volts),
                _surface(fit, raw=False),
                f"corrected [{unit}], sphere of {magnitude:g}",
                "h",
            )
    return figure


def _surface(fit: EllipsoidFit, raw: bool) -> Array:
    """(k, k, 3) of the ellipsoid, or of the sphere that it stands for."""
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, _WIRES), np.linspace(0.0, 2.0 * np.pi, _WIRES))
    unit = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    sphere = fit.reference_magnitude * unit
    return np.asarray(sphere @ fit.gain.T + fit.offset if raw else sphere)


def _cloud(axis: Any, points: Array, surface: Array, title: str, symbol: str) -> None:
    axis.plot_wireframe(*np.moveaxis(surface, -1, 0), color=GREY, linewidth=0.35, alpha=0.7)
    axis.scatter(*points.T, s=5, color=BLUE, depthshade=False)
    middle = surface.reshape(-1, 3).mean(axis=0)
    half = 1.06 * float(np.abs(surface.reshape(-1, 3) - middle).max())
    for name, centre in zip("xyz", middle, strict=True):
        getattr(axis, f"set_{name}lim")(centre - half, centre + half)
        getattr(axis, f"set_{name}label")(f"{symbol}{name}", labelpad=-2)
        axis.locator_params(axis=name, nbins=5)
    axis.tick_params(labelsize=7, pad=0)
    axis.set_box_aspect((1.0, 1.0, 1.0), zoom=0.9)
    axis.set_title(title, fontsize=9)


def drawn_as_in_the_papers(summary: Summary, one_draw: pa.Table, remarks: Sequence[OneDraw]) -> Mapping[str, Figure]:
    """Name -> picture."""
    return {
        "growing": growing_figure(summary, one_draw, remarks),
        "coverage": coverage_of_tumble(),
        "ellipsoids": ellipsoid_figure(),
    }
