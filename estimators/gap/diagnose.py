"""The diagnosis of one recording: floor, base fit, defects, selection, rivals, remainder, closure."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.gap.basefit import all_readings, estimated_floor, learn_floor, posed, set_up
from estimators.gap.bench import Bench
from estimators.gap.blocks import block_size
from estimators.gap.channel_noise import ChannelNoise
from estimators.gap.closure import elsewhere
from estimators.gap.corrected import corrected_calibration
from estimators.gap.defects import Defect, explained_away, find_defects, lattice, masked
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.fast_tones import fast_tones
from estimators.gap.fitted_rig import FittedRig, judged
from estimators.gap.posterior import explain
from estimators.gap.report import conclude
from estimators.gap.states import NoiseState
from estimators.goodness.readings import copies
from estimators.goodness.words import copied
from rig.effects import EFFECTS, Effect, Kind
from rig.errors import RefusedFit, RigError, unknown_name
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
#: Units of parameters that only times give a meaning. That something happened between two poses, their order shows.
_OF_TIME = ("s", "Hz", "V/sqrt(s)")


def diagnose(
    run: Recording | PathLike,
    locked: Recording | PathLike | None = None,
    maneuver2: Recording | PathLike | None = None,
    without: Sequence[str] = (),
    arm: Arm | None = None,
    progress: Callable[[float], None] | None = None,
    prior: Mapping[str, float] | None = None,
    rig: FittedRig | None = None,
) -> Diagnosis:
    """Where a recording disagrees with the rig, which effects cause it, and how far the gap closes with them.

    Args:
        run: a recording or its file.
        locked: a recording at rest, for the noise floor. None: the one beside the file, else the floor is estimated
        from
            the recording itself, and marked so.
        maneuver2: another maneuver of the same rig, on which the gap's closing is judged as well.
        without: effects to leave out of the catalogue.
        arm: None: the A465 where the recording's metadata name it, else the recorded poses of the tool.
        progress: called with the share done, 0 to 1.
        prior: relative weights of effects, by name; one by default (``estimators.gap.prior.read_prior``).
        rig: a fitted rig, whose effects are part of the model; the diagnosis is of what that leaves.

    Raises:
        RigError: the recording is too short, has no pose, or joint angles of an unknown arm alone; or an effect is
            unknown.
        RefusedFit: a channel does not respond or is another's copy, or the base model cannot be fitted.
    """
    return examined(run, locked, maneuver2, without, arm, progress, prior, rig)[0]


@one_blas_thread()
def examined(
    run: Recording | PathLike,
    locked: Recording | PathLike | None = None,
    maneuver2: Recording | PathLike | None = None,
    without: Sequence[str] = (),
    arm: Arm | None = None,
    progress: Callable[[float], None] | None = None,
    prior: Mapping[str, float] | None = None,
    rig: FittedRig | None = None,
) -> tuple[Diagnosis, Bench]:
    """As ``diagnose``, with the bench that the recording was put on: its base fit, nothing left out."""
    begun = time.perf_counter()
    recording = run if isinstance(run, Recording) else read_recording(run, joints=None if arm is None else arm.dof)
    check(recording)
    check_names(without)
    given = arm
    recording, arm = posed(recording, given)
    untimed = [] if not recording.untimed else [name for name in EFFECTS if needs_times(EFFECTS[name])]
    said = tuple(without)
    without = tuple(dict.fromkeys((*without, *untimed)))
    rest = _locked(run, locked)
    floor, step, source = _floor(recording, rest, arm)
    ideal = bench = set_up(recording, floor, arm)
    if rig is not None:
        rig = rig.on(recording)
        bench = rig.whitened(set_up(recording, floor, arm, rig.of_kind(Kind.MEAN)))
    defects = find_defects(bench, step)
    block = block_size(len(recording), bench.interval_s)
    while True:
        tones, clean = fast_tones(masked(bench, defects), block, without)
        clean = clean.averaged(block)
        posterior = explain(clean.pointwise(), without, rest is not None, prior, progress)
        leading = posterior.leading
        effects = [fit.effect for fit in leading.explanation.fits]
        raised = _raised(leading.state, block, len(recording))
        left = explained_away(bench, defects, leading.explanation.bench.pipeline, effects, raised)
        if _affected(left) >= _FEWER * _affected(defects):
            break
        defects = left
    unmodelled = defects if rig is None else [defect for defect in defects if not rig.has(defect)]
    result, effects = conclude(recording, clean, posterior, [*unmodelled, *tones], without, floor, source)
    if rig is not None:
        result = replace(result, rig=judged(rig, recording, result, ideal, bench, defects))
    try:
        result = replace(result, calibration=corrected_calibration(recording, clean, posterior, source))
    except RigError as error:  # never at the cost of the diagnosis
        result = replace(result, warnings=(*result.warnings, f"no corrected calibration: {error}"))
    if untimed:
        why = "the poses have no times, only an order"
        beside = [{"effect": name, "where": "everywhere", "why": why} for name in untimed if name not in said]
        result = replace(result, cannot_tell=(*result.cannot_tell, *beside))
    if maneuver2 is not None and effects:
        second = maneuver2 if isinstance(maneuver2, Recording) else read_recording(maneuver2)
        check(second)
        second, its_arm = posed(second, given)
        its_floor = _floor(second, _locked(maneuver2, None) or rest, its_arm)[0]
        other = _averaged(set_up(second, its_floor, its_arm, () if rig is None else rig.of_kind(Kind.MEAN)))
        share = elsewhere(other, other.change(effects))
        result = replace(result, closed_on="both", closed_elsewhere=share)
    return replace(result, seconds=time.perf_counter() - begun), bench


def needs_times(effect: type[Effect]) -> bool:
    """Whether an effect says nothing of poses that have an order but no times."""
    of_time = (item.unit in _OF_TIME and item.name != "at_s" for item in effect.parameters())
    return effect.name == "motion_acceleration" or any(of_time)


def check_names(without: Sequence[str]) -> None:
    """Refuse names that are no effects.

    Raises:
        RigError: an unknown effect.
    """
    for name in without:
        if name not in EFFECTS:
            raise unknown_name("effect", name, EFFECTS)


def _affected(defects: Sequence[Defect]) -> int:
    return sum(int(each.affected.sum()) for each in defects)


def _raised(state: NoiseState, block: int, count: int) -> Array | None:
    """(count, 6) how far named noise exceeds the floor at each sample; None where none varies in time."""
    added = [offer.added for offer in state.offers if offer.in_time]
    if not added:
        return None
    raised = np.repeat(np.sqrt(1.0 + sum(added)), block, axis=0)
    return np.concatenate([raised, raised[-1:].repeat(max(count - len(raised), 0), axis=0)])[:count]


def _averaged(bench: Bench) -> Bench:
    return bench.averaged(block_size(len(bench.base), bench.interval_s))


def check(recording: Recording) -> None:
    """Refuse what no diagnosis can come of.

    Raises:
        RigError: too short, or without a pose.
        RefusedFit: with a channel that does not respond, or that is another's copy.
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
        if same := copied(sensor, copies(recording.readings(sensor))):
            raise RefusedFit(f"{where}: {same[0]}, expected three axes' own readings")


def _locked(run: Recording | PathLike, locked: Recording | PathLike | None) -> Recording | None:
    if isinstance(locked, Recording):
        return locked
    if locked is not None:
        return read_recording(locked)
    if isinstance(run, Recording):
        return None
    beside = locked_beside(Path(run))
    return None if beside is None else read_recording(beside)


def _floor(recording: Recording, rest: Recording | None, arm: Any) -> tuple[tuple[ChannelNoise, ...], Array, str]:
    if rest is None:
        return estimated_floor(recording, arm), np.full(6, np.nan), "estimated from the recording itself"
    for sensor in recording.sensors:
        if sensor not in rest.sensors or rest.unit(sensor) != recording.unit(sensor):
            raise RigError(
                f"{rest.origin or rest.name}: the locked recording has no {sensor} in {recording.unit(sensor)!r}, "
                "expected the sensors and units of the recording"
            )
    interval = float(np.median(np.diff(recording.t)))
    return learn_floor(rest, interval), lattice(all_readings(rest)), "locked recording"
