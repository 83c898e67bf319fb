"""One recording, and what was made of it, as a file for the rerun viewer."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Final

import numpy as np
import rerun as rr

from estimators.calibration import Calibration
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import CHANNELS_OF
from rig.recording import Recording
from scenarios.decimation import evenly, gone_by
from scenarios.overlay import Overlay, overlays
from scenarios.sensor_motion import SensorMotion, arm_of, motion
from scenarios.view.arm import BASE, log_arm
from scenarios.view.blueprint import EYE_FROM, blueprint
from scenarios.view.series import log_readings, log_residuals
from scenarios.view.spheres import log_cloud, log_spheres
from scenarios.view.stream import written_stream
from scenarios.view.sweep import log_fields, log_sensor, log_sweep

#: So much of a long recording is shown, spread evenly from the first sample to the last: poses of the arm and of the
#: sensor, of these as bristles, directions on a sphere.
FRAMES, BRISTLES, POINTS = 4000, 640, 2500
#: Samples of each series; a longer one is drawn by the lowest and highest sample of equal intervals.
SAMPLES: Final = 8000


def write_view(
    recording: Recording,
    calibration: Calibration | None,
    path: str | os.PathLike[str],
    arm: Arm | None = None,
) -> None:
    """Write an .rrd file, whole or not at all: the arm in its sweep, readings, residuals and spheres of directions.

    Args:
        recording: with joint angles, tool poses or neither; what it lacks is left out of the view.
        calibration: of its sensors; None: readings only, as points in space besides.
        path: the file; ``.rrd`` is what the viewer opens.
        arm: for the joint angles; None: the A465 where the metadata name it, else the sensor alone.

    Raises:
        RigError: the file cannot be written, the arm does not fit the recording or its URDF cannot be read, the
            calibration is in another unit, or logging is switched off in the environment.
    """
    arm = arm or arm_of(recording)
    laid = overlays(recording, calibration, arm)
    sweep = motion(recording, arm, evenly(len(recording), FRAMES))
    with written_stream(path) as stream:
        stream.send_recording_name(recording.name)
        stream.send_blueprint(blueprint(recording, laid, *_log(stream, recording, laid, arm, sweep)))


def _log(
    stream: rr.RecordingStream,
    recording: Recording,
    laid: Mapping[str, Overlay],
    arm: Arm | None,
    sweep: SensorMotion | None,
) -> tuple[str | None, bool, Array]:
    """What there is to be seen; returns the base frame, whether the arm is shown, and points that its view holds."""
    base, reach, shown = None, np.zeros((1, 3)), None
    if sweep is not None:
        shown = log_arm(stream, recording, arm, sweep.rows)
        base = BASE if shown is None else shown.base
        reach = _log_sweep(stream, base, recording, laid, sweep, shown is not None)
    points = evenly(len(recording), POINTS)
    share = gone_by(recording.t, points)
    for sensor in recording.sensors:
        readings, unit = recording.readings(sensor), recording.unit(sensor)
        log_readings(stream, sensor, recording.t, readings, unit, SAMPLES)
        if sensor in laid:
            log_residuals(stream, recording.t, laid[sensor], SAMPLES)
            log_spheres(stream, recording.t, laid[sensor], points)
        else:
            log_cloud(stream, recording.t, sensor, readings, points, share)
    return base, shown is not None, reach


def _log_sweep(
    stream: rr.RecordingStream,
    base: str,
    recording: Recording,
    laid: Mapping[str, Overlay],
    sweep: SensorMotion,
    from_origin: bool,
) -> Array:
    """Bristles, path, sensor and fields; returns points (m, 3) [m] that the view must hold."""
    log_sweep(stream, base, sweep, gone_by(recording.t, sweep.rows), BRISTLES)
    reach = sweep.reach(from_origin)
    low, high = reach.min(axis=0), reach.max(axis=0)
    size = float((high - low).max())
    calibrated = next(iter(laid.values()), None)
    axes = np.eye(3) if calibrated is None else calibrated.axes
    names = ("x6", "y6", "z6") if calibrated is None else CHANNELS_OF[calibrated.sensor]
    log_sensor(stream, base, recording.t[sweep.rows], sweep, axes, names, 0.15 * size)
    fields = {sensor: overlay for sensor, overlay in laid.items() if overlay.field is not None}
    if not fields:
        return reach
    length = 0.18 * size
    beside = 1.4 * length * np.cross([0.0, 0.0, 1.0], EYE_FROM)  # to the right in the picture
    start = np.array([*(low + high)[:2] / 2.0, high[2] + 1.3 * length]) - 0.5 * (len(fields) - 1) * beside
    log_fields(stream, base, fields, start, beside, length)
    return np.vstack([reach, start])
