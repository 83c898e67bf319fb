"""Scoring a solved set: the seal is opened, every answer is judged, and the withheld pass and the baselines are run.

The withheld pass belongs to the scorer. Which effect is to be left out of a recording's diagnosis is the answer itself,
so the solver cannot be told: once its answers are there, the scorer runs the same diagnosis again on every recording
with a single cause of the catalogue, that cause's name taken out, and keeps these answers beside the truth.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final
from zipfile import ZipFile

import numpy as np

from rig.arm import Arm
from rig.channels import CHANNELS
from rig.errors import RigError
from rig.files import child, file_hash, write_text
from rig.progress import Progress, unheard
from rig.recording import read_recording
from rig.threads import one_blas_thread
from scenarios.studies.table_files import fitting_together
from scenarios.workers import Workers
from validation.blind.answers import Answers
from validation.blind.baselines import BASELINES, baseline_answers
from validation.blind.estimates import Stated, stated
from validation.blind.laboratories import TIP
from validation.blind.outcome import CONFIDENT, Outcome, judge
from validation.blind.probability import Claim, Proper, check_answer, claims, proper
from validation.blind.seal import CHANGES, TRUTH, check_recording, read_manifest, read_truth
from validation.blind.solve import ANSWERS, solve_cases
from validation.blind.strata import MECHANICS
from validation.blind.true_closure import Closure, closure
from validation.blind.truth import Truth

WITHHELD_FOLDER: Final = "withheld"
_BASELINE_FOLDER: Final = "baselines"
_HEADER: Final = 4096  # of an array in its file, at most [bytes]


@dataclass(frozen=True)
class CaseScore:
    """One case: truth, answer, and what was right about it.

    Attributes:
        withheld: the answer without the true effect's name, and how it was judged; None where that was not asked.
        baselines: how the simple judges' answers were judged.
        scores: the answer's proper scores; of the one without the true effect's name, ``withheld_scores``.
        claims: what it says with a probability. stated: its parameters beside the true ones.
    """

    truth: Truth
    answer: dict[str, Any]
    outcome: Outcome
    closure: Closure
    withheld: tuple[dict[str, Any], Outcome] | None = None
    baselines: dict[str, Outcome] = field(default_factory=dict)
    scores: Proper = field(default_factory=lambda: Proper(0.0, 0.0, 1.0))
    withheld_scores: Proper | None = None
    claims: tuple[Claim, ...] = ()
    stated: tuple[Stated, ...] = ()


def score_set(
    folder: Path, sealed: Path, workers: Workers, progress: Progress = unheard, withheld: bool = True
) -> list[CaseScore]:
    """Open the seal and judge all answers; those that are missing for the withheld pass and the baselines are made.

    Args:
        withheld: whether to run the withheld pass.

    Raises:
        RigError: recordings, truth or answers are missing or have changed.
    """
    cases = read_manifest(folder)
    for case in cases:
        check_recording(folder, case)
        Answers(folder / ANSWERS).read(case["name"])
    with fitting_together(sealed / TRUTH):
        truths = {name: Truth.from_json(each) for name, each in read_truth(sealed, cases).items()}
    half = 0.5 if withheld else 0.0
    if withheld:
        asked = [(case, (withheld_effect(truths[case["name"]]),)) for case in cases]
        asked = [(case, left_out) for case, left_out in asked if left_out[0]]
        solve_cases(folder, sealed / WITHHELD_FOLDER, asked, workers, lambda share: progress(half * share))
    simple = [case for case in cases if truths[case["name"]].laboratory == "sweep"]
    _run_baselines(folder, sealed, simple, workers, lambda share: progress(half + (1.0 - half) * share))
    scores = []
    for case in cases:
        with fitting_together(Answers(folder / ANSWERS).path(case["name"])):
            scores.append(_score_one(folder, sealed, case, truths[case["name"]]))
    return scores


def withheld_effect(truth: Truth) -> str:
    """The effect to leave out in the withheld pass: that of a single visible cause; empty where there is none."""
    single = truth.stratum in ("one", MECHANICS) and len(truth.visible) == 1
    return truth.visible[0].effect if single else ""


def _score_one(folder: Path, sealed: Path, case: dict[str, str], truth: Truth) -> CaseScore:
    name, answers = case["name"], Answers(folder / ANSWERS)
    answer = answers.read(name)
    check_answer(answer, str(answers.path(name)))
    recording = read_recording(folder / case["recording"])
    compared = closure(
        truth, _change(sealed, truth, len(recording)), recording, answer, answers.path(name), _arm(folder, case)
    )
    second, scores = None, None
    left_out = withheld_effect(truth)
    withheld = Answers(sealed / WITHHELD_FOLDER)
    if left_out and withheld.path(name).exists():
        again = withheld.read(name)
        check_answer(again, str(withheld.path(name)))
        second, scores = (again, judge(truth, again, left_out)), proper(truth, again, left_out)
    judged = {}
    if truth.laboratory == "sweep":
        simple = Answers(sealed / _BASELINE_FOLDER, ".json").read(name)
        judged = {judge_name: judge(truth, simple[judge_name]) for judge_name in BASELINES}
    return CaseScore(
        truth,
        answer,
        judge(truth, answer),
        compared,
        second,
        judged,
        proper(truth, answer),
        scores,
        tuple(claims(truth, answer)),
        tuple(stated(truth, answer)),
    )


def _arm(folder: Path, case: dict[str, str]) -> Arm:
    return Arm.from_file(folder / case["arm"], TIP) if case["arm"] else Arm.a465()


def _change(sealed: Path, truth: Truth, samples: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    path = child(sealed / CHANGES, f"{truth.case}.npz", str(sealed))
    if not path.is_file() or file_hash(path) != truth.change_sha256:
        raise RigError(f"{path}: missing or changed since it was sealed")
    with ZipFile(path) as archive:  # a few bytes of it can unpack to any size
        unpacked = sum(entry.file_size for entry in archive.infolist())
    if unpacked > (expected := samples * len(CHANNELS) * np.dtype(np.float32).itemsize + _HEADER):
        raise RigError(f"{path}: unpacks to {unpacked} bytes, expected {expected} at most for {samples} samples")
    with np.load(path) as arrays:
        return np.asarray(arrays["change"], dtype=float)


@dataclass(frozen=True)
class _Asked:
    folder: str
    output: str
    cases: tuple[dict[str, str], ...]


def _run_baselines(
    folder: Path, sealed: Path, cases: list[dict[str, str]], workers: Workers, progress: Progress
) -> None:
    answers = Answers(sealed / _BASELINE_FOLDER, ".json")
    answers.begin()
    missing = set(answers.missing(case["name"] for case in cases))
    left = tuple(case for case in cases if case["name"] in missing)
    asked = _Asked(str(folder), str(answers.folder), left)
    for done, (number, _) in enumerate(workers.completed(partial(_baseline_one, asked), range(len(left))), start=1):
        answers.note(left[number]["name"])
        progress(done / len(left))


def _baseline_one(asked: _Asked, number: int) -> None:
    case, folder = asked.cases[number], Path(asked.folder)
    check_recording(folder, case)
    with one_blas_thread():
        answers = baseline_answers(folder / case["recording"], folder / case["locked"])
    write_text(Answers(Path(asked.output), ".json").path(case["name"]), json.dumps(answers, indent=1) + "\n")


def is_right(score: CaseScore) -> bool:
    """Whether a case's answer is what its stratum asks for."""
    truth, outcome = score.truth, score.outcome
    if outcome.verdict in ("refused", "failed"):
        return False
    if any(not each.effect for each in truth.visible):  # something that no catalogue has, with or without known causes
        return outcome.verdict in ("unknown", "partly") and not outcome.confidently_wrong
    if not truth.visible:
        return outcome.verdict == "no-gap" or (bool(truth.causes) and bool(outcome.first))
    if truth.stratum in ("form", MECHANICS):
        return not outcome.confidently_wrong and (bool(outcome.in_set) or outcome.verdict in ("unknown", "partly"))
    return outcome.verdict in CONFIDENT and not outcome.confidently_wrong and bool(outcome.in_set)


def summary(scores: list[CaseScore]) -> list[dict[str, Any]]:
    """Every case in plain values, for machines."""
    return [
        {
            "case": score.truth.case,
            "stratum": score.truth.stratum,
            "right": is_right(score),
            "seconds": score.answer.get("seconds"),
            "mass_on_truth": score.scores.mass,
            "log_score": score.scores.log,
            "brier": score.scores.brier,
            "withheld_mass": None if score.withheld_scores is None else score.withheld_scores.mass,
            **asdict(score.outcome),
            "closure": asdict(score.closure),
            "withheld": None if score.withheld is None else asdict(score.withheld[1]),
            "baselines": {name: asdict(outcome) for name, outcome in score.baselines.items()},
        }
        for score in scores
    ]
