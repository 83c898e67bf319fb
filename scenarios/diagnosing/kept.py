"""Diagnoses that are in a folder: written whole or not at all, and kept where they would come out the same again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from estimators.gap.diagnosis import Diagnosis
from estimators.gap.reading import diagnosis_of
from rig.arm.model_files import model_file
from rig.documents import read_json
from rig.errors import RigError
from rig.files import file_hash, made_folder, write_text, write_together
from rig.memory import stated
from rig.recording import locked_beside
from scenarios.diagnosing.task import About, Outcome, Task
from scenarios.version import package_version, sources_hash

#: In a diagnosis' file, beside the contract's keys: what it was made from, and whose recording that is.
ORIGIN = "made_from"
ABOUT = "about"
CORRECTED = "corrected_calibration"


def origin(task: Task) -> dict[str, Any]:
    """What a diagnosis is made from: the hashes of the files, the options, the version.

    Raises:
        RigError, OSError: a file is missing.
    """
    files = {"recording": task.run, "locked": task.locked or locked_beside(task.run), "maneuver2": task.maneuver2}
    files["calibration"] = task.calibration
    files |= {f"recording {number}": path for number, path in enumerate(task.others, start=2)}
    files["arm"] = None if task.arm_file is None else model_file(task.arm_file)
    return {
        "version": package_version(),
        "sources_sha256": sources_hash(),
        "files_sha256": {name: file_hash(path) for name, path in files.items() if path is not None},
        "options": {
            "without": sorted(task.without),
            "tip": task.tip,
            "minutes": task.minutes,
            "prior": None if task.prior is None else dict(sorted(task.prior.items())),
            "rig": None if task.rig is None else [task.rig.name, *map(repr, task.rig.effects), *task.rig.fitted_to],
        },
        "memory": stated(),
    }


def paths(out: Path, name: str) -> tuple[Path, Path, Path, Path]:
    """The diagnosis, its page, what to record next and the corrected calibration, of a recording's name."""
    kinds = ("diagnosis.json", "html", "next.toml", "calibration.json")
    document, page, proposal, calibration = (out / f"{name}.{kind}" for kind in kinds)
    return document, page, proposal, calibration


def kept(task: Task, out: Path) -> tuple[Diagnosis, About] | None:
    """The diagnosis of a task that is in the folder already; None where it is missing, or made from something else."""
    document, page, proposal, calibration = paths(out, task.run.stem)
    if task.improved or not (document.is_file() and page.is_file()):
        return None
    with suppress(RigError, OSError, TypeError, AttributeError, LookupError):  # something else by that name
        content = read_json(document, "a diagnosis")
        about = About(**content[ABOUT])
        found, wanted = dict(content[ORIGIN]), origin(task)
        if about.block == 1:  # the memory made no difference
            found.pop("memory", None)
            wanted.pop("memory", None)
        named = (content.get("next") or {}).get("scenario")
        whole = (named is None or proposal.is_file()) and (calibration.is_file() or not content[CORRECTED])
        if found == json.loads(json.dumps(wanted)) and whole:
            return diagnosis_of(content, str(document)), about
    return None


def document_of(outcome: Outcome) -> Mapping[str, Any]:
    """A diagnosis' file: the contract's object, whose recording it is, and what it was made from."""
    corrected = outcome.diagnosis.calibration is not None
    about = {ABOUT: vars(outcome.about), CORRECTED: corrected, ORIGIN: outcome.origin}
    return {**outcome.diagnosis.to_json(), **about}


def write_outcome(outcome: Outcome, out: Path, saved: Path | None = None) -> None:
    """All files of a recording or none.

    Args:
        out: the folder, which is made. saved: where the improved rig goes.

    Raises:
        RigError: a file cannot be written.
    """
    found, drawn, proposal, corrected = paths(out, outcome.diagnosis.name)
    again = found.exists()
    calibration = outcome.diagnosis.calibration
    texts = {
        drawn: outcome.page,
        found: json.dumps(document_of(outcome), indent=1, allow_nan=False) + "\n",
        corrected: None if calibration is None else calibration.to_text(),
        proposal: outcome.next,
    }
    if saved is not None:
        texts[saved] = outcome.scenario
    with made_folder(out):
        there = ((path, text) for path, text in texts.items() if text is not None)
        write_together(*((path, partial(write_text, text=text)) for path, text in there))
    for path, text in texts.items():
        if text is None and again and path != saved:
            path.unlink(missing_ok=True)  # of the earlier diagnosis
