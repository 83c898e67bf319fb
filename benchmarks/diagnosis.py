"""The diagnosis of the sim-to-real gap: time and memory by length and by number of causes, cost of a candidate, growth.

Every diagnosis runs in a fresh process of its own, from the recording's file to the verdict, so that its peak memory is
its own; imports and the process's start are not in its time. There is no other program to compare with: beside it
stands the calibration of the same file.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

import scenarios
from benchmarks._child import Outcome, in_child
from benchmarks._measure import Cell, Column, Goal, Report, Settings, Table, Timing
from rig.effects import EFFECTS, Effect, Kind, make_effect

TITLE = "diagnosis of the sim-to-real gap: time, memory, cost of a candidate and growth"

_DECIMATIONS: Final = {1_664: 100, 6_656: 25, 166_400: 1}
_GOALS_S: Final = {6_656: 3.0, 166_400: 20.0}
_MOST_S: Final = 120.0
_BACKLASH: Final = ("backlash", {"where": "joint5", "width_rad": 0.01})
_CUBIC: Final = ("scale_cubic", {"where": "mag2", "fraction_of_full": 0.02})
_CAUSES: Final[tuple[tuple[str, tuple[tuple[str, dict[str, Any]], ...]], ...]] = (
    ("none", ()),
    ("one", (_BACKLASH,)),
    ("two", (_BACKLASH, _CUBIC)),
)


@dataclass(frozen=True)
class _Answer:
    """What a diagnosis in a process of its own said."""

    verdict: str
    causes: tuple[str, ...]
    seconds: float
    cpu_s: float
    calibration_s: float


def run(settings: Settings) -> Report:
    sizes = list(_DECIMATIONS)[: settings.of(3, 2)]
    rounds = settings.rounds_of(3, 1)
    with tempfile.TemporaryDirectory() as folder:
        files = {size: _recorded(Path(folder), size, settings.seed) for size in sizes}
        found: dict[tuple[int, str], list[Outcome]] = {}
        for number in range(rounds):
            for size in sizes:
                if number and size > 10_000:
                    continue
                for causes, _ in _CAUSES:
                    found.setdefault((size, causes), []).append(_outcome(files[size][causes]))
        by_length = _by_length(found)
        candidates = _per_candidate(files, sizes[:1] if settings.quick else sizes, rounds)
        parallel = _in_parallel([files[6_656][causes] for causes, _ in _CAUSES[:2]] * 2)
    times = {
        f"{size:,} samples, {causes} causes": {"diagnose": Timing(tuple(_seconds(outcome) for outcome in outcomes))}
        for (size, causes), outcomes in found.items()
        if all(math.isfinite(_seconds(outcome)) for outcome in outcomes)
    }
    return Report((by_length, candidates, parallel), tuple(_goals(found)), times)


def _recorded(folder: Path, size: int, seed: int) -> dict[str, Path]:
    """Recordings of the sweep with no, one and two causes, each with its locked recording beside it."""
    scenario = scenarios.load("ann-arbor").with_acquisition(decimation=_DECIMATIONS[size])
    locked = scenario.simulate_locked(seed)
    paths = {}
    for causes, effects in _CAUSES:
        made: list[Effect] = [make_effect(name, values) for name, values in effects]
        path = folder / f"{causes}{size}.parquet"
        scenario.with_effects(made).simulate(seed).write(path)
        locked.write(folder / f"{causes}{size}.locked.parquet")
        paths[causes] = path
    return paths


def _outcome(path: Path, without: Sequence[str] = ()) -> Outcome:
    return in_child(_diagnosed, str(path), tuple(without), most_s=_MOST_S)


def _diagnosed(path: str, without: tuple[str, ...]) -> _Answer:
    import estimators

    estimators.calibrate(path)  # imports, and the files into the system's memory
    begun = time.perf_counter()
    estimators.calibrate(path)
    calibrated, busy = time.perf_counter(), time.process_time()
    answer = estimators.diagnose(path, without=without)
    ended, done = time.perf_counter(), time.process_time()
    causes = tuple(f"{cause.effect} {cause.where}" for cause in answer.causes)
    return _Answer(answer.verdict, causes, ended - calibrated, done - busy, calibrated - begun)


def _seconds(outcome: Outcome) -> float:
    return float("inf") if outcome.result is None else float(outcome.result.seconds)


def _by_length(found: dict[tuple[int, str], list[Outcome]]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for (size, causes), outcomes in found.items():
        seconds = float(np.median([_seconds(outcome) for outcome in outcomes]))
        peak = max(outcome.peak_MiB for outcome in outcomes)
        answers = [outcome.result for outcome in outcomes if outcome.result is not None]
        smaller = [n for n, kind in found if kind == causes and n < size]
        growth: Cell = None
        if smaller:
            before = float(np.median([_seconds(outcome) for outcome in found[smaller[-1], causes]]))
            if math.isfinite(seconds):
                growth = math.log(seconds / before) / math.log(size / smaller[-1])
        cpu = None if not answers else float(np.median([answer.cpu_s for answer in answers]))
        ratio = None if not answers else seconds / float(np.median([answer.calibration_s for answer in answers]))
        problem = next((outcome.problem for outcome in outcomes if outcome.problem), None)
        verdict = problem or f"{answers[0].verdict}: {', '.join(answers[0].causes) or '–'}"
        rows.append((f"{size:,}", causes, _finite(seconds), cpu, growth, _finite(peak), ratio, verdict))
    columns = (
        Column("samples", ""),
        Column("causes in it", ""),
        Column("median [s]", ".3g"),
        Column("CPU time [s]", ".3g"),
        Column("growth [power of n]", ".2f"),
        Column("peak memory [MiB]", ".0f"),
        Column("/ calibration of the file", ".3g"),
        Column("verdict", ""),
    )
    note = (
        f"Growth: from the length before. Ended after {_MOST_S:g} s or 3 GiB. On a busy machine wall exceeds CPU time."
    )
    return Table("one recording, in a process of its own, file to verdict", columns, tuple(rows), note)


def _finite(value: float) -> Cell:
    return value if math.isfinite(value) else None


def _per_candidate(files: dict[int, dict[str, Path]], sizes: Sequence[int], rounds: int) -> Table:
    """Time against the size of the catalogue: the mean effects withheld all, by half, and not at all."""
    counts = {name: _places(effect) for name, effect in EFFECTS.items() if effect.kind is Kind.MEAN}
    withheld = {"all": tuple(counts), "every other": tuple(counts)[::2], "none": ()}
    rows: list[tuple[Cell, ...]] = []
    for size in sizes:
        if size > 10_000:
            rounds = 1
        seconds: dict[str, list[float]] = {kind: [] for kind in withheld}
        for _ in range(rounds):
            for kind, names in withheld.items():
                seconds[kind].append(_seconds(_outcome(files[size]["none"], names)))
        sizes_of = {kind: sum(counts[name] for name in counts if name not in names) for kind, names in withheld.items()}
        medians = {kind: float(np.median(values)) for kind, values in seconds.items()}
        slope = (medians["none"] - medians["all"]) / (sizes_of["none"] - sizes_of["all"])
        rows.append(
            (
                f"{size:,}",
                *(_finite(medians[kind]) for kind in withheld),
                _finite(1e3 * slope),
                _finite(1e6 * slope / size),
            )
        )
    columns = (
        Column("samples", ""),
        *(
            Column(f"{sum(counts[name] for name in counts if name not in names)} candidates [s]")
            for names in withheld.values()
        ),
        Column("each [ms]"),
        Column("each and sample [µs]"),
    )
    note = "A candidate is an effect at a place; its shapes are searched within its cost. Recordings without a gap."
    return Table("cost of a candidate", columns, tuple(rows), note)


def _places(effect: type[Effect]) -> int:
    return len(effect.places) * math.prod(len(values) for values in effect.choices().values())


def _in_parallel(paths: Sequence[Path]) -> Table:
    """Several recordings one after another, and on all cores."""
    rows: list[tuple[Cell, ...]] = []
    alone = None
    for workers in (1, os.cpu_count() or 1):
        begun = time.perf_counter()
        with ThreadPoolExecutor(workers) as pool:
            outcomes = list(pool.map(_outcome, paths))
        wall = time.perf_counter() - begun
        alone = wall if alone is None else alone
        peak = sum(sorted((outcome.peak_MiB for outcome in outcomes), reverse=True)[:workers])
        rows.append((workers, wall, 60.0 * len(paths) / wall, alone / wall, _finite(peak)))
    columns = (
        Column("processes", "d"),
        Column("wall time [s]", ".3g"),
        Column("recordings a minute", ".3g"),
        Column("times one process", ".2f"),
        Column("memory of all [MiB]", ".0f"),
    )
    return Table(f"{len(paths)} recordings of 6,656 samples, with the processes' start", columns, tuple(rows))


def _goals(found: dict[tuple[int, str], list[Outcome]]) -> list[Goal]:
    goals = []
    for size, limit in _GOALS_S.items():
        outcomes = {causes: found[size, causes] for causes, _ in _CAUSES if (size, causes) in found}
        if not outcomes:
            continue
        slowest = max(float(np.median([_seconds(outcome) for outcome in each])) for each in outcomes.values())
        peak = max(outcome.peak_MiB for each in outcomes.values() for outcome in each)
        goals.append(Goal(f"{size:,} samples, slowest of no, one and two causes [s]", slowest, "at most", limit))
        goals.append(Goal(f"{size:,} samples, peak memory [MiB]", peak, "at most", 1024.0))
    return goals
