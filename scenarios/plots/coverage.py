"""From where the field has reached each sensor: maps of the sphere of directions in frame 6."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure, SubFigure

from estimators.coverage import coverage
from rig.arrays import Array
from rig.errors import RigError
from scenarios.colours import AXES_ON_PAPER, BLACK, ELAPSED
from scenarios.decimation import evenly
from scenarios.overlay import Overlay
from scenarios.plots.coverage_cells import on_map, outlines, unseen
from scenarios.plots.style import new_figure, style

#: Time gone by, as in the viewer.
ELAPSED_MAP: Final = LinearSegmentedColormap.from_list("elapsed", ELAPSED)

_POINTS = 20_000


def coverage_figure(t: Array, overlays: Mapping[str, Overlay]) -> Figure:
    """A Mollweide map (equal areas) for each sensor: the field's directions in frame 6, and both ends of each axis.

    Cells of equal area in which the field was never seen are shaded.

    Args:
        t: (n,) [s] of the recording.
        overlays: sensor -> its calibration laid over the recording.

    Raises:
        RigError: there are none.
    """
    if not overlays:
        raise RigError("nothing to map: expected a calibration of a recorded sensor")
    with style():
        figure = new_figure(6.4, 0.5 + 3.6 * len(overlays))
        panels = figure.subplots(len(overlays), 1, subplot_kw={"projection": "mollweide"}, squeeze=False)[:, 0]
        for panel, overlay in zip(panels, overlays.values(), strict=True):
            _map(panel, t, overlay)
        time_bar(figure, list(panels), t, 0.6)
    return figure


def time_span(t: Array) -> Normalize:
    """Times t (n,) [s] as shares of their span, for ``ELAPSED_MAP``."""
    return Normalize(float(t[0]), max(float(t[-1]), float(t[0]) + 1e-9))


def time_bar(figure: Figure | SubFigure, panels: list[Axes], t: Array, shrink: float, aspect: float = 40.0) -> None:
    """The colours of times t (n,) [s] below panels, so much narrower than these, and so many times as wide as high."""
    bar = ScalarMappable(time_span(t), ELAPSED_MAP)
    figure.colorbar(bar, ax=panels, location="bottom", shrink=shrink, aspect=aspect, label="time [s]")


def _map(axis: Axes, t: Array, overlay: Overlay) -> None:
    shown = evenly(len(t), _POINTS)
    azimuth, elevation = _angles(overlay.directions[shown])
    axis.scatter(azimuth, elevation, c=t[shown], cmap=ELAPSED_MAP, s=2.2, linewidths=0, rasterized=True)
    for number, vector in enumerate(overlay.axes, start=1):
        for sign, marker in ((1.0, "o"), (-1.0, "X")):
            at = _angles(sign * vector[None])
            axis.plot(
                *at,
                marker,
                color=AXES_ON_PAPER[number - 1],
                markersize=9,
                markeredgecolor="white",
                zorder=4,
                clip_on=False,
            )
            axis.annotate(
                f"{'+' if sign > 0 else '−'}{number}",
                (at[0][0], at[1][0]),
                xytext=(7, 5),
                textcoords="offset points",
                fontsize=9,
                fontweight="bold",
                color=BLACK,
            )
    seen = coverage(overlay.directions)
    shapes, _ = outlines(seen.cells, np.flatnonzero(seen.counts == 0))
    axis.add_collection(unseen(on_map(shapes)), autolim=False)
    axis.set_title(
        f"{overlay.field_name.capitalize()} in {overlay.frame_name}:"
        f" {100.0 * seen.share:.0f} % of {seen.cells.count} equal cells seen,\n"
        f"largest hole {2.0 * seen.hole_deg:.0f}° wide" + ("; shaded: missing" if len(shapes) else ""),
        pad=14,
    )
    label_map(axis)
    axis.set_xlabel("azimuth about z6" if overlay.field is not None else "azimuth about z")
    axis.set_ylabel("elevation above x6 y6" if overlay.field is not None else "elevation above x y")


def label_map(axis: Axes) -> None:
    """Ticks of azimuth and elevation on a Mollweide map."""
    axis.set_xticks(np.radians([-120, -60, 0, 60, 120]), ["−120°", "−60°", "0°", "60°", "120°"])
    for label in axis.get_xticklabels():  # on the equator, among the points
        label.set(fontsize=7, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6})
    axis.set_yticks(np.radians([-60, -30, 0, 30, 60]), ["−60°", "−30°", "0°", "30°", "60°"])


def _angles(directions: Array) -> tuple[Array, Array]:
    return np.arctan2(directions[:, 1], directions[:, 0]), np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))
