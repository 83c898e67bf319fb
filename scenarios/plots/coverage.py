"""From where the field has reached each sensor: maps of the sphere of directions in frame 6."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure, SubFigure

from estimators.coverage import SphereCells, coverage
from rig.arrays import Array
from rig.errors import RigError
from scenarios.colours import AXES_ON_PAPER, BLACK, ELAPSED, GREY
from scenarios.decimation import evenly
from scenarios.overlay import Overlay
from scenarios.plots.style import new_figure, style

_STEP: Final = np.radians(4.0)  # of a polygon's edge, which is curved on the map
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


def outlines(cells: SphereCells, numbers: Iterable[int]) -> tuple[list[Array], list[int]]:
    """Cells as polygons in azimuth, from -pi to pi, and z; one that lies across +-pi is two.

    Args:
        cells: the partition.
        numbers: of the cells wanted.

    Returns:
        Polygons (m, 2) of azimuth [rad] and z, and the number of the cell of each.
    """
    polygons: list[Array] = []
    owners: list[int] = []
    for number in numbers:
        low, high, begin, end = cells.limits(int(number))
        for first, last in _wrapped(begin, end):
            along = np.linspace(first, last, max(2, int(np.ceil((last - first) / _STEP)) + 1))
            up = np.sin(np.linspace(np.arcsin(low), np.arcsin(high), max(2, int(np.ceil((high - low) / _STEP)) + 1)))
            polygons.append(
                np.concatenate(
                    [
                        np.stack([along, np.full_like(along, low)], axis=1),
                        np.stack([np.full_like(up, last), up], axis=1),
                        np.stack([along[::-1], np.full_like(along, high)], axis=1),
                        np.stack([np.full_like(up, first), up[::-1]], axis=1),
                    ]
                )
            )
            owners.append(int(number))
    return polygons, owners


def on_map(polygons: Iterable[Array]) -> list[Array]:
    """From azimuth and z to azimuth and elevation [rad]."""
    return [np.stack([shape[:, 0], np.arcsin(np.clip(shape[:, 1], -1.0, 1.0))], axis=1) for shape in polygons]


def unseen(shapes: list[Array]) -> PolyCollection:
    """The shading of cells that nothing was seen in."""
    return PolyCollection(shapes, facecolor=GREY, edgecolor="white", linewidth=0.4, alpha=0.35, zorder=0.5)


def _wrapped(begin: float, end: float) -> list[tuple[float, float]]:
    """An interval of azimuth within 0 to 2 pi as one or two within -pi to pi."""
    if end <= np.pi + 1e-12:
        return [(begin, min(end, np.pi))]
    if begin >= np.pi - 1e-12:
        return [(begin - 2.0 * np.pi, end - 2.0 * np.pi)]
    return [(begin, np.pi), (-np.pi, end - 2.0 * np.pi)]
