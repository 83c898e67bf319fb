"""The sphere of directions in the viewer: where the field was in frame 6, and how well each axis fits there."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from rig.arrays import Array, Rows
from scenarios.colours import AXES_ON_DARK, elapsed, rgb, signed
from scenarios.overlay import Overlay
from scenarios.view.stream import at

SPHERES: Final = "directions"
SPACING: Final = 2.6

_GLOBE_RADIUS = 0.96  # just below the points, which it hides on the far side
_GLOBE = (52, 56, 62)
_AXIS = 1.4
_POINT = 0.028
_MARKER = 0.085


def log_spheres(stream: rr.RecordingStream, t: Array, overlay: Overlay, rows: Rows) -> None:
    """One sphere for each series of residuals.

    The points are where the field came from in frame 6, coloured by the residual there: blue -3 sigma, pale 0,
    vermillion +3 sigma. The arrow is the axis; the white point follows the time.

    Args:
        t: (n,) [s].
        rows: (m,) the samples to show.
    """
    directions = overlay.directions[rows]
    for number, name in enumerate(overlay.names):
        path = f"{SPHERES}/{overlay.sensor}/{name}"
        offset = SPACING * (number - 0.5 * (len(overlay.names) - 1))
        stream.log(path, rr.Transform3D(translation=(offset, 0.0, 0.0)), static=True)
        colour = rgb(AXES_ON_DARK[number])
        stream.log(f"{path}/globe", globe(), static=True)
        label = rr.Points3D([(0.0, 0.0, -1.45)], radii=0.0, colors=[colour], labels=[name], show_labels=True)
        stream.log(f"{path}/name", label, static=True)
        colours = signed(overlay.residuals[rows, number] / overlay.sigma[number], 3.0)
        _log_points(stream, path, t[rows], directions, colours)
        if len(overlay.names) == 3:
            reach = _AXIS * overlay.axes[number]
            arrow = rr.Arrows3D(origins=[-reach], vectors=[2.0 * reach], colors=[colour], radii=0.035)
            stream.log(f"{path}/axis", arrow, static=True)


def log_cloud(stream: rr.RecordingStream, t: Array, sensor: str, readings: Array, rows: Rows, share: Array) -> None:
    """Readings (n, 3) without a calibration: points about the middle of their range, in half their range."""
    low, high = readings.min(axis=0), readings.max(axis=0)
    half = float((high - low).max()) / 2.0 or 1.0
    path = f"{SPHERES}/{sensor}/readings"
    _log_points(stream, path, t[rows], (readings[rows] - (low + high) / 2.0) / half, elapsed(share))
    names = ["1", "2", "3"]
    arrows = rr.Arrows3D(vectors=1.3 * np.eye(3), colors=[rgb(c) for c in AXES_ON_DARK], radii=0.02, labels=names)
    stream.log(f"{path}/axes", arrows, static=True)


def globe() -> rr.Ellipsoids3D:
    """What the directions lie on."""
    return rr.Ellipsoids3D(radii=[_GLOBE_RADIUS], colors=[_GLOBE], fill_mode=rr.components.FillMode.Solid)


def _log_points(stream: rr.RecordingStream, path: str, t: Array, points: Array, colours: NDArray[np.uint8]) -> None:
    stream.log(f"{path}/seen", rr.Points3D(points, colors=colours, radii=_POINT), static=True)
    now = f"{path}/now"
    stream.log(now, rr.Points3D.from_fields(radii=_MARKER, colors=[(255, 255, 255)]), static=True)
    stream.send_columns(now, indexes=at(t), columns=rr.Points3D.columns(positions=points))
