"""What follows from a diagnosis: its page, the improved rig, and what to record next where it leaves something open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.separation import rivals
from rig.errors import RigError
from rig.recording import Recording
from scenarios.diagnosing.equivalents import equivalents_of
from scenarios.diagnosing.improved_rig import improved_rig
from scenarios.diagnosing.task import About, Outcome, Task
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.page import page
from scenarios.plan.next_maneuver import next_step


def concluded(
    task: Task,
    diagnosis: Diagnosis,
    residuals: Sequence[GapResiduals],
    locked: Recording | None,
    about: About,
    made_from: Mapping[str, Any],
) -> Outcome:
    """The outcome of a task.

    Args:
        residuals: of each recording; the last one is what the rig is improved by.
        locked: the locked recording of that.
        made_from: as of ``Outcome.origin``.
    """
    last, open_between = residuals[-1], bool(rivals(diagnosis))
    rig, text, step, unsaved = None, None, None, None
    if task.improved or open_between:
        try:
            made = improved_rig(diagnosis, last, locked, task.rig)
            rig, text = made.scenario, made.to_toml()
        except RigError as error:  # never at the cost of the diagnosis
            unsaved = str(error) if task.improved else None
    if open_between:
        step = next_step(diagnosis, last, rig, task.minutes)
    words: dict[str, Any] = {"maneuver": None, **({} if step is None else step.words)}
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
        None if step is None else step.scenario,
        unsaved,
    )
