"""Shares of the squared gap that are closed, drawn from the posterior: by all causes, and by each.

All are of one whole, what mean effects, noise and defects together add to the squares. Of noise and of defects the
shares add up; two mean effects can do a part of the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import ndtri

from estimators.gap.data.defects import Defect
from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Closed
from estimators.gap.evidence.laplace import Linear
from estimators.gap.floor.channel_noise import sigmas
from estimators.gap.hypotheses.prior import FORM, VISIBLE
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.report import closure
from estimators.gap.report.p_values import WAYS
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.channels import CHANNELS

#: Of a normal variable, so many values that are equally likely.
_LIKELY: Final = ndtri((np.arange(8) + 0.5) / 8.0)


def of_causes(posterior: Posterior, told: Hypothesis, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws (d,) of the squared gap that is left and that was there, in whitened units: of what moves the mean.

    Args:
        told: the hypothesis whose causes are reported.
    """
    floor = posterior.scanner.fine.data
    known: dict[tuple[object, ...], Linear] = {}

    def under_floor(explanation: Explanation) -> Linear:
        key = explanation.key, explanation.fine, len(explanation.data.steps)
        if key not in known:
            same = explanation.data.steps == floor.steps
            known[key] = explanation.linear if same else explanation.on(floor).linear
        return known[key]

    own = under_floor(told.explanation)
    fitted = floor.whitened - own.left
    ways = []
    for each, probability in zip(posterior.hypotheses, posterior.probabilities, strict=True):
        if probability > WAYS:
            linear = under_floor(each.explanation)
            left = float(linear.left @ linear.left) - floor.size + floor.absorbed.rank
            apart = shapes_apart(each.explanation, floor)
            way = closure.Way(float(probability), floor.whitened - linear.left, linear, each.moments, apart=apart)
            if each.terms and not each.state.steps and not each.further:
                way = replace(way, terms=each.terms)
            elif each.other:  # all that is left beyond the floor and named noise
                way = replace(way, nameless=max(left - _added(each.state.fitted), 0.0))
            ways.append(way)
    after, before = closure.drawn(ways, fitted, rng)
    if told.explanation.members:
        took = closure.held_out(own, fitted, floor)  # draws say how it varies with what is left
        before = before * (took + float(after.mean())) / float(before.mean())
        after = after + out_of_form(before, rng)
    return after, before


def where_left(told: Hypothesis) -> Array:
    """(c,) shares of the channels in what reported causes leave, as their parameters' widths have it."""
    linear, channels = told.explanation.linear, len(told.explanation.data.columns)
    left = np.sum((linear.tangent @ told.moments[1]) * linear.tangent, axis=1).reshape(channels, -1).sum(axis=1)
    return np.asarray(left / max(float(left.sum()), 1e-300))


def out_of_form(before: Array, rng: np.random.Generator) -> Array:
    """Draws (d,) of the squares that are left as real causes are not quite of the catalogue's form, too small to see.

    Args:
        before: (d,) squared gap that was there, in whitened units.
    """
    return np.asarray((np.minimum(FORM * np.sqrt(before), VISIBLE) * rng.standard_normal(len(before))) ** 2)


def shapes_apart(explanation: Explanation, floor: WhitenedData) -> list[Array]:
    """For each shape that a fit keeps, such as an instant: its effect's change at equally likely values of it, less
    that at its own, (k, m) whitened and with the calibration projected out."""
    if not any(member.widths for member in explanation.members):
        return []
    data = floor.like(explanation.data)
    now = data.change([fit.effect for fit in explanation.fits])
    found = []
    for sets in zip(*(explanation.moved(float(by)) for by in _LIKELY), strict=True):
        changes = [data.whiten(data.change(effects) - now) for effects in sets]
        found.append(project(data.absorbed, np.column_stack(changes)).T)
    return found


def of_noise(
    noises: Sequence[FittedNoise], defects: Sequence[tuple[Defect, int]], data: WhitenedData, rng: np.random.Generator
) -> tuple[Array, Array]:
    """The same of noise and defects: squares that stay wrong of those that they add."""
    after, before = of_noise_by_channel(noises, defects, data, rng)
    return after.sum(axis=1), before.sum(axis=1)


def of_noise_by_channel(
    noises: Sequence[FittedNoise], defects: Sequence[tuple[Defect, int]], data: WhitenedData, rng: np.random.Generator
) -> tuple[Array, Array]:
    """The same of each channel: (d, 6) and (1, 6)."""
    after, before = np.zeros((1, len(CHANNELS))), np.zeros((1, len(CHANNELS)))
    for fitted in [each for one in noises for each in one.every]:
        strengths = np.atleast_1d(np.asarray(_strength(fitted), dtype=float))
        columns = range(len(CHANNELS))[fitted.effect.columns]
        for index, spread in enumerate(fitted.spread):
            own = np.ones(len(CHANNELS)) if len(fitted.spread) == 1 else np.arange(len(CHANNELS)) == columns[index]
            size = np.nansum(fitted.added, axis=0) * own
            wrong = closure.of_noise(max(strengths[index] ** 2, 1e-300), float(spread), rng)
            after = after + np.outer(np.minimum(wrong, 1.0) ** 2, size)
            before = before + size
    for defect, number in defects:
        part = data.parts[number]
        size = np.nan_to_num((defect.gap / sigmas(part.whiteners)) ** 2) * part.count
        many = int(defect.affected.sum())
        wrong = closure.of_noise(1.0, float(1.0 / np.sqrt(many)) if many else 1e-3, rng)
        after = after + np.outer(np.minimum(wrong, 1.0) ** 2, size)
        before = before + size
    return after, before


def by_cause(
    index: int, holder: Hypothesis, posterior: Posterior, took: Array | None, whole: Array, rng: np.random.Generator
) -> Closed:
    """The share of the squared gap that comes back where a mean effect alone is taken out again.

    Args:
        holder: the likeliest hypothesis that holds it. index: its number there.
        took: (d,) draws of the squares that the reported mean effects took, where it is all of these; else None.
        whole: (d,) draws of the squared gap.
    """
    if took is not None:
        return of_whole(took, whole)
    explanation = holder.explanation
    here = explanation.on(posterior.scanner.fine.data)
    data, linear = here.data, here.linear
    mine = linear.owner == index
    deltas = closure.of_parameters(holder.moments, rng, len(whole))[:, mine]
    own = replace(linear, tangent=linear.tangent[:, mine])
    change = project(data.absorbed, data.whiten(explanation.own_change(index, data)))
    return of_whole(closure.moved(own, change, deltas), whole)


def of_whole(took: Array, whole: Array) -> Closed:
    """Squares as a share of the squared gap (d,), of which they are a part."""
    whole = np.maximum(whole, took)
    return closure.share(whole - took, whole)


def _added(noises: Sequence[FittedNoise]) -> float:
    """Squares that named noise adds to whitened readings."""
    return float(sum(np.nansum(fitted.added) for one in noises for fitted in one.every))


def _strength(fitted: FittedNoise) -> object:
    (item,) = [each for each in fitted.effect.parameters() if each.strength]
    return getattr(fitted.effect, item.name)
