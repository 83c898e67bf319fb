"""A diagnosis on the arm: the cause where it sits, what it does, what is left along the path before and after."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from estimators.gap.diagnosis import Diagnosis
from rig.arrays import Array, Rows
from rig.channels import ACCELEROMETER, CHANNELS, CHANNELS_OF, COLUMNS_OF
from rig.errors import RigError
from scenarios.colours import AXES_ON_DARK, SKY_BLUE, VERMILLION, rgb
from scenarios.decimation import evenly, gone_by, means_of_blocks
from scenarios.gap_report.gap_residuals import GapResiduals, mean_effects
from scenarios.gap_report.own_names import in_own_names
from scenarios.gap_report.words import cause_words
from scenarios.sensor_motion import SensorMotion, arm_of, motion
from scenarios.shown_units import shown_units
from scenarios.view.arm import ARM, BASE, log_arm
from scenarios.view.blueprint import layout, played, series_view, spatial_view
from scenarios.view.fault import FAULT, log_fault
from scenarios.view.series import log_line
from scenarios.view.stream import written_stream
from scenarios.view.sweep import PATH, SENSOR, log_sensor, log_sweep

VECTORS: Final = "residual_vectors"
DOES: Final = "what_the_causes_do"
LEFT: Final = "residual_means"
BEFORE, AFTER = "before", "after"

#: Poses of the arm; means along the path; samples of a series.
_FRAMES, _MEANS, _SAMPLES = 2000, 300, 8000
#: The longest arrow but the 2 % that are longer, as a share of the scene.
_ARROW = 0.3


@dataclass(frozen=True)
class _Vectors:
    """Mean residuals of a sensor along the path: ``middle`` (m,) rows, ``before`` and ``after`` (m, 3) [field unit]."""

    sensor: str
    unit: str
    middle: Rows
    before: Array
    after: Array


def write_diagnosis_view(diagnosis: Diagnosis, residuals: GapResiduals, path: str | os.PathLike[str]) -> None:
    """Write an .rrd file, whole or not at all.

    Args:
        residuals: of the diagnosed recording, from ``gap_residuals``.

    Raises:
        RigError: the file cannot be written, the recording has no pose, or logging is switched off.
    """
    recording = residuals.recording
    arm = residuals.data.base.arm or arm_of(recording)
    sweep = motion(recording, arm, evenly(len(recording), _FRAMES))
    if sweep is None:
        raise RigError(f"{recording.origin or recording.name}: has no pose, expected one to show a diagnosis on")
    vectors = _vectors(residuals)
    with written_stream(path) as stream:
        stream.send_recording_name(f"{recording.name}: {diagnosis.verdict}")
        base, reach = _log_arm(stream, diagnosis, residuals, sweep)
        scale, tips = _log_vectors(stream, base, residuals, vectors, sweep)
        _log_series(stream, residuals)
        stream.send_blueprint(_blueprint(diagnosis, residuals, vectors, base, (reach, tips), scale))


def _log_arm(
    stream: rr.RecordingStream, diagnosis: Diagnosis, residuals: GapResiduals, sweep: SensorMotion
) -> tuple[str, Array]:
    """The arm, its path, the sensor and the causes; the base frame's name, and points that the view must hold."""
    recording, arm = residuals.recording, residuals.data.base.arm
    t = recording.t[sweep.rows]
    q = None if recording.q is None or arm is None else recording.q[sweep.rows]
    shown = log_arm(stream, recording, arm, sweep.rows)
    base = BASE if shown is None else shown.base
    log_sweep(stream, base, sweep, gone_by(recording.t, sweep.rows), 2)
    reach = sweep.reach(shown is not None)
    size = float(np.ptp(reach, axis=0).max())
    log_sensor(stream, base, t, sweep, np.eye(3), (), 0.12 * size)
    held = [reach]
    for cause, spoken in zip(diagnosis.leading, in_own_names(diagnosis).leading, strict=True):
        label = cause_words(spoken)
        held.append(log_fault(stream, base, cause, label, t, q, sweep, shown, arm, size))
    return base, np.vstack(held)


