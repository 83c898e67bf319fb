"""The field's directions by their angles theta and phi: Camps (3), Figures 4 and 5."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from estimators.coverage import coverage
from rig.arrays import Array
from rig.errors import RigError
from scenarios.colours import BLACK, GREY, VERMILLION
from scenarios.decimation import evenly
from scenarios.overlay import Overlay
from scenarios.plots.coverage import ELAPSED_MAP, outlines, time_bar, time_span, unseen
from scenarios.plots.style import new_figure, style

_POINTS = 20_000
_ON_SPHERE = 1_500


def projection_figure(t: Array, overlays: Mapping[str, Overlay]) -> Figure:
    """A row for each sensor: the directions on the sphere, and their angles theta over phi; what is shaded is missing.

    theta is that of Camps (3) as written: from 0 at the +z pole to 90 degrees at the equator, and from -90 degrees at
    the equator to 0 at the -z pole. The shaded cells are of equal area on the sphere.

    Args:
        t: (n,) [s] of the recording.
        overlays: sensor -> its calibration laid over the recording.

    Raises:
        RigError: there are none.
    """
    if not overlays:
        raise RigError("nothing to project: expected a calibration of a recorded sensor")
    with style():
        figure = new_figure(9.6, 0.7 + 3.3 * len(overlays))
        grid = figure.add_gridspec(len(overlays), 2, width_ratios=(1.0, 2.1))
        span = time_span(t)
        panels: list[Axes] = []
        for row, overlay in enumerate(overlays.values()):
            _sphere(figure.add_subplot(grid[row, 0], projection="3d"), t, overlay, span)
            panels.append(figure.add_subplot(grid[row, 1]))
            _angles(panels[-1], t, overlay, span)
        time_bar(figure, panels, t, 0.5)
    return figure


def _sphere(axis: Any, t: Array, overlay: Overlay, span: Normalize) -> None:
    """The sphere with its angles as Camps, Figure 4, draws them, at the direction seen first."""
    shown = evenly(len(t), _ON_SPHERE)
    points = overlay.directions[shown]
    axis.scatter(*points.T, c=t[shown], norm=span, cmap=ELAPSED_MAP, s=3, linewidths=0, alpha=0.8, rasterized=True)
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    axis.plot(np.cos(turn), np.sin(turn), 0.0 * turn, color=GREY, linewidth=0.7)
    for number, name in enumerate("xyz"):
        end = np.eye(3)[number] * 1.35
        axis.plot(*np.stack([0.0 * end, end], axis=1), color=BLACK, linewidth=0.9)
        axis.text(*(end * 1.08), f"${name}$", fontsize=9, ha="center", va="center")
    first = overlay.directions[0]
    polar, azimuth = float(np.arccos(np.clip(first[2], -1.0, 1.0))), float(np.arctan2(first[1], first[0]))
    axis.plot(*np.stack([np.zeros(3), first], axis=1), color=VERMILLION, linewidth=1.6)
    down = np.linspace(0.0, polar, 30)
    meridian = np.stack([np.sin(down) * np.cos(azimuth), np.sin(down) * np.sin(azimuth), np.cos(down)])
    around = np.linspace(0.0, azimuth, 30)
    axis.plot(*(0.45 * meridian), color=VERMILLION, linewidth=1.0)
    axis.plot(0.45 * np.cos(around), 0.45 * np.sin(around), 0.0 * around, color=VERMILLION, linewidth=1.0)
    axis.text(*(0.62 * meridian[:, 15]), r"$\theta$", color=VERMILLION, fontsize=10, ha="center", va="center")
    middle = 0.5 * azimuth
    axis.text(
        0.64 * np.cos(middle), 0.64 * np.sin(middle), 0.0, r"$\varphi$", color=VERMILLION, fontsize=10, ha="center"
    )
    axis.set_box_aspect((1.0, 1.0, 1.0), zoom=1.35)
    axis.set_axis_off()
    axis.view_init(elev=24.0, azim=35.0)
    axis.set_title(f"{overlay.field_name.capitalize()} in {overlay.frame_name}")


def _angles(axis: Axes, t: Array, overlay: Overlay, span: Normalize) -> None:
    seen = coverage(overlay.directions)
    empty = np.flatnonzero(seen.counts == 0)
    polygons, _ = outlines(seen.cells, empty)
    axis.add_collection(unseen([_as_angles(shape) for shape in polygons]), autolim=False)
    shown = evenly(len(t), _POINTS)
    _, theta, phi = spherical(overlay.directions[shown])
    axis.scatter(
        np.degrees(phi),
        np.degrees(theta),
        c=t[shown],
        norm=span,
        cmap=ELAPSED_MAP,
        s=2.2,
        linewidths=0,
        rasterized=True,
    )
    axis.set(xlim=(-180.0, 180.0), ylim=(-90.0, 90.0))
    axis.set_xticks(np.arange(-180, 181, 60), [f"{value}°".replace("-", "−") for value in range(-180, 181, 60)])
    axis.set_yticks(np.arange(-90, 91, 30), [f"{value}°".replace("-", "−") for value in range(-90, 91, 30)])
    axis.axhline(0.0, color=BLACK, linewidth=0.6)
    axis.set_xlabel(r"$\varphi$")
    axis.set_ylabel(r"$\theta$")
    right = axis.secondary_yaxis("right")
    right.set_yticks([-90, -2, 2, 90], ["equator", "", "", "equator"])
    right.tick_params(length=0)
    axis.annotate("+z pole", (1.0, 0.5), (6, 5), xycoords="axes fraction", textcoords="offset points", fontsize=8)
    axis.annotate("−z pole", (1.0, 0.5), (6, -11), xycoords="axes fraction", textcoords="offset points", fontsize=8)
    share = f"{100.0 * seen.share:.0f} % of {seen.cells.count} cells of equal area seen"
    axis.set_title(share + ("; shaded: missing" if len(empty) else ""))


def _as_angles(polygon: Array) -> Array:
    """Camps (3) [deg] of a cell, which lies on one side of the equator: phi, theta."""
    theta = np.degrees(np.arccos(np.clip(polygon[:, 1], -1.0, 1.0)))
    below = float(polygon[:, 1].mean()) < 0.0
    return np.stack([np.degrees(polygon[:, 0]), theta - 180.0 if below else theta], axis=1)


def spherical(vectors: ArrayLike) -> tuple[Array, Array, Array]:
    """Magnitude, theta and phi, Camps (3), as written there: theta = arctan(sqrt(hx^2 + hy^2) / hz).

    So theta lies in (-pi/2, pi/2]: from 0 at the +z pole up to pi/2 at the equator, then from -pi/2 at the equator up
    to 0 at the -z pole. phi is the full azimuth in (-pi, pi], of which the quotient alone would know half.

    Args:
        vectors: (n, 3).

    Returns:
        (n,) magnitude, in the unit of the vectors; (n,) theta and (n,) phi [rad].
    """
    x, y, z = np.asarray(vectors, dtype=float).T
    across = np.hypot(x, y)
    theta = np.arctan2(across, z)
    return np.hypot(across, z), np.where(theta > 0.5 * np.pi, theta - np.pi, theta), np.arctan2(y, x)
