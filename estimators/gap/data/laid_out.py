"""Recordings made ready for their diagnosis: checked, their floors learned, each whitened beside one calibration."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimators.calibration import Calibration
from estimators.gap.data.anchor import Anchor
from estimators.gap.data.basefit import (
    all_readings,
    estimated_floor,
    fitted_pipeline,
    floor_beside,
    floor_of,
    learn_floor,
    placed,
    posed,
    signals_of,
)
from estimators.gap.data.defects import lattice
from estimators.gap.data.stack import Stack, running_on
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.goodness.raw_readings import copies
from estimators.goodness.words import copied
from estimators.known_angle.together import calibrate_together, check_alike
from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.errors import RefusedFit, RigError
from rig.pose_nodes import quaternions
from rig.recording import Recording, locked_beside, read_recording
from rig.recording.findings import stuck_words
from rig.units import conversion_factor

if TYPE_CHECKING:
    from rig.arm import Arm

PathLike = str | os.PathLike[str]
#: A recording at rest, or one for each of several.
Locked = Recording | PathLike | Sequence[Recording | PathLike | None] | None

#: Fewer samples than this tell no gap from noise.
FEWEST = 200
_ESTIMATED = "estimated from the recording itself"


@dataclass(frozen=True, eq=False)
class Laid:
    """Recordings, each whitened.

    Attributes:
        recordings, data: these, beside one calibration.
        floors, sources: the noise of each one's channels, and where that comes from.
        steps: (6,) of each one's converter; NaN where that is not known. resting: whether each has a recording at rest.
        began: [s] what was added to each one's clock.
        calibration: from before.
        stuck: what seems stuck in each recording, as it was read.
    """

    recordings: tuple[Recording, ...]
    data: tuple[WhitenedData, ...]
    floors: tuple[tuple[ChannelNoise, ...], ...]
    steps: tuple[Array, ...]
    sources: tuple[str, ...]
    resting: tuple[bool, ...]
    began: tuple[float, ...] = ()
    calibration: Calibration | None = None
    stuck: tuple[tuple[str, ...], ...] = ()

    @property
    def at_rest(self) -> bool:
        """Whether every floor was learned at rest."""
        return all(self.resting)

    def together(self, data: Sequence[WhitenedData]) -> WhitenedData:
        """What was made of each recording, joined."""
        if len(data) == 1 and self.calibration is None:
            return data[0]
        names = [recording.name for recording in self.recordings]
        pipeline = max((each.pipeline for each in data), key=lambda each: len(each.sensors))
        if self.calibration is not None:
            pipeline = fitted_pipeline(self.calibration, self.recordings[0])
            there = [name for name in pipeline.sensors if any(name in each.pipeline.sensors for each in data)]
            pipeline = pipeline.restricted(there)
            last = data[-1] if set(there) <= set(data[-1].pipeline.sensors) else data[0]
            anchor = Anchor.beside(last, pipeline, self.calibration)
            return Stack.of([*data, anchor], names, pipeline, self.began)
        return Stack.of(data, names, pipeline, self.began)


def laid_out(
    runs: Sequence[Recording | PathLike], locked: Locked, arm: Arm | None, calibration: Calibration | None
) -> Laid:
    """Several recordings of one rig, or one beside a calibration from before.

    Raises:
        RigError, RefusedFit: as of ``estimators.diagnose``.
    """
    joints = None if arm is None else arm.dof
    rests = [rest_of(run, rest) for run, rest in zip(runs, _each(locked, len(runs)), strict=True)]
    read = [run if isinstance(run, Recording) else read_recording(run, joints=joints) for run in runs]
    check_alike(read)
    for recording in read:
        check(recording, fewest=1)
    if (total := sum(map(len, read))) < FEWEST:
        raise RigError(f"{read[0].name}: found {total} samples in all, expected at least {FEWEST} for a diagnosis")
    ready = [posed(recording, arm) for recording in read]
    if not all(recording.q is not None for recording, _ in ready):  # the tool's poses are what all of them have
        ready = [(_with_tool_poses(recording, own), None) for recording, own in ready]
    used = ready[0][1]
    recordings = [_in_units_of(recording, calibration, read) for recording, _ in ready]
    rests = [None if rest is None else _in_units_of(rest, calibration, read) for rest in rests]
    known = calibration
    if known is None and any(rest is None for rest in rests):
        known = calibrate_together(recordings, noise="residuals", arm=used)
    floors, steps, sources = [], [], []
    for recording, rest in zip(recordings, rests, strict=True):
        if rest is None:
            assert known is not None
            floor = floor_beside(recording, used, fitted_pipeline(known, recording).restricted(recording.sensors))
            step, source = np.full(6, np.nan), _ESTIMATED
        else:
            floor, step, source = floor_and_step(recording, rest, used)
        floors.append(floor)
        steps.append(step)
        sources.append(source)
    joint = calibration
    if joint is None:
        noise = [floor_of(recording, floor) for recording, floor in zip(recordings, floors, strict=True)]
        joint = calibrate_together(recordings, noise=noise, arm=used)
    for recording in recordings:
        for sensor in recording.sensors:
            joint[sensor]
    signals = [signals_of(recording, used) for recording in recordings]
    data, began = [], []
    for recording, own, clock, floor in zip(recordings, signals, running_on(signals), floors, strict=True):
        pipeline = fitted_pipeline(joint, recording).restricted(recording.sensors)
        data.append(placed(recording, clock, pipeline, floor))
        began.append(float(clock.t[0] - own.t[0]))
    return Laid(
        tuple(recordings),
        tuple(data),
        tuple(floors),
        tuple(steps),
        tuple(sources),
        tuple(rest is not None for rest in rests),
        tuple(began),
        calibration,
        tuple(tuple(stuck_words(recording)) for recording in read),
    )


def check(recording: Recording, fewest: int = FEWEST) -> None:
    """Refuse what no diagnosis can come of.

    Raises:
        RigError: too short, or without a pose.
        RefusedFit: with a channel that does not respond, or that is another's copy.
    """
    where = recording.origin or recording.name
    if len(recording) < fewest:
        raise RigError(f"{where}: has {len(recording)} samples, expected at least {fewest} for a diagnosis")
    if recording.q is None and recording.tool_quaternion is None:
        raise RigError(f"{where}: has no pose, expected q1_rad..qN_rad or tool_qw..tool_qz")
    for sensor in recording.sensors:
        for number, values in enumerate(recording.readings(sensor).T, start=1):
            levels = np.unique(values[:: max(1, len(values) // 2000)])
            if len(levels) < min(8, len(values)):
                found = f"only {len(levels)} different readings" if len(levels) > 1 else f"the constant {values[0]:g}"
                raise RefusedFit(f"{where}: {sensor} axis {number}: found {found}, expected a channel that responds")
        if same := copied(sensor, copies(recording.readings(sensor))):
            raise RefusedFit(f"{where}: {same[0]}, expected three axes' own readings")


def rest_of(run: Recording | PathLike, locked: Recording | PathLike | None) -> Recording | None:
    """The recording at rest that was given, or that lies beside the file; None where there is none."""
    if isinstance(locked, Recording):
        return locked
    if locked is not None:
        return read_recording(locked)
    if isinstance(run, Recording):
        return None
    beside = locked_beside(Path(run))
    return None if beside is None else read_recording(beside)


def first_rest(run: Recording | PathLike | Sequence[Recording | PathLike], locked: Locked) -> Recording | None:
    """That of the first of some recordings."""
    runs = [run] if isinstance(run, Recording | str | os.PathLike) else list(run)
    return rest_of(runs[0], _each(locked, len(runs))[0])


def floor_and_step(
    recording: Recording, rest: Recording | None, arm: Arm | None
) -> tuple[tuple[ChannelNoise, ...], Array, str]:
    """The noise of each channel, the converter's step, and where they come from.

    Raises:
        RigError: the recording at rest has other sensors or units.
    """
    if rest is None:
        return estimated_floor(recording, arm), np.full(6, np.nan), _ESTIMATED
    for sensor in recording.sensors:
        if sensor not in rest.sensors or rest.unit(sensor) != recording.unit(sensor):
            raise RigError(
                f"{rest.origin or rest.name}: the locked recording has no {sensor} in {recording.unit(sensor)!r}, "
                "expected the sensors and units of the recording"
            )
    interval = float(np.median(np.diff(recording.t)))
    steps = lattice(all_readings(rest))
    return learn_floor(rest, interval, steps), steps, "locked recording"


def _each(locked: Locked, count: int) -> list[Recording | PathLike | None]:
    if locked is None or isinstance(locked, Recording | str | os.PathLike):
        return [locked] * count
    if len(locked) != count:
        raise RigError(f"locked: found {len(locked)} recordings at rest, expected one, or one for each of {count}")
    return list(locked)


def _with_tool_poses(recording: Recording, arm: Arm | None) -> Recording:
    """Without joint angles."""
    if recording.q is None:
        return recording
    turns = recording.tool_quaternion
    if turns is None:
        turns = quaternions(recording.rotations(arm))
    return replace(recording, q=None, slides=(), tool_quaternion=turns)


def _in_units_of(recording: Recording, calibration: Calibration | None, every: Sequence[Recording]) -> Recording:
    """In the calibration's units, else in those of the first recording that has the sensor."""
    units = {sensor: own.unit for sensor, own in calibration.sensors.items()} if calibration is not None else {}
    for each in every:
        for sensor, unit in each.units.items():
            units.setdefault(sensor, unit)
    wanted = {sensor: units.get(sensor, unit) for sensor, unit in recording.units.items()}
    if wanted == dict(recording.units):
        return recording
    readings = {
        sensor: conversion_factor(recording.unit(sensor), unit) * recording.readings(sensor)
        for sensor, unit in wanted.items()
    }
    return replace(
        recording, units=wanted, accelerometer=readings.get(ACCELEROMETER), magnetometer=readings.get(MAGNETOMETER)
    )
