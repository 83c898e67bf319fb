"""Recordings diagnosed, one or together, many side by side; whoever asked writes the files."""

from __future__ import annotations

import platform
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from estimators.calibration import Calibration
from estimators.gap.data.basefit import fitted_model
from estimators.gap.diagnose import examined
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.separation import rivals
from rig.arm import Arm
from rig.errors import RigError
from rig.memory import as_stated, stated
from rig.progress import Progress, unheard
from rig.recording import Recording, locked_beside, whole_or_means
from rig.threads import one_blas_thread
from scenarios.diagnosing.equivalents import equivalents_of
from scenarios.diagnosing.improved_rig import improved_rig
from scenarios.diagnosing.kept import origin
from scenarios.diagnosing.several import residuals_of_each
from scenarios.diagnosing.task import BYTES_A_SAMPLE, BYTES_ANYWAY, About, Outcome, Task
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.gap_residuals import GapResiduals, gap_residuals
from scenarios.gap_report.page import page
from scenarios.plan.next_maneuver import next_step
from scenarios.workers import Workers

__all__ = ["Outcome", "Task", "carry_out", "outcomes"]


def carry_out(task: Task, progress: Progress = unheard) -> Outcome:
    """Diagnose one recording, or several of one rig together, in this process, with one BLAS thread.

    Raises:
        RigError, RefusedFit: a recording cannot be read, or they cannot be diagnosed.
    """
    arm = None if task.arm_file is None else Arm.from_file(task.arm_file, task.tip)
    runs = (task.run, *task.others)
    together = len(runs) > 1 or task.calibration is not None
    means = partial(
        whole_or_means,
        joints=None if arm is None else arm.dof,
        bytes_a_sample=BYTES_A_SAMPLE * task.together * len(runs),
        fixed=BYTES_ANYWAY * task.together,
        fitted=None if together else partial(fitted_model, arm=arm),
    )
    read = [means(run) for run in runs]
    recordings = [recording for recording, _ in read]
    made_from = origin(task)
    if task.origin is not None and made_from["files_sha256"] != task.origin["files_sha256"]:
        raise RigError(f"{task.run}: is another file on {platform.node()}, expected the one to diagnose")
    rests: list[Recording | None] = []
    for run, (_, block) in zip(runs, read, strict=True):
        beside = task.locked or locked_beside(run)
        rests.append(None if beside is None else means(beside, block=block, fitted=None)[0])
    with one_blas_thread():
        if together:
            known = None if task.calibration is None else Calibration.read(task.calibration)
            found = examined(recordings, rests, None, task.without, arm, progress, task.prior, calibration=known)
            residuals = residuals_of_each(found)
        else:
            second = None if task.maneuver2 is None else means(task.maneuver2, block=read[0][1])[0]
            found = examined(recordings[0], rests[0], second, task.without, arm, progress, task.prior, task.rig)
            residuals = [gap_residuals(found.laid.recordings[0], found.diagnosis, rests[0], arm, found.data)]
        about = About.of(recordings[-1], max(block for _, block in read))
        return _concluded(task, found.diagnosis, residuals, rests[-1], about, made_from)


def _concluded(
    task: Task,
    diagnosis: Diagnosis,
    residuals: Sequence[GapResiduals],
    locked: Recording | None,
    about: About,
    made_from: Mapping[str, Any],
) -> Outcome:
    """What follows from a diagnosis: its page, the improved rig, and what to record next where something is left open.

    Args:
        residuals: of each recording; the last one is what the rig is improved by.
        locked: the locked recording of that.
        made_from: as of ``Outcome.origin``.
    """
    last = residuals[-1]
    rig, text, unsaved = None, None, None
    if task.improved or rivals(diagnosis):
        try:
            made = improved_rig(diagnosis, last, locked, task.rig)
            rig, text = made.scenario, made.to_toml()
        except RigError as error:  # never at the cost of the diagnosis
            unsaved = str(error) if task.improved else None
    told, proposal = next_step(diagnosis, last, rig, task.minutes)
    words = {"maneuver": None, **told}
    if len(residuals) == 1 and (same := equivalents_of(diagnosis, last)):
        words["equivalents"] = same
    diagnosis = replace(diagnosis, next=words)
    diagnosis = replace(diagnosis, next={**words, "steps": next_steps(diagnosis, task.arm_options)})
    units: dict[str, str] = {}
    for each in residuals:
        units |= each.recording.units
    return Outcome(
        diagnosis,
        page(diagnosis, residuals, task.without),
        about,
        made_from,
        units,
        text if task.improved else None,
        proposal,
        unsaved,
    )


def outcomes(
    tasks: Sequence[Task], workers: Workers, progress: Progress = unheard
) -> Iterator[tuple[int, Outcome | Exception]]:
    """The number of each task with its outcome, or with what stopped it, as they are done.

    Args:
        workers: where; a single task, or one after the other, in this process if it is this machine.
        progress: called with the share of all tasks that is done.

    Raises:
        RigError: as of ``Workers.completed``; a recording at which a worker dies is an outcome.
    """
    if workers.cluster is not None:
        tasks = [_elsewhere(task) for task in tasks]
    elif workers.at_once(len(tasks)) == 1:
        yield from _here(tasks, progress)
        return

    def lost(number: int) -> Outcome | Exception:
        return RigError(f"{tasks[number].run}: its process was killed (out of memory?), expected it to end")

    for done, (number, result) in enumerate(workers.completed(_attempt, tasks, lost), start=1):
        progress(done / len(tasks))
        yield number, result


def _elsewhere(task: Task) -> Task:
    """The task for another machine: its files by whole paths, and what they must be."""
    named = {name: getattr(task, name) for name in ("run", "locked", "maneuver2", "arm_file", "calibration")}
    whole = replace(task, memory=stated(), **{name: path and path.absolute() for name, path in named.items()})
    whole = replace(whole, others=tuple(path.absolute() for path in task.others))
    with suppress(RigError, OSError):  # what is missing its own turn will tell
        return replace(whole, origin=origin(whole))
    return whole


def _attempt(task: Task, progress: Progress = unheard) -> Outcome | Exception:
    """The outcome, or what stopped it: one recording does not stop the others."""
    try:
        with as_stated(task.memory):
            return carry_out(task, progress)
    except Exception as error:
        if not isinstance(error, RigError):
            error.add_note(traceback.format_exc())  # which does not come along from another process
        return error


def _here(tasks: Sequence[Task], progress: Progress) -> Iterator[tuple[int, Outcome | Exception]]:
    for number, task in enumerate(tasks):

        def share(part: float, before: int = number) -> None:
            progress((before + part) / len(tasks))

        result = _attempt(task, share)
        share(1.0)
        yield number, result
