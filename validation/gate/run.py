"""The study of the gate: fitted rigs with a wrong cause and with what was found, judged on fresh recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from estimators.gap.diagnose import diagnose, examined
from estimators.gap.report.fitted_rig import FittedRig, known_to
from rig.progress import Progress, unheard
from rig.threads import one_blas_thread
from scenarios.gap_report.words import cause_title
from scenarios.workers import Workers
from validation.blind.intervals import Rate
from validation.gate.forced import LEFT, forced_rig
from validation.loop.rigs import STRENGTHS
from validation.markdown import list_of, table_of
from validation.study_page import make_page


@dataclass(frozen=True)
class Settings:
    """What is studied.

    Attributes:
        rigs: how many. samples: of every recording, at 4 Hz. seed: of everything random.
    """

    rigs: int = 24
    samples: int = 1664
    seed: int = 1


@dataclass(frozen=True)
class Row:
    """One rig.

    Attributes:
        truth, wrong: the cause, and the one that was forced in. snr: of the truth. left: signal-to-noise that the wrong
            one leaves.
        passed: whether the gate called the rig with the wrong cause better than the ideal one.
        found: whether the diagnosis' leading cause is the truth. better: whether the gate called that rig better.
        share: of the squared gap that it leaves on the fresh recording; NaN where nothing else was found.
    """

    rig: int
    truth: str
    wrong: str
    snr: float
    left: float
    passed: bool
    found: bool
    better: bool
    share: float


def trial(settings: Settings, number: int) -> pa.Table:
    """One rig, recorded twice: the first recording chooses a rig, the second judges it."""
    with one_blas_thread():
        rig = forced_rig(settings.seed, number, settings.samples)

        def rng(what: int) -> np.random.Generator:
            return np.random.default_rng([settings.seed, number, what])

        locked = rig.setting.record_locked(rng(1), "hidden.locked")
        first, fresh = (rig.setting.record((rig.truth,), rng(what), f"run{what}") for what in (2, 3))
        forced = diagnose(fresh, locked, rig=FittedRig("wrong", (rig.wrong,), std=(rig.std,))).rig
        told = examined(first, locked)
        chosen = tuple(told.effects)
        found = [(each.name, each.where) for each in chosen] == [(rig.truth.name, rig.truth.where)]
        known = tuple(known_to(each, told.diagnosis) for each in chosen)
        own = diagnose(fresh, locked, rig=FittedRig("found", chosen, std=known)).rig if found else None
    assert forced is not None
    row = Row(
        rig=number,
        truth=cause_title(rig.truth.name, rig.truth.where),
        wrong=cause_title(rig.wrong.name, rig.wrong.where),
        snr=rig.snr,
        left=rig.left,
        passed=bool(forced["better"]),
        found=found,
        better=own is not None and bool(own["better"]),
        share=np.nan if own is None or own["left"] is None else float(own["left"]),
    )
    return pa.Table.from_pylist([vars(row)])


def make_gate(
    folder: Path, settings: Settings, workers: Workers, progress: Progress = unheard
) -> tuple[Path, tuple[Row, ...]]:
    """Write gate.md and the table behind it; an ended study goes on. The page and all rows.

    Raises:
        RigError: the folder holds another study or cannot be written to, or as of ``Workers.completed``.
    """
    return make_page(folder, "gate", settings, trial, settings.rigs, Row, _blocks, workers, progress)


def _blocks(settings: Settings, rows: Sequence[Row]) -> Iterator[str]:
    command = f"--rigs {settings.rigs} --samples {settings.samples} --seed {settings.seed}"
    refused = Rate(sum(not row.passed for row in rows), len(rows))
    right = [row for row in rows if row.found]
    better = Rate(sum(row.better for row in right), len(right))
    shares = [row.share for row in right if np.isfinite(row.share)]
    yield (
        f"<!-- Written by `python -m validation gate -o docs {command}`; do not edit. -->\n"
        "# The gate: is a fitted rig called better only where it is?"
    )
    yield (
        f"{settings.rigs} rigs with one cause each, at a signal-to-noise of {STRENGTHS[0]:g} to {STRENGTHS[1]:g}, each "
        f"recorded twice ({settings.samples:,} samples at 4 Hz). A wrong cause is forced into the model: of all others "
        f"the one that leaves the least above a signal-to-noise of {LEFT:g}, at its best strength. The second recording"
        ", which chose nothing, judges that rig, and the rig with what the first recording was diagnosed with."
    )
    left = f"; it leaves {100.0 * float(np.median(shares)):.2g} % of the squared gap at the median" if shares else ""
    yield list_of(
        (
            f"The rig with the wrong cause is refused in {refused}.",
            f"Where the diagnosis led with the truth, the rig with it is called better in {better}{left}.",
        )
    )
    columns = ("rig", "cause", "signal-to-noise", "wrong cause", "leaves", "refused", "own diagnosis", "called better")
    yield table_of(columns, [_row(row) for row in rows])


def _row(row: Row) -> tuple[str, ...]:
    words = ("no", "yes")
    own = ("the truth", words[row.better]) if row.found else ("other", "–")
    return str(row.rig), row.truth, f"{row.snr:.0f}", row.wrong, f"{row.left:.1f}", words[not row.passed], *own
