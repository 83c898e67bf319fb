"""What is left when a session ends: the recording, its calibration, and whether that is any good."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import estimators
from estimators.calibration import Calibration
from estimators.ellipsoid import Options as EllipsoidOptions
from estimators.ellipsoid import read_thinned
from estimators.live import Options
from estimators.live.alarm import Alarm
from estimators.live.calibrator import MOST_SAMPLES
from rig.errors import RefusedFit
from rig.recording import Recording, joined, scan_recording

if TYPE_CHECKING:
    from rig.arm import Arm


def calibrated(
    path: Path, options: Options, arm: Arm | None, alarms: Sequence[Alarm], forgotten_s: float = -np.inf
) -> tuple[Calibration, tuple[RefusedFit, ...]]:
    """The calibration of a recording by the estimators that are used offline, judged on held-out pieces of it.

    Args:
        path: the recording.
        options: as the stream was calibrated.
        arm: for joint angles.
        alarms: of the stream; one within the samples that count makes the calibration no good.
        forgotten_s: as of ``Calibrator``.

    Returns:
        The calibration of the sensors that the data tell, and why they do not tell another.

    Raises:
        RefusedFit: they tell none.
    """
    run = _run(path, options, forgotten_s)
    ellipsoid = EllipsoidOptions(parameters=options.parameters)
    posed = options.attitude and (run.pose != "none" if isinstance(run, Recording) else True)

    def fitted(sensors: Sequence[str] | None) -> Calibration:
        return estimators.calibrate(
            run,
            method=None if posed else "ellipsoid",
            noise="residuals",
            arm=arm if posed else None,
            field_points=dict(options.field_points) if options.field_points else "down",
            sensors=sensors,
            attitude_free=ellipsoid,
        )

    refused: list[RefusedFit] = []
    try:
        found = fitted(None)
    except RefusedFit as refusal:
        told: list[Calibration] = []
        for sensor in (run if isinstance(run, Recording) else scan_recording(run)).sensors:
            try:
                told.append(fitted((sensor,)))
            except RefusedFit as own:
                refused.append(own)
        if not told:
            raise refusal
        found = told[0]
    judged = estimators.judged(run, found, arm if posed else None, at_most=MOST_SAMPLES)
    return _alarmed(judged, run, alarms), tuple(refused)


def _run(path: Path, options: Options, forgotten_s: float) -> Recording | Path:
    """The file; or, of a sliding window or a long stream without attitude, what of it was used live."""
    scan = scan_recording(path)
    if not (options.attitude and bool(scan.columns.joints or scan.columns.tool)):
        return read_thinned(scan, at_most=MOST_SAMPLES, span_s=options.forget_s)
    if not forgotten_s > -np.inf:
        return path
    return joined([batch.select(batch.t > forgotten_s) for batch in scan if float(batch.t[-1]) > forgotten_s])


def _alarmed(calibration: Calibration, run: Recording | Path, alarms: Sequence[Alarm]) -> Calibration:
    begin = float(run.t[0]) if isinstance(run, Recording) else -np.inf
    sensors = dict(calibration.sensors)
    for sensor, own in sensors.items():
        mine = [alarm for alarm in alarms if alarm.sensor == sensor and alarm.t_s >= begin]
        if not mine or own.quality.verdict is None:
            continue
        reason = f"the monitor saw a change at {mine[0].t_s:.1f} s: {mine[0].looks_like}"
        condemned = own.quality.condemned([*own.quality.verdict["reasons"], reason])
        sensors[sensor] = replace(own, quality=condemned).warned(reason)
    return replace(calibration, sensors=sensors)
