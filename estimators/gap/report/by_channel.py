"""Where the gap lies, channel by channel; and what a recording cannot tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.data.defects import Defect
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Channel
from estimators.gap.evidence.common import is_common
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.stochastic import EVERY, FittedNoise
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect, Kind

#: Why an effect that does nothing but what other values of the calibration do cannot be told.
ABSORBED: Final = "the calibration absorbs it on this maneuver"
#: Why noise of single channels cannot be told where nothing shows the floor.
MAY_BE_FLOOR: Final = "no recording at rest tells it from the noise floor"
#: What is less, of the floor, is a difference of numbers that are equal but for rounding.
_NO_GAP: Final = 1e-6


def channels(
    data: WhitenedData,
    settled: WhitenedData,
    effects: Sequence[Effect],
    noises: Sequence[FittedNoise],
    defects: Sequence[Sequence[Defect]],
    floors: Sequence[tuple[ChannelNoise, ...]],
    quiet: bool,
    other: bool,
    left_of: Array,
    noise_left: Array,
) -> list[dict[str, Channel]]:
    """Of each recording the gap of each channel, before and after; never above the root mean square of its residual.

    Args:
        defects, floors: of each recording.
        left_of: (c,) whitened squares that are left of mean effects in each channel that is there.
        noise_left: (6,) shares left of noise and defects.
    """
    change = settled.change(effects) if effects else np.zeros_like(data.residual)
    gap = settled.left_over(change) if effects else change
    left = settled.left_over(settled.residual - change) if effects else data.residual
    columns, whole = data.columns, np.zeros(len(CHANNELS))
    for part, rows in zip(data.parts, data.single, strict=False):
        sigma = [part.whiteners[column].sigma for column in part.columns]
        squares = np.mean(np.square(gap[rows][:, part.columns] / sigma), axis=0)
        whole[part.columns] += squares * part.count / max(part.samples, 1)
    ratio = np.zeros(len(CHANNELS))
    if effects:
        ratio[columns] = np.minimum(left_of / np.maximum(whole[columns], 1e-12), 1.0)
    found = []
    for number, (part, rows) in enumerate(zip(data.parts, data.single, strict=False)):
        own_gaps = [defect.gap for defect in defects[number]]
        own_gaps += [each.gap for fitted in noises for each in fitted.every if each.part in (number, EVERY)]
        own = {}
        for column in part.columns:
            tails = floors[number][column].tails  # of which the readings were relieved
            sigma_V = math.sqrt(floors[number][column].variance + tails)
            named = float(sum(each[column] ** 2 for each in own_gaps))
            before, fitted, rest = (float(np.mean(values[rows, column] ** 2)) for values in (data.residual, gap, left))
            own[CHANNELS[column]] = _channel(
                sigma_V,
                before + tails,
                fitted,
                rest + tails,
                named,
                (float(ratio[column]), float(noise_left[column])),
                quiet,
                other,
                bool(effects),
            )
        found.append(own)
    return found


def _channel(
    sigma: float,
    before: float,
    fitted: float,
    rest: float,
    named: float,
    left: tuple[float, float],
    quiet: bool,
    other: bool,
    means: bool,
) -> Channel:
    """From the floor and mean squares: before, of the fitted gap, of what is left, and of named noise and defects;
    the shares that are left of the gap and of these."""
    rms_before, rms_after = math.sqrt(before), math.sqrt(rest)
    # what has no name is in some channels and not in others: what is left of each says in which
    remains = max(rest - sigma**2 - named, 0.0) if other else fitted * left[0] + named * left[1]
    gap_before = 0.0 if quiet else min(math.sqrt(fitted + named + (remains if other else 0.0)), rms_before)
    gap_after = 0.0 if quiet else min(math.sqrt(remains), rms_after)
    told = gap_before > 1e-3 * sigma
    if gap_before < _NO_GAP * sigma:
        gap_before = gap_after = 0.0
    if gap_after < _NO_GAP * sigma:
        gap_after = 0.0
    closed = max(-1.0, 1.0 - (gap_after / gap_before) ** 2) if told and (means or named) else None
    return Channel(sigma, rms_before, gap_before, rms_after, gap_after, closed)


def cannot_tell(
    posterior: Posterior, data: WhitenedData, without: Sequence[str], at_rest: bool, named: Sequence[str]
) -> tuple[dict[str, str], ...]:
    """The effects that the recording cannot show: those the calibration absorbs, those that may be the floor, and those
    it has no data for.

    Args:
        at_rest: whether every floor was learned at rest. named: effects that are told all the same.
    """
    shown = {(each.effect.name, each.where) for each in posterior.candidates}
    found = [
        {"effect": name, "where": where, "why": ABSORBED}
        for name, where in dict.fromkeys((each.effect.name, each.where) for each in posterior.absorbed)
        if (name, where) not in shown
    ]
    for effect in EFFECTS.values():
        if effect.name in without:
            continue
        if lacking := data.lacking(effect):
            found += [
                {"effect": effect.name, "where": where, "why": f"the recording lacks {lacking}"}
                for where in effect.places_on(data.base) or (f"{effect.numbered()}s",)
            ]
        elif not at_rest and effect.kind is Kind.NOISE and not is_common(effect) and effect.name not in named:
            found += [
                {"effect": effect.name, "where": where, "why": MAY_BE_FLOOR} for where in effect.places_on(data.base)
            ]
    return tuple(found)
