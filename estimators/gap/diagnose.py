"""The diagnosis of a recording, or of several: floor, base fit, defects, selection, rivals, remainder, closure."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimators.calibration import Calibration
from estimators.gap.data.basefit import posed, set_up
from estimators.gap.data.blocks import bent, block_size
from estimators.gap.data.defects import Defect, explained_away, find_defects, masked
from estimators.gap.data.laid_out import Laid, Locked, check, first_rest, floor_and_step, laid_out, rest_of
from estimators.gap.data.stack import acting
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import GIVEN_WEIGHTS, NOT_CORRECTED, Diagnosis
from estimators.gap.evidence.fast_tones import fast_tones
from estimators.gap.evidence.states import NoiseState
from estimators.gap.floor.tones_at_rest import tone_words
from estimators.gap.hypotheses.stochastic import EVERY
from estimators.gap.report.closure import elsewhere
from estimators.gap.report.corrected import corrected_calibration
from estimators.gap.report.fitted_rig import FittedRig, judged
from estimators.gap.report.remainder_test import remainder_p_value
from estimators.gap.report.summary import conclude
from estimators.gap.search.posterior import explain
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.errors import RigError, unknown_name
from rig.pipeline import Pipeline
from rig.progress import Progress
from rig.recording import Recording, read_recording
from rig.recording.findings import stuck_words
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm

PathLike = str | os.PathLike[str]

#: Where known causes leave less than this share of the defective readings, these are looked at anew.
_FEWER = 0.7
#: Standard deviations to both sides of an instant within which readings belong to either side.
_UNSURE = 3.0
#: Samples of each mean at which effects are evaluated that jump or vary within it.
_POINTS = 4
#: Units of parameters that only times give a meaning. That something happened between two poses, their order shows.
_OF_TIME = ("s", "Hz", "V/sqrt(s)")


def diagnose(
    run: Recording | PathLike | Sequence[Recording | PathLike],
    locked: Locked = None,
    maneuver2: Recording | PathLike | None = None,
    without: Sequence[str] = (),
    arm: Arm | None = None,
    progress: Progress | None = None,
    prior: Mapping[str, float] | None = None,
    rig: FittedRig | None = None,
    calibration: Calibration | None = None,
) -> Diagnosis:
    """Where a recording disagrees with the rig, which effects cause it, and how far the gap closes with them.

    Args:
        run: a recording or its file; or several, in the order in which they were made, of one rig: the same causes and
            one calibration for all (``estimators.gap.data.stack``).
        locked: a recording at rest, for the noise floor; of several recordings one for all or one each. None: the one
            beside the file, else the floor is estimated from the recording itself, and marked so.
        maneuver2: another maneuver of the same rig, on which the gap's closing is judged as well.
        without: effects to leave out of the catalogue.
        arm: None: the A465 where the recording's metadata name it, else the recorded poses of the tool.
        progress: called with the share done, 0 to 1.
        prior: relative weights of effects, by name; one by default (``estimators.gap.hypotheses.prior.read_prior``).
        rig: a fitted rig, whose effects are part of the model; the diagnosis is of what that leaves.
        calibration: from before, of the same rig; its covariance is the prior of what is calibrated here. A recording
            that cannot be calibrated by itself needs one, or others beside it.

    Raises:
        RigError: the recording is too short, has no pose, or joint angles of an unknown arm alone; or an effect is
            unknown.
        RefusedFit: a channel does not respond or is another's copy, or the base model cannot be fitted.
    """
    return examined(run, locked, maneuver2, without, arm, progress, prior, rig, calibration).diagnosis


@dataclass(frozen=True, eq=False)
class Examined:
    """A diagnosis with what it stands on.

    Attributes:
        diagnosis: the answer. data: the recordings beside their base fit, nothing left out. laid: each on its own.
        effects: the mean effects of the likeliest explanation. settled: the calibration with these in place.
    """

    diagnosis: Diagnosis
    data: WhitenedData
    laid: Laid
    effects: Sequence[Effect]
    settled: Pipeline


@one_blas_thread()
def examined(
    run: Recording | PathLike | Sequence[Recording | PathLike],
    locked: Locked = None,
    maneuver2: Recording | PathLike | None = None,
    without: Sequence[str] = (),
    arm: Arm | None = None,
    progress: Progress | None = None,
    prior: Mapping[str, float] | None = None,
    rig: FittedRig | None = None,
    calibration: Calibration | None = None,
) -> Examined:
    """As ``diagnose``, with what the diagnosis stands on."""
    begun = time.perf_counter()
    check_names(without)
    one = isinstance(run, Recording | str | os.PathLike)
    if one and calibration is None:
        laid = _alone(run, locked, arm)  # type: ignore[arg-type]
    else:
        laid = laid_out([run] if one else list(run), locked, arm, calibration)  # type: ignore[list-item, arg-type]
    said = tuple(without)
    timeless = all(recording.untimed for recording in laid.recordings)
    untimed = [name for name in EFFECTS if needs_times(EFFECTS[name])] if timeless else []
    without = tuple(dict.fromkeys((*without, *untimed)))
    ideal = laid.data[0]
    if rig is not None:
        rig = rig.on(laid.recordings[0])
        arm = ideal.base.arm
        own_data = rig.whitened(set_up(laid.recordings[0], laid.floors[0], arm, rig.of_kind(Kind.MEAN)))
        laid = replace(laid, data=(own_data,))
    defects = [find_defects(data, step) for data, step in zip(laid.data, laid.steps, strict=True)]
    blocks = [block_size(len(data.base), data.interval_s) for data in laid.data]
    # what is as fast as a tone may be a harmonic of a fast arm's motion: causes that make it are looked for first
    fast = any(bent(data.base, block) for data, block in zip(laid.data, blocks, strict=True) if block > 1)
    found = _tones(laid, defects, [1] * len(blocks) if fast else blocks, without)
    follows, around, again = list[Effect](), None, fast
    while True:
        clean = laid.together([data.averaged(block) for (_, data), block in zip(found, blocks, strict=True)])
        posterior = explain(clean.pointwise(_POINTS), without, laid.at_rest, prior, progress)
        leading = posterior.leading
        effects = [fit.effect for fit in leading.explanation.fits]
        if again:
            again = False
            follows, around = [effect for effect in effects if not effect.tone], leading.explanation.data.pipeline
            found = _tones(laid, defects, blocks, without, follows, around)
            if any(tones for tones, _ in found):
                continue
        unsure = [*leading.explanation.moved(-_UNSURE), *leading.explanation.moved(_UNSURE)]
        left = []
        for number, (data, own, block) in enumerate(zip(laid.data, defects, blocks, strict=True)):
            pipeline = leading.explanation.data.pipeline.restricted(data.pipeline.sensors)
            raised = _raised(leading.state, block, len(data.base), number, posterior.scanner.fine.data)
            own_unsure = [acting(each, number) for each in unsure]
            own_effects = acting(effects, number)
            left.append(explained_away(data, own, pipeline, own_effects, raised, leading.other, own_unsure))
        if _affected(left) >= _FEWER * _affected(defects):
            break
        defects = left
        found = _tones(laid, defects, blocks, without, follows, around)
    if rig is None:
        unmodelled = defects
    else:
        fitted = rig
        unmodelled = [[defect for defect in own if not fitted.has(defect)] for own in defects]
    readings = [[*own, *tones] for own, (tones, _) in zip(unmodelled, found, strict=True)]
    result, effects = conclude(laid.recordings, clean, posterior, readings, without, laid.floors, laid.sources)
    several = len(laid.recordings) > 1
    stuck = [
        f"{run.name}: " * several + words for run, own in zip(laid.recordings, laid.stuck, strict=True) for words in own
    ]
    weighed = [f"{name} {weight:g}" for name, weight in sorted((prior or {}).items()) if weight != 1.0]
    given = [f"{GIVEN_WEIGHTS}: {', '.join(weighed)}"] if weighed else []
    result = replace(result, warnings=(*result.warnings, *stuck, *tone_words(laid.floors), *given))
    if rig is not None:
        p_value = remainder_p_value(posterior, rig.std_of(Kind.MEAN)) if laid.at_rest else None
        verdict = judged(rig, laid.recordings[0], result, ideal, laid.data[0], defects[0], p_value)
        result = replace(result, rig=verdict)
    if one and calibration is None:
        try:
            made = corrected_calibration(laid.recordings[0], clean, posterior, laid.sources[0])
            result = replace(result, calibration=made)
        except RigError as error:  # never at the cost of the diagnosis
            result = replace(result, warnings=(*result.warnings, f"{NOT_CORRECTED}: {error}"))
    if untimed:
        why = "the poses have no times, only an order"
        beside = [{"effect": name, "where": "everywhere", "why": why} for name in untimed if name not in said]
        result = replace(result, cannot_tell=(*result.cannot_tell, *beside))
    if maneuver2 is not None and effects:
        second = maneuver2 if isinstance(maneuver2, Recording) else read_recording(maneuver2)
        check(second)
        second, its_arm = posed(second, arm)
        its_floor = floor_and_step(second, rest_of(maneuver2, None) or first_rest(run, locked), its_arm)[0]
        other = _averaged(set_up(second, its_floor, its_arm, () if rig is None else rig.of_kind(Kind.MEAN)))
        share = elsewhere(other, other.change(effects))
        result = replace(result, closed_on="both", closed_elsewhere=share)
    result = replace(result, seconds=time.perf_counter() - begun)
    return Examined(result, laid.together(laid.data), laid, effects, leading.explanation.data.pipeline)


def _alone(run: Recording | PathLike, locked: Locked, arm: Arm | None) -> Laid:
    """One recording beside its own calibration."""
    recording = run if isinstance(run, Recording) else read_recording(run, joints=None if arm is None else arm.dof)
    check(recording)
    stuck = tuple(stuck_words(recording))
    recording, arm = posed(recording, arm)
    assert locked is None or isinstance(locked, Recording | str | os.PathLike)
    rest = rest_of(run, locked)
    floor, step, source = floor_and_step(recording, rest, arm)
    data = set_up(recording, floor, arm)
    return Laid((recording,), (data,), (floor,), (step,), (source,), (rest is not None,), stuck=(stuck,))


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


def _affected(defects: Sequence[Sequence[Defect]]) -> int:
    return sum(int(each.affected.sum()) for own in defects for each in own)


def _tones(
    laid: Laid,
    defects: Sequence[Sequence[Defect]],
    blocks: Sequence[int],
    without: Sequence[str],
    beside: Sequence[Effect] = (),
    pipeline: Pipeline | None = None,
) -> list[tuple[list[Defect], WhitenedData]]:
    """Of each recording the tones that means over its blocks would hide, and its readings without these and without
    defects.

    Args:
        beside: mean effects that are there. pipeline: the calibration beside them.
    """
    found = []
    for number, (data, own, block) in enumerate(zip(laid.data, defects, blocks, strict=True)):
        own_pipeline = None if pipeline is None else pipeline.restricted(data.pipeline.sensors)
        found.append(fast_tones(masked(data, own), block, without, acting(beside, number), own_pipeline))
    return found


def _raised(state: NoiseState, block: int, count: int, number: int, data: WhitenedData) -> Array | None:
    """(count, 6) how far named noise exceeds a recording's floor at each sample; None where none varies in time."""
    added = [each.added for fitted in state.fitted for each in fitted.every if each.in_time and each.part == number]
    rows = data.stretches[number]
    added += [fitted.added[rows] for fitted in state.fitted if fitted.in_time and fitted.part == EVERY]
    if not added:
        return None
    raised = np.repeat(np.sqrt(1.0 + sum(added)), block, axis=0)
    return np.concatenate([raised, raised[-1:].repeat(max(count - len(raised), 0), axis=0)])[:count]


def _averaged(data: WhitenedData) -> WhitenedData:
    return data.averaged(block_size(len(data.base), data.interval_s))
