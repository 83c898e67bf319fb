"""Proper scores, calibration of the probabilities, intervals and times, as rows of tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from validation.blind.intervals import Rate
from validation.blind.laboratories import LABORATORIES
from validation.blind.probability import Proper, calibration_error, reliability
from validation.blind.scoring import CaseScore
from validation.blind.strata import MECHANICS, STRATA, WITHHELD
from validation.markdown import Table

Scores = Sequence[CaseScore]

_COLUMNS: Final = ("cases", "on the truth", "log score", "Brier", "confidently wrong")
_FEW: Final = 20  # stated numbers of an effect below which it has no row of its own


def proper_table(scores: Scores) -> Table:
    """Stratum by stratum, and all together."""
    rows = []
    for stratum in (*STRATA, MECHANICS):
        found = [score for score in scores if score.truth.stratum == stratum]
        if found:
            rows.append((stratum, *_row(found)))
    again = [(each.withheld_scores, each.withheld[1]) for each in scores if each.withheld is not None]
    if again:
        wrong = Rate.of(outcome.confidently_wrong for _, outcome in again)
        rows.append((WITHHELD, *_means([proper for proper, _ in again if proper is not None]), str(wrong)))
    rows.append(("all", *_row(list(scores))))
    return Table("Probability on the truth", ("stratum", *_COLUMNS), tuple(rows))


def laboratory_table(scores: Scores) -> Table:
    """By laboratory."""
    rows = []
    for name, laboratory in LABORATORIES.items():
        found = [score for score in scores if score.truth.laboratory == name]
        if found:
            rows.append((f"{name}: {laboratory.words}", *_row(found)))
    return Table("By laboratory", ("laboratory", *_COLUMNS), tuple(rows))


def quiet_floor_table(scores: Scores) -> Table:
    """Where there is nothing, by floor."""
    rows = []
    found = [score for score in scores if score.truth.stratum == "none"]
    for floor in sorted({score.truth.floor_kind for score in found}):
        some = [score for score in found if score.truth.floor_kind == floor]
        quiet = Rate.of(float(each.outcome.verdict == "no-gap") for each in some)
        unknown = Rate.of(each.outcome.unknown for each in some)
        rows.append((floor, *_row(some), str(quiet), str(unknown)))
    return Table("Nothing there, by floor", ("floor", *_COLUMNS, "no-gap", "unknown"), tuple(rows))


def effect_table(scores: Scores) -> Table:
    """Single causes, effect by effect; the same for each outside mechanism and each form."""
    rows = []
    for stratum in ("one", "one axis", "form", "outside", MECHANICS):
        names: dict[str, list[CaseScore]] = {}
        for score in scores:
            if score.truth.stratum == stratum and score.truth.visible:
                names.setdefault(score.truth.causes[0].name, []).append(score)
        for name in sorted(names):
            first = Rate.of(each.outcome.first for each in names[name])
            rows.append((stratum, name, *_row(names[name]), str(first)))
    columns = ("stratum", "effect", *_COLUMNS, "right name and place first")
    return Table("Effect by effect", columns, tuple(rows))


def reliability_table(scores: Scores) -> Table:
    """What was said with which probability, and how often it was so."""
    rows = []
    claims = [claim for score in scores for claim in score.claims]
    apart = ("nothing", "other")
    groups = {name: [each for each in claims if each.kind == name] for name in apart}
    groups |= {"causes": [each for each in claims if each.kind not in apart], "all": claims}
    for name, own in groups.items():
        for said, true, count in reliability(own):
            share = str(Rate(true * count, count))
            rows.append((name, f"{said:.2f}", share, str(count)))
        if own:
            rows.append((name, "calibration error", f"{calibration_error(own):.3f}", str(len(own))))
    return Table("Are the probabilities right?", ("said of", "with probability", "is so", "times"), tuple(rows))


def intervals_table(scores: Scores) -> Table:
    """How often a stated 95 % interval holds the truth: of parameters, and of what the causes close."""
    numbers = [each for score in scores for each in score.stated]
    rows = [("parameters, all", str(len(numbers)), str(Rate.of(float(each.holds) for each in numbers)))]
    for effect in sorted({each.effect for each in numbers}):
        own = [each for each in numbers if each.effect == effect]
        if len(own) >= _FEW:
            rows.append((effect, str(len(own)), str(Rate.of(float(each.holds) for each in own))))
    closed = [score.closure.closed_holds for score in scores if score.closure.closed_holds is not None]
    rows.append(("closed", str(len(closed)), str(Rate.of(float(each) for each in closed))))
    return Table("95 % intervals that hold the truth", ("of", "numbers", "hold"), tuple(rows))


def missed_table(scores: Scores) -> Table:
    """What was not seen beside what could have been missed, by the answer's own word."""
    rows = []
    missed = [score for score in scores if score.truth.visible and score.outcome.verdict == "no-gap"]
    for score in missed:
        could = score.answer.get("remainder", {}).get("could_hide_snr")
        strongest = score.truth.visible[0]
        said = "-" if could is None else f"{float(could):.1f}"
        rows.append((score.truth.case, f"{strongest.name} at {strongest.where}", f"{strongest.beyond:.1f}", said))
    columns = ("case", "what was there", "signal-to-noise", "said that so much could hide")
    return Table("Missed", columns, tuple(rows))


def time_table(scores: Scores) -> Table:
    """Seconds a recording, and what did not come to an answer."""
    rows = []
    for name in LABORATORIES:
        found = [score for score in scores if score.truth.laboratory == name]
        seconds = [float(score.answer["seconds"]) for score in found if score.answer.get("seconds") is not None]
        if found:
            times = [f"{np.quantile(seconds, share):.1f}" for share in (0.5, 0.95, 1.0)] if seconds else ["-"] * 3
            failed = [sum(score.outcome.verdict == verdict for score in found) for verdict in ("refused", "failed")]
            rows.append((name, str(len(found)), *times, *map(str, failed)))
    columns = ("laboratory", "cases", "median [s]", "95 % [s]", "longest [s]", "refused", "failed")
    return Table("Time", columns, tuple(rows))


def _row(found: Sequence[CaseScore]) -> tuple[str, ...]:
    wrong = Rate.of(score.outcome.confidently_wrong for score in found)
    return (*_means([score.scores for score in found]), str(wrong))


def _means(found: Sequence[Proper]) -> tuple[str, ...]:
    """Number of cases, then means with their standard error."""
    columns = [[each.mass for each in found], [each.log for each in found], [each.brier for each in found]]
    return (str(len(found)), *(_mean(values) for values in columns))


def _mean(values: Sequence[float]) -> str:
    if len(values) < 2:
        return f"{np.mean(values):.2f}" if values else "-"
    return f"{np.mean(values):.2f} +- {np.std(values, ddof=1) / np.sqrt(len(values)):.2f}"
