"""Residuals by the direction of the field, on maps of the sphere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from estimators.goodness import ByDirection, Goodness
from rig.errors import RigError
from scenarios.colours import BLUE, GREY, ORANGE, SKY_BLUE, VERMILLION
from scenarios.plots.coverage import label_map
from scenarios.plots.coverage_cells import on_map, outlines
from scenarios.plots.style import new_figure, style

#: As ``scenarios.colours.signed``.
SIGNED_MAP: Final = LinearSegmentedColormap.from_list("signed", (BLUE, SKY_BLUE, "#F2F2F2", ORANGE, VERMILLION))
#: The scale ends here at least: of some hundreds of cells one is beyond it by chance.
LEAST_LIMIT: Final = 4.0


def residual_map_figure(goodness: Mapping[str, Goodness]) -> Figure:
    """A row for each sensor, a map for each of its channels: the mean residual in each cell, in its standard errors.

    In a calibration that misses nothing they are noise: one in twenty beyond two, and no pattern. Cells without
    readings are hatched.

    Args:
        goodness: sensor -> what ``estimators.goodness.is_it_good`` found.

    Raises:
        RigError: no sensor has enough readings.
    """
    rows = {sensor: found.by_direction for sensor, found in goodness.items() if found.by_direction is not None}
    if not rows:
        raise RigError("nothing to map: found no sensor, expected one with 24 readings or more")
    most = max(len(found.names) for found in rows.values())
    limit = max(LEAST_LIMIT, *(float(np.nanmax(np.abs(found.score))) for found in rows.values()))
    with style():
        figure = new_figure(3.9 * most + 0.4, 1.0 + 2.5 * len(rows))
        grid = figure.add_gridspec(len(rows), most)
        panels: list[Axes] = []
        for row, (sensor, found) in enumerate(rows.items()):
            for column, name in enumerate(found.names):
                panel = figure.add_subplot(grid[row, column], projection="mollweide")
                _map(panel, found, column, limit)
                panel.set_title(_title(sensor, name, found, column), pad=12)
                panels.append(panel)
        figure.colorbar(
            ScalarMappable(Normalize(-limit, limit), SIGNED_MAP),
            ax=panels,
            location="bottom",
            shrink=0.6,
            aspect=45,
            label="mean residual of a cell, in its standard errors",
        )
    return figure


def _map(axis: Axes, found: ByDirection, column: int, limit: float) -> None:
    filled = np.flatnonzero(found.counts > 0)
    shapes, owners = outlines(found.cells, filled)
    axis.add_collection(
        PolyCollection(
            on_map(shapes),
            array=found.score[owners, column],
            cmap=SIGNED_MAP,
            norm=Normalize(-limit, limit),
            edgecolor="face",
            linewidth=0.3,
        ),
        autolim=False,
    )
    empty, _ = outlines(found.cells, np.flatnonzero(found.counts == 0))
    if empty:
        axis.add_collection(
            PolyCollection(on_map(empty), facecolor="none", edgecolor=GREY, linewidth=0.0, hatch="/////", alpha=0.5),
            autolim=False,
        )
    axis.grid(visible=False)
    axis.set_axisbelow(False)  # the labels on the equator
    label_map(axis)


def _title(sensor: str, name: str, found: ByDirection, column: int) -> str:
    score = found.score[:, column]
    rms = float(np.sqrt(np.nanmean(np.square(score))))
    label = f"{sensor}: {name}" if column == 0 and len(found.names) > 1 else name.replace("_", ": ")
    tail = f"; all: p = {found.p_value:.2g}" if column == 0 else ""
    return f"{label}, RMS {rms:.2f}{tail}"
