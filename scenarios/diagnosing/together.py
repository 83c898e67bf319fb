"""Several recordings diagnosed together, or one beside a calibration from before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.calibration import Calibration
from estimators.gap.data.stack import acting
from estimators.gap.diagnose import Examined, examined
from estimators.gap.report.fitted_rig import delayed
from rig.arm import Arm
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.progress import Progress, unheard
from rig.recording import Recording, locked_beside, whole_or_means
from rig.threads import one_blas_thread
from scenarios.diagnosing.concluded import concluded
from scenarios.diagnosing.kept import origin
from scenarios.diagnosing.task import BYTES_A_SAMPLE, BYTES_ANYWAY, About, Outcome, Task
from scenarios.gap_report.gap_residuals import GapResiduals, diagnosed_effects, whitened, with_noise


def carry_out_together(task: Task, progress: Progress = unheard) -> Outcome:
    """Diagnose recordings of one rig in this process, with one BLAS thread.

    Raises:
        RigError, RefusedFit: a recording cannot be read, or all together cannot be diagnosed.
    """
    arm = None if task.arm_file is None else Arm.from_file(task.arm_file, task.tip)
    joints = None if arm is None else arm.dof
    runs = (task.run, *task.others)
    share = len(runs) * task.together
    recordings: list[Recording] = []
    rests: list[Recording | None] = []
    longest = 1
    for run in runs:
        recording, block = whole_or_means(run, joints, share * BYTES_A_SAMPLE, fixed=task.together * BYTES_ANYWAY)
        beside = task.locked or locked_beside(run)
        longest = max(longest, block)
        recordings.append(recording)
        rests.append(None if beside is None else whole_or_means(beside, joints, block=block)[0])
    known = None if task.calibration is None else Calibration.read(task.calibration)
    with one_blas_thread():
        found = examined(recordings, rests, None, task.without, arm, progress, task.prior, calibration=known)
        about = About.of(recordings[-1], longest)
        return concluded(task, found.diagnosis, residuals_of_each(found), rests[-1], about, origin(task))


def residuals_of_each(found: Examined) -> list[GapResiduals]:
    """Each recording's residuals, before and after the causes are modelled, beside the one calibration."""
    laid, data = found.laid, found.data
    effects = list(found.effects)
    after: Array | None = None
    if effects:
        settled = data.around(found.settled)
        after = settled.left_over(settled.residual - settled.change(effects))
    others = {cause.effect: cause for cause in found.diagnosis.leading if EFFECTS[cause.effect].kind is not Kind.MEAN}
    every = [effect for effect in diagnosed_effects(found.diagnosis) if effect.name in others]
    result = []
    for number, (recording, part, rows) in enumerate(zip(laid.recordings, laid.data, data.single, strict=False)):
        named = [each for each in every if others[each.name].recording in (None, recording.name)]
        began = laid.began[number] if laid.began else 0.0
        own = [_own(effect, began, float(recording.t[0])) for effect in acting(effects, number)]
        causes = (*own, *named)
        left = part.residual if after is None else after[rows]
        explained = after is not None or bool(named)
        result.append(
            GapResiduals(
                recording=recording,
                floor=laid.floors[number],
                before=part.residual,
                after=left if explained else None,
                left_out=np.zeros(part.readings.shape, dtype=bool),
                white_before=whitened(part, part.residual),
                white_after=whitened(with_noise(part, named, left), left) if explained else None,
                causes=causes,
                data=replace(part, base=replace(part.base, t=part.base.t - began, known_nodes=None)) if began else part,
                calibrated=found.settled.restricted(recording.sensors),
            )
        )
    return result


def _own(effect: Effect, began: float, start: float) -> Effect:
    """The catalogue's effect on a recording's own clock, from its first sample on where it begins before that."""
    own = delayed(EFFECTS[effect.name].from_mapping(vars(effect)), -began)
    values = vars(own)
    return own.from_mapping({**values, "at_s": max(values["at_s"], start)}) if "at_s" in values else own
