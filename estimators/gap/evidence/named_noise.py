"""Noise with a name beside a state: the effects of the catalogue that a residual shows, and their strengths' prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.noise_effects import fit_effect, fitted_noises
from estimators.gap.hypotheses.prior import ONE_AXIS, scales
from estimators.gap.hypotheses.stochastic import FittedNoise, Left
from rig.effects import Effect


def named(lefts: Sequence[Left], without: Sequence[str], given: NoiseState) -> list[NoiseState]:
    """States with one more noise effect of the catalogue each, the most evident first."""
    held = {fitted.label for fitted in given.fitted}
    return [_with(given, fitted, lefts) for fitted in _fitted_at(lefts, without) if fitted.label not in held]


def again(lefts: Sequence[Left], effect: Effect, given: NoiseState) -> NoiseState | None:
    """The state with one noise effect, of which the place is known; None where nothing shows it."""
    found = [(number, fit_effect(type(effect), effect.where, left)) for number, left in enumerate(lefts)]
    shown = [replace(each, part=number) for number, each in found if each is not None and each.gain > 0.0]
    return _with(given, replace(shown[0], more=tuple(shown[1:])), lefts) if shown else None


def _with(given: NoiseState, fitted: FittedNoise, lefts: Sequence[Left]) -> NoiseState:
    """A state with one more noise effect."""
    steps = tuple(step for each in fitted.every for step in each.steps(lefts[each.part].data))
    first, *rest = (_judged(each) for each in fitted.every)
    own = replace(first[0], more=tuple(each for each, _ in rest))
    weight = given.log_weight + sum(cost for _, cost in (first, *rest))
    return NoiseState(given.name, (*given.fitted, own), (*given.steps, *steps), weight, given.other)


def _fitted_at(lefts: Sequence[Left], without: Sequence[str]) -> list[FittedNoise]:
    """Of every noise effect at every place, with a strength of its own in each recording that shows it."""
    found: dict[str, list[FittedNoise]] = {}
    for number, left in enumerate(lefts):
        for fitted in fitted_noises(left, without):
            if fitted.gain > 0.0:
                found.setdefault(fitted.label, []).append(replace(fitted, part=number))
    return [replace(first, more=tuple(rest)) for first, *rest in found.values()]


def _judged(fitted: FittedNoise) -> tuple[FittedNoise, float]:
    """A noise effect with its strengths as wide as one axis alone may have it; and the log of the share of the prior
    that they take: half-normal, their scale averaged over a grid, of all axes or of one alone."""
    (strength,) = [item for item in fitted.effect.parameters() if item.strength]
    values = np.atleast_1d(np.asarray(getattr(fitted.effect, strength.name), dtype=float))[: fitted.rank]
    spread = np.maximum(fitted.spread, 1e-300)
    least = np.sqrt(spread)  # the amplitude whose variance is as large as that
    width = np.minimum(0.5 * spread / np.maximum(values, 1e-300), least)
    shown = strength.typical / float(np.sqrt(np.mean(least**2)))
    own, weights = scales(shown, float(values.max()) / strength.typical)
    scale = strength.typical * own[:, None]
    each = np.log(2.0 * width / scale) - 0.5 * (values / scale) ** 2
    shape = -float(np.log(fitted.searched))
    together = float(np.logaddexp.reduce(each.sum(axis=1) + weights))
    if not (strength.by_axis and fitted.rank > 1):
        return fitted, together + shape
    alone = np.logaddexp.reduce(each + weights[:, None], axis=0) - 0.5 * (fitted.gain - fitted.gains)
    alone += np.log(ONE_AXIS / fitted.rank)
    every = np.append(alone, together + np.log(1.0 - ONE_AXIS))
    total = float(np.logaddexp.reduce(every))
    nothing = 1.0 - np.exp(alone - total) - np.exp(every[-1] - total)  # of each axis, that another has it alone
    return replace(fitted, std=np.hypot(fitted.std, np.sqrt(np.maximum(nothing, 0.0)) * values)), total + shape
