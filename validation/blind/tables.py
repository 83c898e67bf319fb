"""The figures of a scored set, stratum by stratum, as rows of a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from validation.blind.baselines import BASELINES
from validation.blind.intervals import Rate
from validation.blind.outcome import Outcome
from validation.blind.scoring import CaseScore
from validation.blind.strata import FURTHER, MECHANICS, STRATA, STRENGTHS
from validation.markdown import Table

Scores = Sequence[CaseScore]

_LISTED: Final = 4  # equivalents that are written out
#: The strata that hold something to be found.
_HOLDING: Final = (*(each for each in STRATA if each not in ("none", "absorbed")), MECHANICS)


def floor_name(score: CaseScore) -> str:
    """White, coloured, 1/f, a walk, or of long tails."""
    return score.truth.floor_kind


def _floors(scores: Scores) -> list[str]:
    return sorted({score.truth.floor_kind for score in scores}, key=lambda kind: (kind != "white", kind))


def quiet(score: CaseScore) -> bool:
    """Whether nobody can be asked to see anything."""
    return not score.truth.causes or score.truth.stratum == "absorbed"


def in_strata(scores: Scores, *strata: str) -> list[CaseScore]:
    """The cases of some strata."""
    return [score for score in scores if score.truth.stratum in strata]


def _visible(scores: Scores, *strata: str) -> list[CaseScore]:
    return [score for score in in_strata(scores, *strata) if score.truth.visible]


def rate(scores: Iterable[CaseScore], value: Callable[[Outcome], float]) -> Rate:
    """The mean of something over outcomes."""
    return Rate.of(value(score.outcome) for score in scores)


def quiet_table(scores: Scores) -> Table:
    """False alarms where there is nothing to be seen, by floor."""
    rows = []
    for floor in _floors(scores):
        for stratum in ("none", "absorbed"):
            found = [score for score in in_strata(scores, stratum) if floor_name(score) == floor]
            if found:
                silent = rate(found, lambda each: float(each.verdict == "no-gap"))
                named = rate(found, lambda each: each.confidently_wrong)
                rows.append((stratum, floor, str(len(found)), str(silent), str(named)))
    columns = ("stratum", "floor", "cases", "no-gap", "named with confidence")
    return Table("Nothing to be seen", columns, tuple(rows))


def strata_table(scores: Scores) -> Table:
    """All strata that hold something, in one table."""
    groups = {stratum: _visible(scores, stratum) for stratum in _HOLDING}
    return Table("What was found", ("stratum", *_COLUMNS), _rows(groups))


def mechanics_table(scores: Scores) -> Table:
    """Mechanics case by case: what the mechanism is, and what it was called."""
    rows = []
    for score in in_strata(scores, MECHANICS):
        cause = score.truth.causes[0]
        rows.append(
            (cause.name.replace("_", " "), f"{cause.snr:.0f}", f"{cause.effect} at {cause.where}", said(score.answer))
        )
    return Table("Mechanics", ("mechanism", "signal-to-noise", "should be called", "answer"), tuple(sorted(rows)))


def said(answer: Mapping[str, Any]) -> str:
    """An answer in words."""
    causes = []
    for cause in answer["causes"]:
        others = [f"{each['effect']} at {each['where']}" for each in cause["equivalent"]]
        more = f" or {len(others)} others" if len(others) > _LISTED else "".join(f" or {each}" for each in others)
        causes.append(f"{cause['effect']} at {cause['where']}{more}")
    return str(answer["verdict"]) + (f": {'; '.join(causes)}" if causes else "")


def strength_table(scores: Scores, *strata: str) -> Table:
    """The same by wanted strength."""
    cases = in_strata(scores, *strata)
    groups = {f"{each:g}": [score for score in cases if each in score.truth.wanted[:1]] for each in STRENGTHS}
    return Table(f"By signal-to-noise: {', '.join(strata)}", ("signal-to-noise", *_COLUMNS), _rows(groups))


def floor_table(scores: Scores, *strata: str) -> Table:
    """The same by floor."""
    cases = _visible(scores, *strata)
    groups = {floor: [score for score in cases if floor_name(score) == floor] for floor in _floors(scores)}
    return Table(f"By floor: {', '.join(strata)}", ("floor", *_COLUMNS), _rows(groups))


def withheld_table(scores: Scores) -> Table:
    """The truth's name taken out of the catalogue."""
    rows = []
    for stratum in ("one", MECHANICS):
        pairs = [score.withheld for score in in_strata(scores, stratum) if score.withheld is not None]
        outcomes = [outcome for _, outcome in pairs]
        if outcomes:
            unknown = Rate.of(each.unknown for each in outcomes)
            twin = Rate.of(float(each.first > 0 and not each.confidently_wrong) for each in outcomes)
            missed = Rate.of(float(each.verdict == "no-gap") for each in outcomes)
            wrong = Rate.of(each.confidently_wrong for each in outcomes)
            rows.append((stratum, str(len(outcomes)), str(unknown), str(twin), str(missed), str(wrong)))
    columns = ("stratum", "cases", "unknown", "a declared twin first", "no-gap", "confidently wrong")
    return Table("The true effect withheld from the catalogue", columns, tuple(rows))


