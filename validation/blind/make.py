"""Making a sealed set: recordings in one folder, their truth in another."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from rig.errors import RigError
from rig.files import atomic_path, file_hash, made_folder, write_text
from rig.progress import Progress, unheard
from rig.threads import one_blas_thread
from scenarios.loader import load
from scenarios.workers import Workers
from validation.blind.cases import Case, make_case
from validation.blind.laboratories import LABORATORIES
from validation.blind.seal import (
    CHANGES,
    MANIFEST,
    TRUTH_FORMAT,
    commitment,
    new_salt,
    write_manifest,
    write_truth,
)
from validation.blind.strata import Plan, plans

#: Samples of the paper's sweep at 4 Hz.
SAMPLES = 6656


@dataclass(frozen=True)
class Order:
    """What to make; the same order makes the same recordings.

    Attributes:
        folder, sealed: for the recordings, and for the truth.
        seed: of everything random. It is sealed too: who knows it can make the truth again.
        cases, mechanics: numbers of cases.
        samples: of each recording.
        scenario: what the rigs are drawn around.
    """

    folder: str
    sealed: str
    seed: int
    cases: int
    mechanics: int = 0
    samples: int = SAMPLES
    scenario: str = "ann-arbor"

    @property
    def plans(self) -> list[Plan]:
        """What each case is to hold."""
        return plans(self.cases, np.random.default_rng([self.seed, 0]), self.mechanics)


def make_set(order: Order, workers: Workers | None = None, progress: Progress = unheard) -> int:
    """Make all cases and seal them.

    Returns:
        The number of cases.

    Raises:
        RigError: a folder holds a set already, the truth would lie beside the recordings, or a case cannot be made.
    """
    folder, sealed = Path(order.folder), Path(order.sealed)
    if (folder / MANIFEST).exists():
        raise RigError(f"{folder}: holds a set already, expected a new folder")
    if sealed.resolve().is_relative_to(folder.resolve()):
        raise RigError(f"{sealed}: lies in the folder of the recordings, expected another for the truth")
    count = len(order.plans)
    entries: dict[int, tuple[dict[str, str], dict[str, object]]] = {}
    with made_folder(folder, linked=False), made_folder(sealed / CHANGES, linked=False):
        for number, entry in (workers or Workers(0)).completed(partial(_make_one, order), range(count)):
            entries[number] = entry
            progress(len(entries) / count)
    open_half = [entries[number][0] for number in range(count)]
    sealed_half = {entries[number][0]["name"]: entries[number][1] for number in range(count)}
    settings = {key: value for key, value in vars(order).items() if key not in ("folder", "sealed")}
    write_truth(sealed, {"format": TRUTH_FORMAT, "order": settings, "cases": sealed_half})
    write_manifest(folder, open_half)
    return count


def _make_one(order: Order, number: int) -> tuple[dict[str, str], dict[str, object]]:
    """Write one case; gives its open and its sealed entry."""
    folder, sealed = Path(order.folder), Path(order.sealed)
    name = f"case{number:03d}"
    with one_blas_thread():
        plan, case = _drawn(order, number, name)
    files = {"recording": f"{name}.parquet", "locked": "" if case.locked is None else f"{name}.locked.parquet"}
    case.recording.write(folder / files["recording"])
    if case.locked is not None:
        case.locked.write(folder / files["locked"])
    model = LABORATORIES[plan.laboratory].model
    if model is not None:
        files["arm"] = f"{name}.urdf"
        write_text(folder / files["arm"], model.read_text(encoding="utf-8"))
    change = sealed / CHANGES / f"{name}.npz"
    with atomic_path(change) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, change=case.change.astype(np.float32))
    truth = json.loads(json.dumps(replace(case.truth, change_sha256=file_hash(change)).to_json()))
    salt = new_salt()
    opened = {
        "name": name,
        **files,
        **{f"{key}_sha256": file_hash(folder / file) for key, file in files.items() if file},
    }
    return {**opened, "commitment": commitment(salt, truth)}, {"salt": salt, "truth": truth}


def _drawn(order: Order, number: int, name: str) -> tuple[Plan, Case]:
    """A case by its plan; where no draw of that can be as asked, by the next plan of its stratum.

    Two effects can be so much alike on every sweep that neither is left beside the other.
    """
    every, scenario = order.plans, load(order.scenario)
    seed = np.random.SeedSequence([order.seed, 1, number])
    stratum = every[number].stratum
    failed: RigError | None = None
    for plan in (every[number], *every[number + 1 :], *every[:number]):
        if plan.stratum != stratum:
            continue
        try:
            return plan, make_case(name, plan, scenario, order.samples, seed)
        except RigError as error:
            failed = failed or error
    assert failed is not None
    raise failed
