"""Solving a sealed set: the diagnosis of every recording, in parallel, picked up where it was left."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from rig.errors import RigError
from rig.files import write_text
from rig.threads import one_blas_thread
from scenarios.blind.seal import check_recording, file_hash, read_manifest
from scenarios.studies.executor import Workers

ANSWERS: Final = "answers"
_SOLVER: Final = "solver.json"
_FORMAT: Final = "rig-blind-answers/1"


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


def solve_set(folder: Path, workers: Workers, progress: Callable[[float], None] | None = None) -> int:
    """Diagnose every recording of a set into ``answers`` beside them; those already there are kept.

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
    progress: Callable[[float], None] | None = None,
) -> int:
    """Diagnose some recordings of a set with effects left out; as ``solve_set``."""
    output.mkdir(parents=True, exist_ok=True)
    check_solver(output)
    left = [(case, without) for case, without in cases if not answer_path(output, case["name"]).exists()]
    task = Task(str(folder), str(output), tuple(left))
    for done, _ in enumerate(workers.completed(_solve_one, task, range(len(left))), start=1):
        if progress is not None:
            progress(done / len(left))
    return len(left)


def answer_path(output: Path, name: str) -> Path:
    """Where the diagnosis of a case is."""
    return output / f"{name}.diagnosis.json"


def read_answer(output: Path, name: str) -> dict[str, Any]:
    """The diagnosis of a case, as JSON; a refusal has the verdict "refused".

    Raises:
        RigError: it has not been diagnosed.
    """
    path = answer_path(output, name)
    try:
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RigError(f"{path}: no diagnosis, expected those of rig blind solve") from error
    return document


def check_solver(output: Path) -> None:
    """Note which version of the diagnosis answers; refuse to mix two.

    Raises:
        RigError: answers are there of another version.
    """
    path = output / _SOLVER
    document = {"format": _FORMAT, "sources_sha256": solver_hash()}
    if path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))
        if found != document:
            raise RigError(
                f"{output}: holds answers of another version of the diagnosis: remove that folder to start anew"
            )
    else:
        write_text(path, json.dumps(document, indent=1) + "\n")


def noted_solver(output: Path) -> str:
    """SHA-256 of the sources that the answers were made by."""
    return str(json.loads((output / _SOLVER).read_text(encoding="utf-8"))["sources_sha256"])


@cache
def solver_hash() -> str:
    """SHA-256 of all that the diagnosis is made of: the sources of ``rig`` and ``estimators``."""
    import estimators
    import rig

    digest = hashlib.sha256()
    for package in (rig, estimators):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*.py")):
            digest.update(f"{package.__name__}/{path.relative_to(root).as_posix()}\n".encode())
            digest.update(bytes.fromhex(file_hash(path)))
    return digest.hexdigest()


def _solve_one(task: Task, number: int) -> None:
    from estimators.gap import diagnose

    case, without = task.cases[number]
    folder = Path(task.folder)
    check_recording(folder, case)
    path = answer_path(Path(task.output), case["name"])
    try:
        with one_blas_thread():
            found = diagnose(folder / case["recording"], folder / case["locked"], without=without)
    except RigError as error:
        refusal = {"format": "rig-diagnosis/1", "recording": case["name"], "verdict": "refused", "causes": []}
        write_text(path, json.dumps({**refusal, "why": str(error)}, indent=1) + "\n")
        return
    found.write(path)
