"""Is a calibration of several recordings good? They are put after one another, and asked like one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.calibration import Calibration
from estimators.goodness.judgement import MOST_SAMPLES, judged
from estimators.known_angle.from_recording import arm_of
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.pose_nodes import quaternions
from rig.recording import Recording, RecordingScan, joined, thinned
from rig.recording.repeated_poses import evenly_posed
from rig.units import conversion_factor

if TYPE_CHECKING:
    from rig.arm import Arm


def judged_together(
    runs: Sequence[Recording | RecordingScan], calibration: Calibration, arm: Arm | None = None
) -> Calibration:
    """As ``judged``, of a calibration that ``estimators.calibrate`` made of several recordings.

    A recording that does not agree with the others is a reason why it is not good.
    """
    found = calibration
    for sensor in calibration.sensors:
        there = [run for run in runs if sensor in run.sensors]
        found = judged(as_one(there, (sensor,), found, arm), found, arm)
        own = found.sensors[sensor]
        verdict = own.quality.verdict
        odd = [words for words in own.quality.warnings if "does not agree with the other recordings" in words]
        if odd and verdict is not None:
            changed = replace(own, quality=own.quality.condemned([*odd, *verdict["reasons"]]))
            found = replace(found, sensors={**found.sensors, sensor: changed})
    return found


def as_one(
    runs: Sequence[Recording | RecordingScan],
    sensors: Sequence[str],
    calibration: Calibration,
    arm: Arm | None = None,
) -> Recording:
    """Recordings after one another, thinned, with tool poses, in the calibration's units.

    Samples of a noisier recording count as a part of one: ``pose_samples`` of the metadata.

    Args:
        runs: all with these sensors.
        calibration: of all of them.
    """
    told: dict[str, list[dict[str, Any]]] = calibration.extra.get("recordings", {})
    noise = {each["recording"]: np.asarray(each["noise"]) for each in told.get(sensors[0], [])}
    parts, weights, start = [], [], 0.0
    for run in runs:
        part = thinned(evenly_posed(run)[0], MOST_SAMPLES // len(runs))
        made = _bare(part, arm_of(part, arm, part.origin or part.name), sensors, calibration, start)
        parts.append(made)
        start = float(made.t[-1]) + float(np.median(np.diff(made.t)) if len(made) > 1 else 1.0)
        weights.append(np.full(len(made), float(np.mean(noise[part.name] ** -2.0)) if part.name in noise else 1.0))
    whole = joined(parts)
    share = np.concatenate(weights)
    if np.ptp(share) > 1e-6 * share.max():
        share = share * len(share) / share.sum()
        extra = {**whole.metadata.extra, "pose_samples": [float(each) for each in share]}
        whole = replace(whole, metadata=replace(whole.metadata, extra=extra))
    return replace(whole, name=calibration.recording)


def _bare(
    part: Recording, arm: Arm | None, sensors: Sequence[str], calibration: Calibration, start: float
) -> Recording:
    """Time from ``start`` [s] on, tool poses, and the readings of some sensors in the calibration's units."""
    units = {sensor: calibration[sensor].unit for sensor in sensors}
    readings = {
        sensor: conversion_factor(part.unit(sensor), unit) * part.readings(sensor) for sensor, unit in units.items()
    }
    turns = part.tool_quaternion
    if arm is not None:
        turns = quaternions(part.rotations(arm))
    return Recording(
        t=part.t - part.t[0] + start,
        tool_quaternion=turns,
        accelerometer=readings.get(ACCELEROMETER),
        magnetometer=readings.get(MAGNETOMETER),
        units=units,
        metadata=part.metadata,
        name=part.name,
    )