def _vectors(residuals: GapResiduals) -> _Vectors:
    """Of the sensor whose residual stands out most against its floor."""
    recording, pipeline = residuals.recording, residuals.calibrated
    after = residuals.before if residuals.after is None else residuals.after
    blocks = np.array_split(np.arange(len(recording)), min(_MEANS, len(recording)))
    middle = np.array([block[len(block) // 2] for block in blocks])
    found = []
    for sensor, model in pipeline.sensors.items():
        columns = COLUMNS_OF[sensor]
        inverse = np.linalg.inv(np.asarray(model.sensitivity)[:, None] * model.axes)
        turned = residuals.data.base.R_base_tool
        means = []
        for left in (residuals.before, after):
            in_base = np.einsum("nij,nj->ni", turned, left[:, columns] @ inverse.T)
            means.append(means_of_blocks(in_base, _MEANS))
        floor = np.sqrt(np.mean([residuals.floor[column].variance for column in range(6)[columns]]))
        size = float(np.sqrt(np.mean((means[0] / np.linalg.norm(inverse, 2) / floor) ** 2)))
        unit = "m/s²" if sensor == ACCELEROMETER else recording.metadata.magnetic_field_unit or "of the field"
        found.append((size, _Vectors(sensor, unit, middle, *means)))
    return max(found, key=lambda each: each[0])[1]


def _log_vectors(
    stream: rr.RecordingStream, base: str, residuals: GapResiduals, vectors: _Vectors, sweep: SensorMotion
) -> tuple[float, Array]:
    """Arrows along the path, before and after on one scale; returns what 0.1 m of arrow stand for [field unit], and
    their tips (m, 3) [m]."""
    places = motion(residuals.recording, residuals.data.base.arm, vectors.middle)
    assert places is not None  # as there is a sweep
    lengths = np.linalg.norm(vectors.before, axis=1)
    size = float(np.ptp(sweep.tip, axis=0).max())
    per_unit = _ARROW * size / max(float(np.quantile(lengths, 0.98)), 1e-300)
    for name, values, colour in ((BEFORE, vectors.before, VERMILLION), (AFTER, vectors.after, SKY_BLUE)):
        arrows = rr.Arrows3D(
            vectors=per_unit * values, origins=places.tip, colors=[rgb(colour)], radii=rr.Radius.ui_points(1.2)
        )
        stream.log(f"{VECTORS}/{name}", rr.CoordinateFrame(base), arrows, static=True)
        path = rr.LineStrips3D([places.tip], colors=[(90, 96, 104)], radii=rr.Radius.ui_points(0.4))
        stream.log(f"{VECTORS}/{name}/path", rr.CoordinateFrame(base), path, static=True)
    return 0.1 / per_unit, places.tip + per_unit * vectors.before


def _log_series(stream: rr.RecordingStream, residuals: GapResiduals) -> None:
    """What the causes change in each channel, and block means of the residuals before and after."""
    recording = residuals.recording
    change = residuals.data.change(mean_effects(residuals.causes))
    middle = means_of_blocks(recording.t, _MEANS)
    shown = shown_units(recording.units)
    for sensor in recording.sensors:
        for number, channel in enumerate(CHANNELS_OF[sensor]):
            column, own = CHANNELS.index(channel), shown[channel]
            title = f"{channel} [{own.name}]"
            own_change = own.factor * change[:, column]
            path = f"{DOES}/{sensor}/{channel}"
            log_line(stream, path, recording.t, own_change, title, AXES_ON_DARK[number], _SAMPLES)
            for name, left, paint in ((BEFORE, residuals.before, VERMILLION), (AFTER, residuals.after, SKY_BLUE)):
                if left is not None:
                    means = own.factor * means_of_blocks(left[:, column], _MEANS)
                    log_line(stream, f"{LEFT}/{channel}/{name}", middle, means, name, paint, _SAMPLES)


def _blueprint(
    diagnosis: Diagnosis,
    residuals: GapResiduals,
    vectors: _Vectors,
    base: str,
    reach: tuple[Array, Array],
    scale: float,
) -> rrb.Blueprint:
    """The arm with its fault and the vectors before and after; beside these what the causes do and what is left.

    Args:
        reach: points that the view of the arm must hold, and those of the vectors.
    """
    recording = residuals.recording
    start, end = float(recording.t[0]), float(recording.t[-1])
    causes = "; ".join(cause_words(cause) for cause in in_own_names(diagnosis).leading) or "no cause"
    fault = spatial_view(
        f"{diagnosis.verdict}: {causes}", [f"/{ARM}/**", f"/{PATH}/**", f"/{SENSOR}/**", f"/{FAULT}/**"], base, reach[0]
    )
    pair = [
        spatial_view(
            f"{name.capitalize()}: {vectors.sensor}, 0.1 m is {scale:.2g} {vectors.unit}",
            [f"/{VECTORS}/{name}/**"],
            base,
            reach[1],
        )
        for name in (BEFORE, AFTER)
    ]
    shown = shown_units(recording.units)
    rows = diagnosis.channels
    own = [channel for channel in CHANNELS_OF[vectors.sensor] if channel in rows]
    worst = sorted(own, key=lambda name: -rows[name].gap_before / rows[name].noise_floor)[:2]
    right: list[rrb.View] = []
    for sensor in recording.sensors:
        unit = shown[CHANNELS_OF[sensor][0]].name
        right.append(series_view(f"{DOES}/{sensor}", f"What the causes do to the {sensor} [{unit}]", start, end, True))
    for channel in worst:
        title = f"Residual of {channel} [{shown[channel].name}], means, before and after"
        right.append(series_view(f"{LEFT}/{channel}", title, start, end, True))
    left = rrb.Vertical(fault, rrb.Horizontal(*pair), row_shares=[3, 2])
    return layout(rrb.Horizontal(left, rrb.Vertical(*right), column_shares=[5, 4]), played(start, end))
