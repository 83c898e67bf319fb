"""Where a diagnosed cause sits on the arm, in the viewer: a joint, a link, a stray magnet with its uncertainty."""

from __future__ import annotations

import re
from typing import Final

import numpy as np
import rerun as rr

from estimators.gap.diagnosis import Cause
from rig.arm import Arm
from rig.arrays import Array
from scenarios.colours import VERMILLION, rgb
from scenarios.sensor_motion import SensorMotion
from scenarios.view.arm import ArmView
from scenarios.view.stream import at

FAULT: Final = "fault"
#: The ellipsoid about a stray magnet has so many standard deviations as half axes.
SIGMAS: Final = 2.0
_PLACE: Final = re.compile(r"(joint|link)(\d+)")
_LIGHT: Final = (230, 232, 235)


def log_fault(
    stream: rr.RecordingStream,
    base: str,
    cause: Cause,
    label: str,
    t: Array,
    q: Array | None,
    sweep: SensorMotion,
    shown: ArmView | None,
    arm: Arm | None,
    size: float,
) -> Array:
    """One cause, highlighted where it sits; returns points (m, 3) [m] that the view must hold.

    Args:
        base: the base frame's name. label: beside it.
        t, q: (m,) [s], (m, N) [rad] of the moving arm; q None without one.
        sweep: the sensor at the same samples. shown: the arm as it is drawn.
        size: [m] of the whole scene.
    """
    path = f"{FAULT}/{cause.effect}_{cause.where}"
    place = _PLACE.fullmatch(cause.where)
    if cause.effect == "base_dipole":
        return _log_magnet(stream, path, base, cause, label, size)
    if place is not None and arm is not None and q is not None:
        number = int(place[2]) - 1
        if shown is not None:
            shown.colour(number, rgb(VERMILLION))
        positions = arm.joint_anchors(q)[:, number]
    elif cause.where == "base" and arm is not None:
        positions = np.zeros((len(t), 3))
    else:  # the sensor, its mount, a channel, its board
        positions = sweep.tip
    ball = rr.Points3D.from_fields(radii=0.035 * size, colors=[rgb(VERMILLION)])
    # A label has its point's colour: its own point stands above the part, which is as vermillion as the ball.
    words = rr.Points3D.from_fields(radii=0.002 * size, colors=[_LIGHT], labels=[label], show_labels=True)
    above = positions + np.array([0.0, 0.0, 0.1 * size])
    for entity, style, places in ((path, ball, positions), (f"{path}/label", words, above)):
        stream.log(entity, rr.CoordinateFrame(base), style, static=True)
        stream.send_columns(entity, indexes=at(t), columns=rr.Points3D.columns(positions=places))
    return np.vstack([positions, above])[:: max(1, len(positions) // 50)]


def _log_magnet(stream: rr.RecordingStream, path: str, base: str, cause: Cause, label: str, size: float) -> Array:
    """A stray magnet: where it sits, its ellipsoid of two standard deviations, and its moment."""
    position = _numbers(cause.parameters["position_m"].value)
    spread = SIGMAS * _numbers(cause.parameters["position_m"].std)
    colour = rgb(VERMILLION)
    half = np.maximum(spread, 0.002 * size)
    ball = rr.Ellipsoids3D(
        centers=[position],
        half_sizes=[half],
        colors=[colour],
        labels=[label],
        show_labels=True,
        line_radii=0.002 * size,
    )
    stream.log(f"{path}/uncertainty", rr.CoordinateFrame(base), ball, static=True)
    magnet = rr.Points3D([position], radii=0.012 * size, colors=[colour])
    stream.log(f"{path}/magnet", rr.CoordinateFrame(base), magnet, static=True)
    moment = _numbers(cause.parameters["moment"].value) if "moment" in cause.parameters else np.zeros(3)
    if (length := float(np.linalg.norm(moment))) > 0.0:
        arrow = rr.Arrows3D(
            vectors=[0.2 * size * moment / length], origins=[position], colors=[colour], radii=0.006 * size
        )
        stream.log(f"{path}/moment", rr.CoordinateFrame(base), arrow, static=True)
    return np.stack([position - half, position + half])


def _numbers(value: object) -> Array:
    """Three numbers; what the data do not feel is zero."""
    values = value if isinstance(value, tuple | list) else (value,) * 3
    return np.array([float(each) if isinstance(each, int | float) else 0.0 for each in values])
