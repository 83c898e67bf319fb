"""Noise effects whose errors all channels share: a clock that jitters, a log of poses that errs.

An error at an instant moves every channel by its own response: what it adds is coherent, and told from the noise of
single channels by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import Basis, project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Weighed, weighed_terms
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.terms import Errors, Term, blocks_term
from estimators.gap.floor.channel_noise import sigmas
from estimators.gap.hypotheses.sources import Source
from estimators.gap.hypotheses.stochastic import EVERY, FittedNoise
from rig.effects import EFFECTS, Effect, Kind

Array = NDArray[np.float64]

#: Steps of the grid of amplitudes, and their ratio: fine enough to tell the strength from.
_STEPS, _RATIO = 24, 1.25


@dataclass(frozen=True)
class CommonNoise:
    """A noise effect with one error for all channels, at a shape, and its term.

    Attributes:
        effect: at strength one. response: (n, 6, r) of the readings. floor: (n, 6) of these, single [recorded unit].
        term: of the discrepancy that it is.
    """

    effect: Effect
    response: Array
    floor: Array
    term: Term

    def tested(self, found: Weighed) -> FittedNoise:
        """With the strength that the data give it."""
        (item,) = [each for each in self.effect.parameters() if each.strength]
        weight = np.exp(found.gains - np.logaddexp.reduce(found.gains))
        unit = float(self.term.unit)
        variances = self.term.variances * unit
        value = float(weight @ variances)
        deviation = float(np.sqrt(weight @ (variances - value) ** 2 + (value * np.log(_RATIO) / np.sqrt(3.0)) ** 2))
        root = float(np.clip(np.sqrt(value), item.lower, item.upper))
        made = type(self.effect).from_mapping({**vars(self.effect), item.name: root})
        raw = value * np.sum(self.response**2, axis=2)
        return FittedNoise(
            effect=made,
            gain=2.0 * float(found.gains.max()),
            rank=1,
            searched=1,
            std=np.array([0.5 * deviation / max(root, 1e-300)]),
            spread=np.array([deviation]),
            added=raw / self.floor**2,
            in_time=True,
            gap=np.sqrt(raw.mean(axis=0)),
            part=EVERY,
        )


def common_noises(data: WhitenedData, without: Sequence[str]) -> list[CommonNoise]:
    """Those that a recording can show."""
    found = []
    floor = _of_parts(data, [_floor(part) for part in data.parts], np.inf)
    for effect in EFFECTS.values():
        if effect.name in without or not is_common(effect) or data.lacking(effect):
            continue
        for shape in effect.searched(data.base):
            probe = effect.from_mapping({"where": effect.places[0], **shape})
            response = _of_parts(data, [probe.response(part.base, part.pipeline) for part in data.parts])
            series = (response / floor[:, :, None] * data.weights[:, :, None]).transpose(2, 1, 0)[:, data.columns]
            if not series.any():
                continue
            tau_s = float(np.max(shape.get("tau_s", 0.0)))
            pieces = data.count if tau_s < data.interval_s else max(8, int(np.ptp(data.t) / (2.0 * tau_s)))
            source = Source(effect.name, series, "noise")
            share, every = -float(np.log(len(effect.searched(data.base)))), slice(0, len(series))
            term = blocks_term(Errors.of([source]), source, every, min(pieces, data.count), share)
            found.append(CommonNoise(probe, response, floor, replace(term, steps=_STEPS, ratio=_RATIO)))
    return found


def _of_parts(data: WhitenedData, values: Sequence[Array], beyond: float = 0.0) -> Array:
    """(count, ...) of each recording's values, and of rows that are none's."""
    found = np.concatenate(values)
    rest = np.full((data.count - len(found), *found.shape[1:]), beyond)
    return np.concatenate([np.nan_to_num(found, posinf=np.inf), rest])


def _floor(member: WhitenedData) -> Array:
    """(n, 6) [recorded unit]; infinite where a channel is not there."""
    sigma = sigmas(member.whiteners)
    sigma = np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, np.inf)
    return np.broadcast_to(sigma, (member.count, len(sigma)))


def is_common(effect: type[Effect]) -> bool:
    """Whether a noise effect is one error for all channels."""
    return effect.kind is Kind.NOISE and effect.response is not Effect.response


def beside(
    linear: Linear, noises: Sequence[CommonNoise], absorbed: Basis, discrepancy: Weighed | None = None
) -> list[tuple[float, FittedNoise]]:
    """Each beside a set of effects, sample by sample: its log mass before its prior, and its strength.

    Args:
        absorbed: the calibration's tangent. discrepancy: what else is there; its likeliest course is taken out first.
    """
    found = []
    if discrepancy is not None and noises:
        taken = discrepancy.term.of_every_sample(linear.left, int(np.argmax(discrepancy.gains)))
        linear = replace(linear, left=linear.left - project(absorbed, taken))
    for noise in noises:
        for each in weighed_terms(linear, [noise.term]):
            found.append((each.log_mass, noise.tested(each)))
    return found
