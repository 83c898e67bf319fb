"""What a posterior over explanations says of each cause: its probability, its equivalents, its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.diagnosis import Estimate
from estimators.gap.evidence.refine import Fitted
from estimators.gap.hypotheses.candidates import split
from estimators.gap.report import same_sets
from estimators.gap.report.curvature import beyond_normal
from estimators.gap.search.explanation import Member
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.effects import EFFECTS

#: A direction of the parameters is not felt where the data shrink its prior by less than this factor; a parameter is
#: not, where such directions hold more than this share of it.
_SHRUNK: Final = 0.5
_SHARE: Final = 0.02
#: An explanation with less than this share of a cause's probability adds nothing to its widths.
_LIGHT: Final = 1e-3


@dataclass(frozen=True)
class Place:
    """An effect at its places: those at which it does the same, the likeliest first.

    Attributes:
        members: (effect, place) and the share of the probability of each.
    """

    members: tuple[tuple[str, str, float], ...]

    @property
    def name(self) -> tuple[str, str]:
        """Effect and place."""
        return self.members[0][0], self.members[0][1]


def twins(posterior: Posterior) -> dict[str, str]:
    """Label -> label of what does the same to this recording; the likelier of two stands for both."""
    found: dict[str, str] = {}
    for each in posterior.hypotheses:  # what scored alike does the same, whatever floor it was fitted beside
        for member in each.explanation.members:
            if member.label not in found:
                others = set(member.labels[1:]) - set(found.values()) - found.keys()
                found |= dict.fromkeys(others, member.label)
    for pair in same_sets.but_for_one(posterior):
        kept, gone = found.get(pair.mine, pair.mine), pair.theirs
        if gone not in found and gone != kept and pair.same:
            found = {label: kept if same == gone else same for label, same in found.items()} | {gone: kept}
    return found


def places(posterior: Posterior, same: Mapping[str, str]) -> dict[str, Place]:
    """Every label that stands for itself, with all that does the same, shares by their prior or their mass.

    What was fitted comes first: its parameters are those that are stated.
    """
    shares: dict[str, dict[str, float]] = {}
    members: dict[str, Member] = {}
    for hypothesis in posterior.hypotheses:
        for member in hypothesis.explanation.members:
            members.setdefault(member.label, member)
        for fitted in hypothesis.state.fitted:
            shares.setdefault(fitted.label, {fitted.label: 1.0})
    for label, member in members.items():
        own = shares.setdefault(same.get(label, label), {})
        for each in member.labels:
            own[each] = own.get(each, 0.0) + posterior.prior.weight(member.drawn[0], each)
    found = {}
    for label, own in shares.items():
        total = sum(own.values())
        ranked = sorted(own.items(), key=lambda item: (item[0] != label, -item[1], _order(item[0])))
        merged: dict[tuple[str, str], float] = {}
        for each, weight in ranked:
            merged[split(each)] = merged.get(split(each), 0.0) + weight / total
        found[label] = Place(tuple((effect, where, part) for (effect, where), part in merged.items()))
    return found


def _order(label: str) -> tuple[int, str]:
    effect, where = split(label)
    return list(EFFECTS).index(effect), where


def parameters(index: int, holders: Sequence[tuple[Hypothesis, float]]) -> dict[str, Estimate]:
    """The parameters of a mean effect: as in the likeliest explanation that holds it, widths over all that do.

    Args:
        index: its number in the likeliest. holders: all, with their probabilities; the likeliest first.
    """
    leading = holders[0][0]
    member = leading.explanation.members[index]
    fit = member.fit
    mean, covariance, felt = _moments(leading, index)
    bent = beyond_normal(leading, index)
    values, spread = fit.values.copy(), np.zeros_like(covariance)
    total = sum(weight for _, weight in holders)
    if leading.terms:  # the fit knew nothing of the discrepancy: its mean moves too
        values = values + mean * fit.scale
    centre = values / fit.scale
    for hypothesis, weight in holders:
        labels = [each.label for each in hypothesis.explanation.members]
        if member.label not in labels:
            continue
        number = index if hypothesis is leading else labels.index(member.label)
        if weight < _LIGHT * total:
            continue
        other = hypothesis.explanation.members[number].fit
        if len(other.values) != len(values) or other.kept.keys() != fit.kept.keys():
            continue
        moved, wide, _ = _moments(hypothesis, number)
        shift = other.values / other.scale + (moved if hypothesis.terms else 0.0) - centre
        spread += weight / total * (wide + np.outer(shift, shift))
    spread = ((spread if spread.any() else covariance) + bent) * np.outer(fit.scale, fit.scale)
    for own, along in _lengths(fit):
        size = float(np.linalg.norm(values[own]))
        across = np.eye(len(along)) - np.outer(along, along)
        values[own] /= size
        spread[own, own] = across @ spread[own, own] @ across / size**2
    std = np.sqrt(np.maximum(np.diag(spread), 0.0))
    effect = fit.effect
    found: dict[str, Estimate] = {name: Estimate(getattr(effect, name), None, "name") for name in effect.choices()}
    first = 0
    for item in fit.free:
        part = slice(first, first + item.size)
        first += item.size
        # a unit that the readings do not feel has no value to report
        within = np.clip(values[part], item.lower, item.upper)
        if item.spanned and item.unit == "rad":  # a phase
            within = np.pi - np.mod(np.pi - within, 2.0 * np.pi)
        each = [float(v) if f else None for v, f in zip(within, felt[part], strict=True)]
        broad = [float(s) if f else None for s, f in zip(std[part], felt[part], strict=True)]
        whole = tuple(float(v) for v in within)
        why, fitted = (None, None) if all(felt[part]) else ("this maneuver does not feel it", whole)
        if item.size == 1:
            found[item.name] = Estimate(each[0], broad[0], item.unit, why, fitted and fitted[0])
        else:
            found[item.name] = Estimate(tuple(each), tuple(broad), item.unit, why, fitted)
    items = {item.name: item for item in effect.parameters()}
    for name, value in fit.kept.items():
        item = items[name]
        if item.strength:  # without influence on this recording
            nothing = None if item.size == 1 else (None,) * item.size
            found[name] = Estimate(nothing, nothing, item.unit, "this recording does not feel it")
        else:
            std_kept = member.widths.get(name)
            found[name] = Estimate(value, std_kept, item.unit)
    return {name: found[name] for name in [*effect.choices(), *items] if name in found}


def _moments(hypothesis: Hypothesis, index: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Of one member's parameters, in typical sizes: mean less the fitted value, covariance, and which are felt."""
    linear = hypothesis.explanation.linear
    precision = linear.likeliest
    mean, covariance = hypothesis.moments
    own = linear.owner == index
    scale = 1.0 / np.sqrt(precision)
    gram = linear.gram * np.outer(scale, scale)
    places = np.flatnonzero(own)
    for part, along in _lengths(hypothesis.explanation.fits[index]):  # not felt, and nothing to feel
        gram[np.ix_(places[part], places[part])] += np.outer(along, along)
    values, vectors = np.linalg.eigh(gram)
    hidden = vectors[:, values < _SHRUNK]
    felt = (hidden**2).sum(axis=1) < _SHARE
    return mean[own], covariance[np.ix_(own, own)], felt[own]


def _lengths(fit: Fitted) -> Iterator[tuple[slice, Array]]:
    """Where the vectors of a fit are of which only the direction counts, and the unit vector along each."""
    first = 0
    for item in fit.free:
        own = slice(first, first + item.size)
        first += item.size
        if item.unit_vector and fit.values[own].any():
            yield own, fit.values[own] / np.linalg.norm(fit.values[own])
