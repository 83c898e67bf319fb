"""Where the gap lies, channel by channel; and what a recording cannot tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench
from estimators.gap.channel_noise import ChannelNoise
from estimators.gap.defects import Defect
from estimators.gap.diagnosis import Channel
from estimators.gap.posterior import Posterior
from estimators.gap.stochastic import NoiseOffer
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect

Array = NDArray[np.float64]


def channels(
    bench: Bench,
    settled: Bench,
    effects: Sequence[Effect],
    offers: Sequence[NoiseOffer],
    defects: Sequence[Defect],
    floor: tuple[ChannelNoise, ...],
    quiet: bool,
    other: bool,
    after: Array,
) -> dict[str, Channel]:
    """Gap of each channel, before and after; never above the root mean square of its residual."""
    change = settled.change(effects) if effects else np.zeros_like(bench.residual)
    gap = settled.left_over(change) if effects else change
    left = settled.left_over(settled.residual - change) if effects else bench.residual
    whole = (
        sum(float(np.mean((gap[:, column] / bench.whiteners[column].sigma) ** 2)) for column in bench.columns)
        * bench.count
        / max(bench.samples, 1)
    )
    ratio = float(np.median(after)) / max(whole, 1e-12) if effects else 0.0
    found = {}
    for column in bench.columns:
        tails = floor[column].tails  # of which the readings were relieved
        sigma = math.sqrt(floor[column].variance + tails)
        own = float(np.mean(gap[:, column] ** 2))
        gaps = [defect.gap for defect in defects] + [offer.gap for offer in offers]
        named = float(sum(each[column] ** 2 for each in gaps))
        rms_before = float(np.sqrt(np.mean(bench.residual[:, column] ** 2) + tails))
        rms_after = float(np.sqrt(np.mean(left[:, column] ** 2) + tails))
        remains = own * min(ratio, 1.0)
        if other:
            remains = max(remains, rms_after**2 - sigma**2 - named)
        gap_before = 0.0 if quiet else min(math.sqrt(own + named + (max(remains, 0.0) if other else 0.0)), rms_before)
        gap_after = 0.0 if quiet else min(math.sqrt(max(remains, 0.0)), rms_after)
        told = gap_before > 1e-3 * sigma
        closed = max(-1.0, 1.0 - (gap_after / gap_before) ** 2) if told and (effects or named) else None
        found[CHANNELS[column]] = Channel(sigma, rms_before, gap_before, rms_after, gap_after, closed)
    return found


def cannot_tell(posterior: Posterior, bench: Bench, without: Sequence[str]) -> tuple[dict[str, str], ...]:
    """The effects that the recording cannot show: those the calibration absorbs, and those it has no data for."""
    shown = {(each.effect.name, each.where) for each in posterior.candidates}
    why = "the calibration absorbs it on this maneuver"
    found = [
        {"effect": name, "where": where, "why": why}
        for name, where in dict.fromkeys((each.effect.name, each.where) for each in posterior.absorbed)
        if (name, where) not in shown
    ]
    for effect in EFFECTS.values():
        lacking = effect.lacking(bench.base)
        if lacking and effect.name not in without:
            found += [
                {"effect": effect.name, "where": where, "why": f"the recording lacks {lacking}"}
                for where in effect.places_on(bench.base)
            ]
    return tuple(found)
