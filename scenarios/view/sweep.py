"""The sweep in the viewer: the bristles of Renk et al. (2005), Figure 2, the path, the sensor and the fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from scenarios.colours import AXES_ON_DARK, GRAVITY, MAGNETIC, elapsed, rgb
from scenarios.decimation import evenly
from scenarios.overlay import Overlay
from scenarios.sensor_motion import SensorMotion
from scenarios.view.stream import at

SWEEP: Final = "sweep"
BRISTLES: Final = f"{SWEEP}/bristles"
PATH: Final = f"{SWEEP}/path"
SENSOR: Final = f"{SWEEP}/sensor"
FIELDS: Final = f"{SWEEP}/fields"
SENSOR_TRANSFORM: Final = "transforms/sensor"

#: The moving frame of the sensor: frame 6, moved to where the sensor is.
SENSOR_FRAME: Final = "torusrig/sensor"

_PATH_COLOURS = 64  # a strip has one colour: the path is cut into this many
_FIELDS = {ACCELEROMETER: GRAVITY, MAGNETOMETER: MAGNETIC}


def log_sweep(stream: rr.RecordingStream, base: str, sweep: SensorMotion, share: Array, bristles: int) -> None:
    """What stands still: a decimated set of bristles, and the sensor's path through all samples of ``sweep``.

    Args:
        base: the base frame's name.
        share: (m,) the share of the recording gone by at each sample, 0 to 1: the colour.
        bristles: how many to draw at most.
    """
    kept = evenly(len(share), bristles)
    colours = elapsed(share)
    segments = np.stack([sweep.root[kept], sweep.tip[kept]], axis=1)
    _log_strips(stream, BRISTLES, base, list(segments), colours[kept], 0.5)
    cuts = evenly(len(share), _PATH_COLOURS + 1)
    pieces = [sweep.tip[start : stop + 1] for start, stop in pairwise(cuts)]
    if pieces:
        _log_strips(stream, PATH, base, pieces, colours[cuts[:-1]], 0.5)


def _log_strips(
    stream: rr.RecordingStream, path: str, base: str, strips: list[Array], colours: NDArray[np.uint8], width: float
) -> None:
    lines = rr.LineStrips3D(strips, colors=colours, radii=rr.Radius.ui_points(width))
    stream.log(path, rr.CoordinateFrame(base), lines, static=True)


def log_sensor(
    stream: rr.RecordingStream,
    base: str,
    t: Array,
    sweep: SensorMotion,
    axes: Array,
    names: Sequence[str],
    length: float,
) -> None:
    """The sensor itself: its frame moving through the samples, with its three axes.

    Args:
        t: (m,) [s].
        axes: (3, 3) unit vectors as rows, frame 6: the sensor's axes, or the frame's own.
        names: of the axes.
        length: [m] of an axis.
    """
    columns = rr.Transform3D.columns(
        translation=sweep.tip,
        mat3x3=sweep.R_base_tool,
        parent_frame=[base] * len(t),
        child_frame=[SENSOR_FRAME] * len(t),
    )
    stream.send_columns(SENSOR_TRANSFORM, indexes=at(t), columns=columns)
    arrows = rr.Arrows3D(
        vectors=length * axes,
        colors=[rgb(colour) for colour in AXES_ON_DARK],
        radii=0.04 * length,
        labels=list(names),
    )
    stream.log(SENSOR, rr.CoordinateFrame(SENSOR_FRAME), arrows, static=True)


def log_fields(
    stream: rr.RecordingStream, base: str, fields: Mapping[str, Overlay], start: Array, beside: Array, length: float
) -> None:
    """Arrows along the estimated fields, side by side.

    Args:
        fields: sensor -> its overlay, with the field it feels.
        start: (3,) [m] where the first arrow starts.
        beside: (3,) [m] from one arrow's start to the next one's.
        length: [m] of an arrow.
    """
    vectors = [overlay.field for overlay in fields.values() if overlay.field is not None]
    arrows = rr.Arrows3D(
        vectors=[length * field / np.linalg.norm(field) for field in vectors],
        origins=[start + number * beside for number in range(len(fields))],
        colors=[rgb(_FIELDS[sensor]) for sensor in fields],
        radii=0.04 * length,
        labels=[overlay.field_name for overlay in fields.values()],
    )
    stream.log(FIELDS, rr.CoordinateFrame(base), arrows, static=True)
