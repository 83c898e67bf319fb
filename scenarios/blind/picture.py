"""The picture of a scored set: right, unknown, missed and confidently wrong, by stratum and signal-to-noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from scenarios.blind.outcome import Outcome
from scenarios.blind.score import CaseScore, is_right
from scenarios.blind.strata import MECHANICS, STRENGTHS, WITHHELD
from scenarios.plots.style import new_figure, save, style

#: In this order along a bar, with its colour: by how good an answer it is.
_KINDS: Final = {
    "right": "#0072B2",
    "honest, but not the whole truth": "#8CC8EE",
    "missed": "#C9C9C9",
    "confidently wrong": "#D55E00",
}
_GROUPS: Final = (("none",), ("absorbed",), ("one",), ("two",), ("form",), (MECHANICS,), ("outside",), (WITHHELD,))


def draw(scores: Sequence[CaseScore], path: Path) -> None:
    """Draw and save; one bar for every stratum and signal-to-noise that the set holds."""
    bars = _bars(scores)
    with style():
        figure = new_figure(8.0, 0.9 + 0.24 * len(bars))
        axes = figure.subplots()
        for row, (_, counts) in enumerate(bars):
            total, left = sum(counts.values()), 0.0
            for kind, colour in _KINDS.items():
                share = 100.0 * counts[kind] / total
                axes.barh(row, share, left=left, color=colour, height=0.72, label=kind if row == 0 else None)
                left += share
            axes.text(101.0, row, str(total), va="center", fontsize=7.5)
        axes.set_yticks(range(len(bars)), [label for label, _ in bars])
        axes.invert_yaxis()
        axes.set_xlim(0.0, 100.0)
        axes.set_xlabel("share of the cases [%]; their number at the right")
        axes.grid(axis="y", visible=False)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(_KINDS))
    save(figure, path)


def _bars(scores: Sequence[CaseScore]) -> list[tuple[str, dict[str, int]]]:
    found = []
    for (stratum,) in _GROUPS:
        if stratum == WITHHELD:
            judged = [(0.0, _withheld_kind(each.withheld[1])) for each in scores if each.withheld is not None]
        else:
            judged = [(_strength(each), _kind(each)) for each in scores if each.truth.stratum == stratum]
        for strength in sorted({each for each, _ in judged}):
            kinds = [kind for each, kind in judged if each == strength]
            label = stratum if strength == 0.0 else f"{stratum}, {strength:g}"
            found.append((label, {kind: kinds.count(kind) for kind in _KINDS}))
    return found


def _strength(score: CaseScore) -> float:
    """The weakest that was wanted of a case; zero where nothing was."""
    wanted = [each for each in score.truth.wanted if each in STRENGTHS]
    return min(wanted, default=0.0)


def _kind(score: CaseScore) -> str:
    if is_right(score):
        return "right"
    if score.outcome.confidently_wrong:
        return "confidently wrong"
    return "missed" if score.outcome.verdict == "no-gap" else "honest, but not the whole truth"


def _withheld_kind(outcome: Outcome) -> str:
    if outcome.confidently_wrong:
        return "confidently wrong"
    if outcome.verdict == "no-gap":
        return "missed"
    return "right" if outcome.unknown or outcome.first else "honest, but not the whole truth"
