"""The study of the numbers: each doubled, and how far that moves the probabilities of a few diagnoses."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from estimators.gap.choices import and_words
from rig.effects import Effect
from rig.errors import RigError
from rig.progress import Progress, unheard
from rig.recording import Recording
from rig.threads import one_blas_thread
from scenarios.workers import Workers
from validation.blind.draws import draw_effect
from validation.blind.outside import OUTSIDE
from validation.blind.settings import Setting
from validation.blind.strength import strength_for
from validation.loop.rigs import rigs_with_a_cause
from validation.markdown import list_of, table_of
from validation.numbers.listed import ROOMS, Number, numbers
from validation.numbers.swayed import with_number
from validation.study_page import make_page

#: Each number is doubled.
FACTOR: Final = 2.0
#: What is in the recordings: nothing, two effects of the catalogue, and a thing that is in none.
_WHAT: Final = ((), ("backlash", "bias_warmup"), ("moving_magnet",))
_SNR: Final = 40.0
_SWAYED: Final = 0.05


@dataclass(frozen=True)
class Settings:
    """What is studied.

    Attributes:
        samples: of every recording, at 4 Hz. seed: of everything random.
    """

    samples: int = 416
    seed: int = 1


@dataclass(frozen=True)
class Row:
    """A number at a factor.

    Attributes:
        module, name, factor: of the number; empty for the diagnosis as it is.
        told: the probabilities of each recording's diagnosis, as JSON; the error where it ended in one.
    """

    module: str
    name: str
    factor: float
    told: str


def trial(settings: Settings, number: int) -> pa.Table:
    """A number at a factor; the first is the diagnosis as it is."""
    if number == 0:
        from estimators import gap

        row = Row("", "", 1.0, _told(gap, settings))
    else:
        each = numbers()[number - 1]
        with with_number(each, each.moved(FACTOR)) as moved:
            row = Row(each.module, each.name, FACTOR, _told(moved, settings))
    return pa.Table.from_pylist([vars(row)])


def make_numbers(
    folder: Path, settings: Settings, workers: Workers, progress: Progress = unheard
) -> tuple[Path, tuple[Row, ...]]:
    """Write numbers.md and the table behind it; an ended study goes on. The page and all rows.

    Raises:
        RigError: the folder holds another study or cannot be written to, or as of ``Workers.completed``.
    """
    return make_page(folder, "numbers", settings, trial, 1 + len(numbers()), Row, _blocks, workers, progress)


@lru_cache(maxsize=1)
def recordings(settings: Settings) -> tuple[tuple[Recording, Recording | None], ...]:
    """What is diagnosed, with recordings at rest."""
    found = []
    for number, names in enumerate(_WHAT):
        setting, *_ = next(rigs_with_a_cause(settings.seed, number, settings.samples))
        rng = np.random.default_rng([settings.seed, number, 1])
        effects = tuple(_at_snr(name, rng, setting) for name in names)
        run = setting.record(effects, rng, f"run{number}")
        found.append((run, setting.record_locked(rng, f"run{number}.locked")))
    return tuple(found)


def _at_snr(name: str, rng: np.random.Generator, setting: Setting) -> Effect:
    make = OUTSIDE[name](rng, setting) if name in OUTSIDE else draw_effect(name, rng, setting)
    return strength_for(make, _SNR, setting)[0]


def _told(gap: Any, settings: Settings) -> str:
    """The probabilities of each recording: of nothing, something unknown, and each cause."""
    every = []
    with one_blas_thread():
        for run, locked in recordings(settings):
            try:
                found = gap.diagnose(run, locked).to_json()
            except Exception as error:  # whatever a number breaks, the page says so
                return f"{type(error).__name__}: {error}"
            told = {"verdict": found["verdict"], "nothing": found["posterior"]["nothing"]}
            told["other"] = found["posterior"]["other"]
            for cause in found["causes"]:
                label = f"{cause['effect']} at {cause['where']}"
                told[label] = max(told.get(label, 0.0), cause["probability"])
            every.append(told)
    return json.dumps(every)


def _blocks(settings: Settings, rows: Sequence[Row]) -> Iterator[str]:
    base = json.loads(rows[0].told)
    doubled = {(row.module, row.name): row.told for row in rows}
    every = numbers()
    for each in every:
        if (each.module, each.name) not in doubled:
            raise RigError(
                f"found a study of before there was {each.name} in {each.module}: remove that folder, to begin anew"
            )
    sways = {each: sway(base, doubled[each.module, each.name]) for each in every}
    fixed = [each for each in every if np.isinf(sways[each][0])]
    strong = [each for each in every if _SWAYED < sways[each][0] < np.inf]
    other = [each for each in every if sways[each][1] and each not in fixed]
    yield (
        f"<!-- Written by `python -m validation numbers -o docs --samples {settings.samples} --seed {settings.seed}`; "
        "do not edit. -->\n# The numbers that a diagnosis rests on"
    )
    yield (
        f"The {len(every)} constants of the diagnosis, from its source, with their reasons. Each was "
        "doubled (of a share the odds were, a count stays a count) and "
        "three recordings diagnosed anew: with nothing, with two causes, and with something outside the catalogue, "
        f"each of {settings.samples} samples and a signal-to-noise of {_SNR:g}. On the right stands the furthest that "
        "a probability of nothing, of something unknown, or of any cause moved. Where a number moves none, these "
        "recordings did not come to it, or only time depends on it."
    )
    calm = len(every) - len(strong) - len(fixed)
    told = [f"{calm} of {len(every)} move no probability by more than {_SWAYED:g}; {len(other)} change a verdict."]
    if strong:
        told.append(f"More sway {_named(strong)}.")
    if other:
        told.append(f"A verdict changes with {_named(other)}.")
    if fixed:
        told.append(f"Nothing is diagnosed with another {_named(fixed)}: that is no matter of choice.")
    yield list_of(told)
    for room in ROOMS:
        own = [each for each in every if each.room == room]
        if own:
            yield f"## {room}"
            yield table_of(("number", "value", "reason", "doubled"), [_row(each, *sways[each]) for each in own])


def _named(some: Sequence[Number]) -> str:
    return and_words([f"`{each.name}` ({each.room})" for each in some])


def _row(number: Number, moved: float, changed: bool) -> tuple[str, ...]:
    where = number.module.rsplit(".", 1)[1]
    told = f"{moved:.2f}{', another verdict' if changed else ''}" if np.isfinite(moved) else "fails"
    return f"`{number.name}` in {where}", number.text, number.reason, told


def sway(base: Sequence[dict[str, Any]], told: str) -> tuple[float, bool]:
    """The furthest that a probability moved, and whether a verdict changed; infinite where it ended in an error."""
    if not told.startswith("["):
        return np.inf, True
    furthest, changed = 0.0, False
    for before, after in zip(base, json.loads(told), strict=True):
        changed |= before["verdict"] != after["verdict"]
        for label in (before.keys() | after.keys()) - {"verdict"}:
            furthest = max(furthest, abs(before.get(label, 0.0) - after.get(label, 0.0)))
    return furthest, changed
