"""The angles of an axis and of a field, drawn: elevation beta or phi, azimuth gamma or psi."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from rig.arrays import Array
from rig.directions import direction_from_angles
from scenarios.colours import AXES_ON_PAPER
from scenarios.plots.style import new_figure, style

_AZIMUTH_DEG: Final = 55.0
_ELEVATION_DEG: Final = -38.0
_VIEW: Final = (np.radians(25.0), np.radians(20.0))  # of the eye: azimuth from the x axis, height


def angles_figure() -> Figure:
    """Two drawings beside each other: an axis of a sensor in the tool frame, a field in the base frame.

    Both are drawn with an elevation below zero, which points up: +90 deg is along -z.
    """
    with style():
        figure = new_figure(8.0, 3.9)
        for column, (name, elevation, azimuth, frame) in enumerate(
            (("P", "β", "γ", "tool frame"), ("f", "φ", "ψ", "base frame")), start=1
        ):
            axes = figure.add_subplot(1, 2, column)
            what = "an axis P of a sensor" if name == "P" else "a field f (gravity, magnetic)"
            axes.set_title(f"{what}, in the {frame}")
            _draw(axes, name, elevation, azimuth)
    return figure


def _seen(points: Array) -> Array:
    """(n, 2) of points (n, 3), looked at from ``_VIEW``."""
    around, height = _VIEW
    right = np.array([-np.sin(around), np.cos(around), 0.0])
    up = np.array([-np.sin(height) * np.cos(around), -np.sin(height) * np.sin(around), np.cos(height)])
    return np.asarray(points @ np.stack([right, up], axis=1))


def _draw(axes: Any, name: str, elevation: str, azimuth: str) -> None:
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-0.75, 1.3)
    axes.set_ylim(-0.75, 1.3)
    for letter, end in zip("xyz", np.eye(3), strict=True):
        tip = _seen(1.15 * end[None])[0]
        axes.annotate("", tip, (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": "#555555"})
        axes.text(*(1.1 * tip), letter, color="#555555", ha="center", va="center", fontsize=11)
    direction = direction_from_angles(_ELEVATION_DEG, _AZIMUTH_DEG)
    below = direction_from_angles(0.0, _AZIMUTH_DEG) * np.cos(np.radians(_ELEVATION_DEG))
    tip, foot = _seen(direction[None])[0], _seen(below[None])[0]
    axes.annotate("", tip, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": AXES_ON_PAPER[0], "lw": 2.0})
    axes.text(tip[0] + 0.03, tip[1] + 0.05, name, color=AXES_ON_PAPER[0], fontsize=13)
    axes.plot([0.0, foot[0]], [0.0, foot[1]], color="#999999", ls="--")
    axes.plot([tip[0], foot[0]], [tip[1], foot[1]], color="#999999", ls=":")
    _arc(axes, direction_from_angles(0.0, np.linspace(0.0, _AZIMUTH_DEG, 40)), 0.45, azimuth, AXES_ON_PAPER[1])
    turned = direction_from_angles(np.linspace(0.0, _ELEVATION_DEG, 40), _AZIMUTH_DEG)
    _arc(axes, turned, 0.6, f"−{elevation}", AXES_ON_PAPER[2])
    words = f"{name} = (cos {azimuth} cos {elevation}, sin {azimuth} cos {elevation}, −sin {elevation})"
    axes.text(0.5, 0.02, words, transform=axes.transAxes, ha="center", va="top")


def _arc(axes: Any, directions: Array, radius: float, label: str, colour: str) -> None:
    points = _seen(radius * directions)
    axes.plot(*points.T, color=colour, lw=1.6)
    middle = 1.32 * points[len(points) // 2]
    axes.text(*middle, label, color=colour, fontsize=12, ha="center", va="center")
