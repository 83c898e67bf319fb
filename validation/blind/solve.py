"""Solving a sealed set: the diagnosis of every recording, in parallel, picked up where it was left."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from rig.arm import Arm
from rig.errors import RigError
from rig.files import write_text
from rig.progress import Progress, unheard
from rig.threads import one_blas_thread
from scenarios.workers import Workers
from validation.blind.answers import Answers
from validation.blind.laboratories import TIP
from validation.blind.probability import FORMAT
from validation.blind.seal import check_recording, read_manifest

ANSWERS: Final = "answers"


@dataclass(frozen=True)
class Task:
    """What to diagnose.

    Attributes:
        folder: of the recordings.
        output: where the diagnoses go.
        cases: each the case's entry of the manifest and the effects to leave out of the catalogue.
    """

    folder: str
    output: str
    cases: tuple[tuple[dict[str, str], tuple[str, ...]], ...]


def solve_set(folder: Path, workers: Workers, progress: Progress = unheard) -> int:
    """Diagnose every recording of a set into ``answers`` beside them; those there as they were written are kept.

    A case that is refused, or at which the diagnosis fails, is recorded with the reason, and the others go on.

    Returns:
        How many were diagnosed now.

    Raises:
        RigError: no set, a recording that has changed, or answers of another version of the diagnosis.
    """
    cases = read_manifest(folder)
    return solve_cases(folder, folder / ANSWERS, [(case, ()) for case in cases], workers, progress)


def solve_cases(
    folder: Path,
    output: Path,
    cases: Iterable[tuple[dict[str, str], tuple[str, ...]]],
    workers: Workers,
    progress: Progress = unheard,
) -> int:
    """Diagnose some recordings of a set with effects left out; as ``solve_set``."""
    answers = Answers(output)
    asked = {case["name"]: (case, without) for case, without in cases}
    for name, (case, _) in asked.items():  # before anything is made
        answers.path(name)
        check_recording(folder, case)
    answers.begin()
    left = answers.missing(asked)
    task = Task(str(folder), str(output), tuple(asked[name] for name in left))
    for done, (number, _) in enumerate(workers.completed(partial(_solve_one, task), range(len(left))), start=1):
        answers.note(left[number])
        progress(done / len(left))
    return len(left)


def _solve_one(task: Task, number: int) -> None:
    from estimators.gap import diagnose

    case, without = task.cases[number]
    folder = Path(task.folder)
    check_recording(folder, case)
    path = Answers(Path(task.output)).path(case["name"])
    begun = time.perf_counter()
    try:
        with one_blas_thread():
            locked = folder / case["locked"] if case["locked"] else None
            arm = Arm.from_file(folder / case["arm"], TIP) if case["arm"] else None
            found = diagnose(folder / case["recording"], locked, without=without, arm=arm)
            found.write(path)
    except RigError as error:
        _give_up(path, case["name"], "refused", str(error), begun)
    except Exception as error:  # a fault of the diagnosis is one case's result, not the end of the run
        at = traceback.extract_tb(error.__traceback__)[-1]
        why = (
            f"{type(error).__name__}: {' '.join(str(error).split())[:200]} ({Path(at.filename).name}, line {at.lineno})"
        )
        _give_up(path, case["name"], "failed", why, begun)


def _give_up(path: Path, name: str, verdict: str, why: str, begun: float) -> None:
    """What stands for an answer that did not come about."""
    seconds = round(time.perf_counter() - begun, 3)
    document = {
        "format": FORMAT,
        "recordings": [name],
        "seconds": seconds,
        "verdict": verdict,
        "causes": [],
        "why": why,
    }
    write_text(path, json.dumps(document, indent=1) + "\n")