def closure_table(scores: Scores) -> Table:
    """Errors of gap and closure against the truth."""
    rows = []
    for stratum in _HOLDING:
        found = _visible(scores, stratum)
        gaps = [abs(each.closure.gap_error) for each in found if each.closure.gap_error is not None]
        answered = [each.closure for each in found if each.outcome.verdict in ("named", "ambiguous")]
        left = [each.left**2 for each in answered if each.left is not None]
        errors = [abs(each.closed_error) for each in answered if each.closed_error is not None]
        if gaps:
            rows.append((stratum, str(len(found)), *(_median(values) for values in (gaps, left, errors))))
    columns = (
        "stratum",
        "cases",
        "gap off by",
        "squared gap really left by the named causes",
        "closed, of the squared gap, off by",
    )
    return Table("How far: medians, against the truth", columns, tuple(rows))


def baseline_table(scores: Scores) -> Table:
    """The diagnosis beside the simple judges."""
    rows = []
    for name in ("diagnosis", *BASELINES):
        asked = [each for each in scores if each.baselines]
        outcomes = [(each, each.outcome if name == "diagnosis" else each.baselines[name]) for each in asked]
        silent = Rate.of(float(each.verdict == "no-gap") for score, each in outcomes if quiet(score))
        there = [(score, each) for score, each in outcomes if score.truth.visible]
        first = Rate.of(each.first for score, each in there if score.truth.stratum == "one")
        both = Rate.of(each.in_set for score, each in there if score.truth.stratum == "two")
        unknown = Rate.of(each.unknown for score, each in there if score.truth.stratum == "outside")
        wrong = Rate.of(each.confidently_wrong for _, each in outcomes)
        rows.append((name, *(str(each) for each in (silent, first, both, unknown, wrong))))
    columns = ("judge", "no-gap where nothing is", "one: first", "two: both", "outside: unknown", "confidently wrong")
    return Table("Beside simple judges, on the sweep", columns, tuple(rows))


def contents_table(scores: Scores) -> Table:
    """What the set holds."""
    rows = []
    for stratum, text in ({name: text for name, (_, text) in STRATA.items()} | FURTHER).items():
        found = in_strata(scores, stratum)
        count = len(found) if found else sum(score.withheld is not None for score in scores if stratum == "withheld")
        strengths = sorted({strength for score in found for strength in score.truth.wanted})
        rows.append((stratum, text, str(count), ", ".join(f"{each:g}" for each in strengths) or "-"))
    return Table("What the set holds", ("stratum", "what", "cases", "signal-to-noise"), tuple(rows))


_COLUMNS: Final = (
    "cases",
    "detected",
    "right name and place first",
    "right place first",
    "all in the set",
    "credit",
    "set size",
    "unknown",
    "confidently wrong",
)


def _rows(groups: Mapping[str, list[CaseScore]]) -> tuple[tuple[str, ...], ...]:
    """A row of each group that has cases."""
    return tuple((name, *_row(found)) for name, found in groups.items() if found)


def _row(found: list[CaseScore]) -> tuple[str, ...]:
    sizes = [score.outcome.members for score in found if score.outcome.members]
    return (
        str(len(found)),
        str(rate(found, lambda each: each.detected)),
        str(rate(found, lambda each: each.first)),
        str(rate(found, lambda each: each.place)),
        str(rate(found, lambda each: each.in_set)),
        f"{rate(found, lambda each: each.credit).value:.2f}",
        f"{np.mean(sizes):.2f}" if sizes else "-",
        str(rate(found, lambda each: each.unknown)),
        str(rate(found, lambda each: each.confidently_wrong)),
    )


def _median(values: list[float]) -> str:
    return f"{100 * float(np.median(values)):.1f} %" if values else "-"
