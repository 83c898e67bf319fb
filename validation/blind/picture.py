"""The picture of a scored set: right, unknown, missed and confidently wrong, by stratum and signal-to-noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes

from scenarios.plots.style import new_figure, save, style
from validation.blind.intervals import Rate
from validation.blind.outcome import Outcome
from validation.blind.probability import reliability
from validation.blind.scoring import CaseScore, is_right
from validation.blind.strata import MECHANICS, STRATA, STRENGTHS, WITHHELD

#: In this order along a bar, with its colour: by how good an answer it is.
_KINDS: Final = {
    "right": "#0072B2",
    "honest, but not the whole truth": "#8CC8EE",
    "missed": "#C9C9C9",
    "confidently wrong": "#D55E00",
}
_GROUPS: Final = (*((name,) for name in STRATA), (MECHANICS,), (WITHHELD,))


def draw(scores: Sequence[CaseScore], path: Path) -> None:
    """Draw and save; one bar for every stratum and signal-to-noise that the set holds."""
    bars = _bars(scores)
    with style():
        figure = new_figure(8.0, 4.6 + 0.24 * len(bars))
        axes, below = figure.subplots(2, 1, height_ratios=(0.9 + 0.24 * len(bars), 3.4))
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
        _draw_reliability(below, scores)
    save(figure, path)


def _draw_reliability(axes: Axes, scores: Sequence[CaseScore]) -> None:
    """How often what was said with a probability was so, with Wilson's intervals, beside the line of the ideal."""
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#888888", linewidth=0.8)
    rows = reliability(claim for score in scores for claim in score.claims)
    for said, true, count in rows:
        low, high = Rate(true * count, count).interval
        axes.plot([said, said], [low, high], color="#0072B2", linewidth=1.2)
        axes.plot(said, true, "o", color="#0072B2", markersize=4.0)
        axes.annotate(str(count), (said, high), xytext=(0, 3), textcoords="offset points", ha="center", fontsize=7.0)
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(-0.02, 1.12)
    axes.set_xlabel("probability that was stated (of nothing, of something else, of each cause)")
    axes.set_ylabel("share that is so")


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
