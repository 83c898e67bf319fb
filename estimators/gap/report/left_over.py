"""What the gap follows, and what the likeliest explanation leaves of it: each as a share of the squared gap."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.data.defects import Defect
from estimators.gap.data.stack import Stack
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Remainder
from estimators.gap.evidence.discrepancy import left_beside, squares_taken, weighed
from estimators.gap.evidence.laplace import linearised
from estimators.gap.evidence.refine import at
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.remainder_words import course_words
from estimators.gap.report import closure
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.channels import CHANNELS

#: What may be left is told of where it is so likely.
_TOLD: Final = 0.1
#: So many things beside the first are described, the largest.
_BESIDE: Final = 3

#: Spectra are even that differ by less than this share.
_WHITE: Final = 1e-3
#: What repeats, and in what: "deg of joint5", "s".
_PERIOD: Final = re.compile(r"(?:every|a sine of) \S+ (.*)")

#: Source, course and squares.
_Left = tuple[str, str, float]


def follows(posterior: Posterior, gap: float) -> tuple[dict[str, object], ...]:
    """What the whole squared gap follows: for each course the share that the likeliest source takes along that."""
    found: dict[str, float] = {}
    for course, taken in posterior.taken:
        gap = max(gap, taken)
        if not course.startswith("time,"):  # pieces of time: the same course, more roughly
            found[course] = max(found.get(course, 0.0), taken)
    ranked = dict(sorted(found.items(), key=lambda item: -item[1]))
    first: dict[str, str] = {}
    for name in ranked:  # others of one clock are lines of what repeats in it most
        period = _PERIOD.fullmatch(name)
        first.setdefault(period[1] if period else name, name)
    return tuple(
        {"variable": name, "share": ranked[name] / gap} for name in first.values() if ranked[name] > 0.01 * gap
    )


def remainder(
    posterior: Posterior,
    leading: Hypothesis,
    alone: Hypothesis,
    nameless: Sequence[Defect],
    unnamed: float,
    other: bool,
    gap: float,
    rng: np.random.Generator,
) -> Remainder:
    """What is left: single readings without a name, of ``unnamed`` squares; errors of the rig, one of which is meant;
    noise of channels. Of the squared gap, which is no smaller than what is left.

    Args:
        leading: the hypothesis that is told of. alone: the same without the effects that are images; what those
            explain is left.
    """
    hidden = closure.could_hide(posterior.discrepancies, rng)
    beside, noise = list[_Left](), list[_Left]()
    left: list[_Left] = [("single readings", f"{each.effect}-like", unnamed / len(nameless)) for each in nameless]
    if other:
        errors, beside = _errors(posterior, leading)
        doubted = _doubted(posterior, alone) if alone is not leading else []
        if max((one[-1] for one in doubted), default=0.0) > max((one[-1] for one in errors), default=0.0):
            known = {one[:2] for one in doubted}
            further = [one for one in [*errors[:1], *beside] if one[:2] not in known]
            errors, beside = doubted, sorted(further, key=lambda one: -one[-1])[:_BESIDE]
        noise = _nameless_noise(posterior)
        of_error = max((taken for *_, taken in errors), default=0.0)
        gap = max(gap, of_error + sum(added for *_, added in [*beside, *noise]))
        left += errors
    gap = max(gap, *(square for *_, square in [*left, *beside, *noise]), 1.0)
    told = [
        {"source": source, "course": course, "share": square / gap} | also
        for group, also in ((left, {}), (beside, {"beside": True}), (noise, {}))
        for source, course, square in group
    ]
    return Remainder("structured" if other or nameless else "noise", tuple(told), float(hidden))


def _errors(posterior: Posterior, leading: Hypothesis) -> tuple[list[_Left], list[_Left]]:
    """What a discrepancy may be, the likeliest first, and what a second one is beside it; none where it is unlikely."""
    first = leading if leading.terms else next((each for each in posterior.hypotheses if each.terms), None)
    likely = sum(p for each, p in zip(posterior.hypotheses, posterior.probabilities, strict=True) if each.terms)
    if first is None or likely < _TOLD:
        return [], []
    told = _of_sources(first.terms)
    linear = first.explanation.linear
    beside, less, before = list[_Left](), linear, first.terms[0]
    for further in first.further:
        less = left_beside(less, before, posterior.discrepancies)
        before = further[0]
        beside += _described([before], less.left, first.explanation.data, posterior)
    errors = _described(told, linear.left, first.explanation.data, posterior)
    named = {(source, course) for source, course, _ in errors}
    more = {one[:2]: one for one in sorted(beside, key=lambda one: one[-1]) if one[:2] not in named}
    return errors, sorted(more.values(), key=lambda one: -one[-1])[:_BESIDE]


def _doubted(posterior: Posterior, alone: Hypothesis) -> list[_Left]:
    """What images may stand in for, the likeliest first: errors that explain what a hypothesis without them leaves."""
    data = posterior.scanner.fine.data.like(alone.explanation.data)
    linear = linearised(at(alone.explanation.fits, data))
    return _described(_of_sources(weighed(linear, posterior.discrepancies)), linear.left, data, posterior)


def _of_sources(terms: Sequence[Weighed]) -> list[Weighed]:
    """Of each source the likeliest of some terms, the likeliest first, of those near the first."""
    near = [each for each in terms if each.log_mass > terms[0].log_mass - 3.0]
    of_source = {each.term.source: each for each in reversed(near)}
    return sorted(of_source.values(), key=lambda each: -each.log_mass)[:3]


def _described(every: Sequence[Weighed], residual: Array, data: WhitenedData, posterior: Posterior) -> list[_Left]:
    taken = squares_taken(every, residual, data, posterior.scanner.fine.data)
    return [(each.term.source, each.term.course, square) for each, square in zip(every, taken, strict=True)]


def _nameless_noise(posterior: Posterior) -> list[_Left]:
    """Source, band and squares of noise without a name, channel by channel; none where that is unlikely."""
    first = next((each for each in posterior.hypotheses if each.state.other), None)
    likely = sum(p for each, p in zip(posterior.hypotheses, posterior.probabilities, strict=True) if each.state.other)
    if first is None or likely < _TOLD:
        return []
    rough = posterior.scanner.rough.data
    size = f", of a size {course_words(first.state.follows)}" if first.state.follows else ""
    return [
        (
            f"noise of {CHANNELS[step.column]} by itself{_in(rough, step.part)}",
            _band(step.factor, rough.parts[step.part]) + size,
            max(float(np.sum(1.0 / np.maximum(step.factor, 1e-9) ** 2 - 1.0)), 0.0),
        )
        for step in first.state.steps
        if not step.in_time
    ]


def _in(data: WhitenedData, number: int) -> str:
    """Which of several recordings, in words."""
    return f" in {data.names[number]}" if isinstance(data, Stack) and len(data.parts) > 1 else ""


def _band(factor: Array, data: WhitenedData) -> str:
    """The frequencies at which noise is raised most; all where it is raised evenly."""
    power = 1.0 / np.maximum(factor[1:], 1e-9) ** 2
    raised = power - power.min()
    if raised.max() < _WHITE * power.mean():
        return "at all frequencies"
    cumulated = np.cumsum(raised) / max(float(raised.sum()), 1e-300)
    low, high = np.searchsorted(cumulated, [0.1, 0.9])
    unit = 0.5 * data.samples / (data.interval_s * len(raised))
    slowest, fastest = f"{max(low, 1) * unit:.2g}", f"{max(high, 1) * unit:.2g}"
    return f"{slowest} to {fastest} Hz" if slowest != fastest else f"about {fastest} Hz"
