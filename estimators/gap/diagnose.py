"""The diagnosis of one recording: floor, base fit, defects, selection, rivals, remainder, closure."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.gap import verdict
from estimators.gap.basefit import all_readings, estimated_floor, learn_floor, set_up
from estimators.gap.bench import Bench
from estimators.gap.blocks import block_size
from estimators.gap.channel_noise import ChannelNoise
from estimators.gap.defects import explained_away, find_defects, lattice, masked
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.fast_tones import fast_tones
from estimators.gap.select import Selection, select
from rig.errors import RefusedFit, RigError
from rig.recording import Recording, locked_beside, read_recording
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm

Array = NDArray[np.float64]
PathLike = str | os.PathLike[str]

#: Fewer samples than this tell no gap from noise.
FEWEST = 200
#: Where known causes leave less than this share of the defective readings, these are looked at anew.
_FEWER = 0.7


def diagnose(
    run: Recording | PathLike,
    locked: Recording | PathLike | None = None,
    maneuver2: Recording | PathLike | None = None,
    without: Sequence[str] = (),
    arm: Arm | None = None,
    progress: Callable[[float], None] | None = None,
) -> Diagnosis:
    """Where a recording disagrees with the rig, which effects cause it, and how far the gap closes with them.

    Args:
        run: a recording or its file.
        locked: a recording at rest, for the noise floor. None: the one beside the file, else the floor is estimated
        from
            the recording itself, and marked so.
        maneuver2: another maneuver of the same rig, on which the gap's closing is judged as well.
        without: effects to leave out of the catalogue.
        arm: None: the A465 where the recording has joint angles.
        progress: called with the share done, 0 to 1.

    Raises:
        RigError: the recording is too short, has no pose, a channel that does not respond, or an effect is unknown.
        RefusedFit: the base model cannot be fitted.
    """
    return examined(run, locked, maneuver2, without, arm, progress)[0]


@one_blas_thread()
def examined(
    run: Recording | PathLike,
    locked: Recording | PathLike | None = None,
    maneuver2: Recording | PathLike | None = None,
    without: Sequence[str] = (),
    arm: Arm | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Diagnosis, Bench]:
    """As ``diagnose``, with the bench that the recording was put on: its base fit, nothing left out."""
    begun = time.perf_counter()
    recording = run if isinstance(run, Recording) else read_recording(run, joints=None if arm is None else arm.dof)
    check(recording)
    verdict.check_names(without)
    rest = _locked(run, locked)
    if arm is None and recording.q is not None:
        from rig.arm import Arm as Arms

        arm = Arms.a465()
    interval = float(np.median(np.diff(recording.t)))
    floor, step, source = _floor(recording, rest, interval, arm)
    bench = set_up(recording, floor, arm)
    defects = find_defects(bench, step)
    block = block_size(len(recording), interval)
    while True:
        tones, clean = fast_tones(masked(bench, defects), block, without)
        clean = clean.averaged(block)
        state = select(clean.pointwise(), without, progress)
        effects = [cause.fit.effect for cause in state.causes]
        left = explained_away(bench, defects, state.bench.pipeline, effects, _raised(state, block, len(recording)))
        if sum(int(each.affected.sum()) for each in left) >= _FEWER * sum(int(each.affected.sum()) for each in defects):
            break
        defects = left
    result = verdict.conclude(recording, clean, state, [*defects, *tones], without, floor, source)
    if maneuver2 is not None:
        second = maneuver2 if isinstance(maneuver2, Recording) else read_recording(maneuver2)
        check(second)
        result = verdict.judged_elsewhere(result, state, _averaged(set_up(second, floor, arm)))
    return replace(result, seconds=time.perf_counter() - begun), bench


def _raised(state: Selection, block: int, count: int) -> Array | None:
    """(count, 6) how far named noise exceeds the floor at each sample; None where none varies in time."""
    added = [offer.added for offer in state.noises if offer.in_time]
    if not added:
        return None
    raised = np.repeat(np.sqrt(1.0 + sum(added)), block, axis=0)
    return np.concatenate([raised, raised[-1:].repeat(max(count - len(raised), 0), axis=0)])[:count]


def _averaged(bench: Bench) -> Bench:
    return bench.averaged(block_size(len(bench.base), bench.interval_s))


def check(recording: Recording) -> None:
    """Refuse what no diagnosis can come of.

    Raises:
        RigError: too short, without a pose, or with a channel that does not respond.
    """
    where = recording.origin or recording.name
    if len(recording) < FEWEST:
        raise RigError(f"{where}: has {len(recording)} samples, expected at least {FEWEST} for a diagnosis")
    if recording.q is None and recording.tool_quaternion is None:
        raise RigError(f"{where}: has no pose, expected q1_rad..qN_rad or tool_qw..tool_qz")
    for sensor in recording.sensors:
        for number, values in enumerate(recording.readings(sensor).T, start=1):
            levels = np.unique(values[:: max(1, len(values) // 2000)])
            if len(levels) < 8:
                found = f"only {len(levels)} different readings" if len(levels) > 1 else f"the constant {values[0]:g}"
                raise RefusedFit(f"{where}: {sensor} axis {number}: found {found}, expected a channel that responds")


def _locked(run: Recording | PathLike, locked: Recording | PathLike | None) -> Recording | None:
    if isinstance(locked, Recording):
        return locked
    if locked is not None:
        return read_recording(locked)
    if isinstance(run, Recording):
        return None
    beside = locked_beside(Path(run))
    return None if beside is None else read_recording(beside)


def _floor(
    recording: Recording, rest: Recording | None, interval: float, arm: Any
) -> tuple[tuple[ChannelNoise, ...], Array, str]:
    if rest is None:
        return estimated_floor(recording, arm), np.full(6, np.nan), "estimated from the recording itself"
    for sensor in recording.sensors:
        if sensor not in rest.sensors or rest.unit(sensor) != recording.unit(sensor):
            raise RigError(
                f"{rest.origin or rest.name}: the locked recording has no {sensor} in {recording.unit(sensor)!r}, "
                "expected the sensors and units of the recording"
            )
    return learn_floor(rest, interval), lattice(all_readings(rest)), "locked recording"
