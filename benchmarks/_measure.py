"""Timing in interleaved rounds, and the tables, goals and reports that a benchmark is made of."""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

Call = Callable[[], object]
Cell = str | float | int | None

#: A single timing lasts at least so long, by repeating a short call [s].
_SHORTEST: Final = 4e-3
#: No call is repeated more often than this within one timing.
_MOST_REPEATS: Final = 200


@dataclass(frozen=True)
class Settings:
    """How thoroughly to measure.

    Attributes:
        quick: smaller problems and fewer rounds, to see that everything runs; its figures are not for quoting.
        rounds: of interleaved timings; None: each benchmark's own number.
        seed: of everything random.
    """

    quick: bool = False
    rounds: int | None = None
    seed: int = 0

    def of(self, full: int, quick: int) -> int:
        """One number or the other."""
        return quick if self.quick else full

    def rounds_of(self, full: int, quick: int) -> int:
        """The number of rounds that was asked for, else one or the other."""
        return self.of(full, quick) if self.rounds is None else self.rounds


@dataclass(frozen=True)
class Timing:
    """Times of one call, in the order of the rounds.

    Attributes:
        seconds: by the wall clock [s].
        cpu: of all the process's threads [s]; empty: not known. A wall clock well above it says that the machine had
            other things to do.
    """

    seconds: tuple[float, ...]
    cpu: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    @property
    def spread(self) -> float:
        """Half the distance between the quartiles over the median."""
        if len(self.seconds) < 4:
            return (max(self.seconds) - min(self.seconds)) / (2.0 * self.median)
        low, _, high = statistics.quantiles(self.seconds, n=4)
        return (high - low) / (2.0 * self.median)

    def over(self, other: Timing) -> float:
        """Median of the ratios of times in the same round: what both shared of the machine's load cancels."""
        return statistics.median(a / b for a, b in zip(self.seconds, other.seconds, strict=False))


def interleaved(calls: Mapping[str, Call], rounds: int, fewer: Mapping[str, int] | None = None) -> dict[str, Timing]:
    """Time calls in rounds A, B, C, A, B, C, .., so that a machine busy with other things biases all alike.

    Each is called once before, untimed. A short call is repeated within a round, until it lasts some milliseconds.

    Args:
        calls: by name.
        rounds: how many.
        fewer: calls that take part in the first rounds only, by name; and without the untimed call.
    """
    limits = {name: (fewer or {}).get(name, rounds) for name in calls}
    repeats = dict.fromkeys(calls, 1)
    for name, call in calls.items():
        if name in (fewer or {}):
            continue
        call()
        begun = time.perf_counter()
        call()
        elapsed = time.perf_counter() - begun
        repeats[name] = min(max(1, math.ceil(_SHORTEST / max(elapsed, 1e-7))), _MOST_REPEATS)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    gc.collect()
    collecting = gc.isenabled()
    gc.disable()
    try:
        for number in range(rounds):
            for name, call in calls.items():
                if number >= limits[name]:
                    continue
                begun, busy = time.perf_counter(), time.process_time()
                for _ in range(repeats[name]):
                    call()
                ended, done = time.perf_counter(), time.process_time()
                times[name].append(((ended - begun) / repeats[name], (done - busy) / repeats[name]))
    finally:
        if collecting:
            gc.enable()
    return {name: Timing(*map(tuple, zip(*values, strict=True))) for name, values in times.items()}


@dataclass(frozen=True)
class Column:
    """A column: its heading with the unit, and how a number in it is written."""

    heading: str
    format: str = ".3g"

    def text(self, value: Cell) -> str:
        if value is None or value != value:
            return "–"
        return value if isinstance(value, str) else format(value, self.format)


def plain(cell: Cell) -> Cell:
    """As JSON has it: numbers that are none become null."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


@dataclass(frozen=True)
class Table:
    """Rows of names and numbers; what a number means is in the heading, what the table shows in the title."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"table {self.title!r}: a row of {len(row)} cells, expected {len(self.columns)}")

    def to_dict(self) -> dict[str, Any]:
        headings = [column.heading for column in self.columns]
        rows = [dict(zip(headings, (plain(cell) for cell in row), strict=True)) for row in self.rows]
        return {"title": self.title, "rows": rows, "note": self.note}


@dataclass(frozen=True)
class Goal:
    """What a figure is to be.

    Attributes:
        what: in words, with the unit.
        value: measured; infinite: it did not come to an end within its limits; NaN: it could not be measured here.
        sense, limit: "at most" or "at least" this.
    """

    what: str
    value: float
    sense: Literal["at most", "at least"]
    limit: float

    @property
    def met(self) -> bool | None:
        """None where it could not be measured."""
        if math.isnan(self.value):
            return None
        return self.value <= self.limit if self.sense == "at most" else self.value >= self.limit

    def to_dict(self) -> dict[str, Any]:
        return {
            "what": self.what,
            "value": plain(self.value),
            "sense": self.sense,
            "limit": self.limit,
            "met": self.met,
        }


@dataclass(frozen=True)
class Report:
    """What a benchmark found.

    Attributes:
        tables: for people.
        goals: what was to be reached.
        times: every single timing [s], by table or case and call, for the JSON.
    """

    tables: tuple[Table, ...]
    goals: tuple[Goal, ...] = ()
    times: Mapping[str, Mapping[str, Timing]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        return {
            "tables": [table.to_dict() for table in self.tables],
            "goals": [goal.to_dict() for goal in self.goals],
            "times_s": {
                case: {name: list(timing.seconds) for name, timing in timings.items()}
                for case, timings in self.times.items()
            },
        }


def timing_table(
    title: str,
    timings: Mapping[str, Timing],
    beside: Sequence[str],
    further: Mapping[str, Mapping[str, Cell]] | None = None,
    formats: Mapping[str, str] | None = None,
    note: str = "",
) -> Table:
    """A row for each call: median, spread, and the ratios to some of them.

    Args:
        title, note: of the table.
        timings: by name.
        beside: names of the calls to divide by.
        further: heading -> name -> cell, for further columns such as errors.
        formats: heading -> format of its numbers.
    """
    more = further or {}
    columns = [
        Column("call", ""),
        Column("median [ms]", ".4g"),
        Column("± [%]", ".1f"),
        Column("CPU [ms]", ".4g"),
        *(Column(f"/ {name}", ".3g") for name in beside),
        *(Column(heading, (formats or {}).get(heading, ".3g")) for heading in more),
    ]
    rows = []
    for name, timing in timings.items():
        ratios = [None if name == other else timing.over(timings[other]) for other in beside]
        cells = [cells.get(name) for cells in more.values()]
        cpu = 1e3 * statistics.median(timing.cpu) if timing.cpu else None
        rows.append((name, 1e3 * timing.median, 100.0 * timing.spread, cpu, *ratios, *cells))
    return Table(title, tuple(columns), tuple(rows), note)
