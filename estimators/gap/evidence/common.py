"""Noise effects whose errors all channels share: a clock that jitters, a log of poses that errs.

An error at an instant moves every channel by its own response: what it adds is coherent, and told from the noise of
single channels by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimators.gap.data.projection import Basis, project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.amplitudes import between_steps, told
from estimators.gap.evidence.discrepancy import total, weighed_terms
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.shown_errors import Shown, of_parts
from estimators.gap.evidence.terms import Errors, Term, blocks_term
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.sources import Source
from estimators.gap.hypotheses.stochastic import EVERY, FittedNoise, variances
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind

#: Steps of the grid of amplitudes, and their ratio: fine enough to tell the strength from.
_STEPS, _RATIO = 40, 1.25
#: Log evidence of a noise effect, by what a discrepancy leaves, from which on both are weighed at once.
_PROMISING: Final = -1.0
#: So many terms of the discrepancy, within so much of the likeliest; of each the directions that are seen best.
_TERMS, _NEAR, _MOST = 3, 6.0, 256
#: Of these, so many in memory at once.
_AT_ONCE: Final = 16
#: Frequencies at which what whitening does to white errors is averaged.
_FREQUENCIES: Final = 512
#: Steps of the noise's grid to either side of what is likeliest beside the discrepancy's mean.
_WINDOW: Final = 7


@dataclass(frozen=True)
class CommonNoise:
    """A noise effect with one error for all channels, at a shape, and its term.

    Attributes:
        effect: at strength one.
        response: (n, 6, r) of the readings that are compared: single ones, or means. floor: (n, 6) [recorded unit] of
            the same, of errors that are white.
        single: (n,) by how much a single reading's error varies more than a mean's.
        term: of the discrepancy that it is.
        shown: errors that the recordings themselves show, where they do.
    """

    effect: Effect
    response: Array
    floor: Array
    single: Array
    term: Term
    shown: Shown | None = None

    def known_in(self, linear: Linear) -> tuple[Linear, float]:
        """A set of effects beside what is shown of the errors, and by how much that is likelier."""
        if self.shown is None:
            return linear, 0.0
        known = self.shown.beside(linear)
        return known, known.averaged[0] - linear.averaged[0]

    def tested(self, found: Weighed, known: Linear, gained: float) -> FittedNoise:
        """With the strength that the data give it.

        Args:
            known, gained: as ``known_in`` gives them.
        """
        (item,) = [each for each in self.effect.parameters() if each.strength]
        weight = np.exp(found.gains - np.logaddexp.reduce(found.gains))
        unit = float(self.term.unit)
        variances = found.term.variances * unit
        value = float(weight @ variances)
        between = value * min(float(np.log(_RATIO)) / np.sqrt(3.0), 1.0 / np.sqrt(max(told(found), 1e-300)))
        deviation = float(np.sqrt(weight @ (variances - value) ** 2 + between**2))
        if self.shown is not None:
            square, width = self.shown.square(known, self.single)
            value, deviation = value + square, float(np.hypot(deviation, width))
        root = float(np.clip(np.sqrt(value), item.lower, item.upper))
        made = type(self.effect).from_mapping({**vars(self.effect), item.name: root})
        raw = value * np.sum(self.response**2, axis=2)
        return FittedNoise(
            effect=made,
            gain=2.0 * (float(found.gains.max()) + gained),
            rank=1,
            searched=1,
            std=np.array([0.5 * deviation / max(root, 1e-300)]),
            spread=np.array([deviation]),
            added=raw / self.floor**2,
            in_time=True,
            gap=np.sqrt((raw * self.single[:, None]).mean(axis=0)),
            part=EVERY,
        )


def common_noises(data: WhitenedData, without: Sequence[str]) -> list[CommonNoise]:
    """Those that a recording can show.

    Args:
        data: under any state of the noise.
    """
    found = []
    floor = of_parts(data, [_floor(part) for part in data.parts], np.inf)
    for effect in EFFECTS.values():
        if effect.name in without or not is_common(effect) or data.lacking(effect):
            continue
        probes = [effect.from_mapping({"where": effect.places[0], **shape}) for shape in effect.searched(data.base)]
        shown = Shown.of(data, probes[0])
        hidden = np.full(len(probes), -np.log(len(probes)))
        ways: list[tuple[Shown | None, Array]] = [(None, hidden)]
        if shown is not None:  # what is rough may also be the path: one is as likely as the other
            ways = [(None, hidden - np.log(2.0)), (shown, shown.log_shares(probes, data.interval_s) - np.log(2.0))]
        for known, shares in ways:
            every = [_common(data, floor, probe, share, known) for probe, share in zip(probes, shares, strict=True)]
            found += [each for each in every if each is not None]
    return found


def _common(data: WhitenedData, floor: Array, probe: Effect, share: float, shown: Shown | None) -> CommonNoise | None:
    """A noise effect of one shape; None where the readings do not show it.

    Args:
        floor: as ``CommonNoise`` has it. share: log prior of the shape. shown: of its errors.
    """
    errors = [variances(probe, part.samples, part.interval_s, part.count) for part in data.parts]
    parts = [(part, one / of_mean) for part, (one, of_mean) in zip(data.parts, errors, strict=True)]
    own = [probe.response(part.base, part.pipeline) / np.sqrt(ratio) for part, ratio in parts]
    whitened = [_whitened(part, each) for part, each in zip(data.parts, own, strict=True)]
    series = of_parts(data, whitened).transpose(2, 1, 0)[:, data.columns]
    if not series.any():
        return None
    tau_s = float(getattr(probe, "tau_s", 0.0))
    pieces = data.count if tau_s < data.interval_s else max(8, int(np.ptp(data.t) / (2.0 * tau_s)))
    pieces = min(pieces, data.count if shown is None else shown.pieces)
    source = Source(probe.name, series, "noise")
    term = blocks_term(Errors.of([source]), source, slice(0, len(series)), pieces, float(share))
    single = of_parts(data, [np.full(part.count, ratio) for part, ratio in parts])
    return CommonNoise(probe, of_parts(data, own), floor, single, replace(term, steps=_STEPS, ratio=_RATIO), shown)


def _floor(member: WhitenedData) -> Array:
    """(n, 6) [recorded unit] what whitening makes one of, of errors that are white; infinite without the channel."""
    frequency = np.linspace(0.0, 0.5, _FREQUENCIES)
    gain = np.array([np.mean(whitener.response(frequency)) for whitener in member.whiteners])
    sigma = np.where(np.isfinite(gain) & (gain > 0.0), 1.0 / np.sqrt(np.maximum(gain, 1e-300)), np.inf)
    return np.broadcast_to(sigma, (member.count, len(sigma)))


def _whitened(member: WhitenedData, response: Array) -> Array:
    """(n, 6, r) what whitening makes of the response (n, 6, r) to errors that are white."""
    found = np.nan_to_num(response) * (member.weights / _floor(member))[:, :, None]
    if (shared := member.decorrelation) is not None:
        shared = shared if shared.ndim == 2 else shared.mean(axis=0)  # of what is white
        found[:, member.columns] = np.einsum("ij,njr->nir", shared, found[:, member.columns])
    for step in member.steps:
        factor = step.factor if step.in_time else np.full(member.count, np.sqrt(np.mean(step.factor**2)))
        found[:, step.column] *= factor[:, None]
    return found


def is_common(effect: type[Effect]) -> bool:
    """Whether a noise effect is one error for all channels."""
    return effect.kind is Kind.NOISE and effect.response is not Effect.response


def beside(linear: Linear, noises: Sequence[CommonNoise]) -> list[tuple[float, FittedNoise]]:
    """Each beside a set of effects, sample by sample: its log mass before its prior, and its strength."""
    found = []
    for noise in noises:
        known, gained = noise.known_in(linear)
        for each in between_steps(known, weighed_terms(known, [noise.term])):
            found.append((each.log_mass + gained, noise.tested(each, known, gained)))
    return found


def beside_other(
    linear: Linear, noises: Sequence[CommonNoise], absorbed: Basis, terms: Sequence[Weighed]
) -> list[tuple[float, FittedNoise, list[Weighed]]]:
    """The same beside a discrepancy: log mass of both before the noise's prior, its strength, and the terms, the
    likeliest first.

    Each of what is left beside the other is told first, and both at once only where that promises something: one after
    the other, both count what either explains.

    Args:
        absorbed: the calibration's tangent. terms: of the discrepancy, the likeliest first.
    """
    found = []
    taken = terms[0].term.of_every_sample(linear.left, int(np.argmax(terms[0].gains)))
    less = replace(linear, left=linear.left - project(absorbed, taken))
    near = [each for each in terms[:_TERMS] if each.log_mass > terms[0].log_mass - _NEAR]
    for noise in noises:
        promising, gained = noise.known_in(less)
        first = between_steps(promising, weighed_terms(promising, [noise.term]))
        if not first or first[0].log_mass + gained < _PROMISING:
            continue
        known, gained = noise.known_in(linear)
        around = int(np.argmax(first[0].gains))
        some = range(max(around - _WINDOW, 0), min(around + _WINDOW, _STEPS))
        tables = [weighed_with(known, first[0].term, each.term, absorbed, some) for each in near]
        shares = np.array([each.term.log_prior + each.log_share for each in near])
        alone = float(np.logaddexp.reduce(shares + [np.logaddexp.reduce(each.gains) for each in near]))
        strength = np.logaddexp.reduce(shares[:, None] + np.logaddexp.reduce(tables, axis=2), axis=0) - alone
        gains = np.logaddexp.reduce(tables, axis=1) - np.log(_STEPS)
        both = [replace(each, gains=own) for each, own in zip(near, gains, strict=True)]
        both.sort(key=lambda each: -each.log_mass)
        log_mass = noise.term.log_prior + total([each.log_mass for each in both]) + gained
        found.append((log_mass, noise.tested(Weighed(first[0].term, strength), known, gained), both))
    return found


def weighed_with(linear: Linear, noise: Term, other: Term, absorbed: Basis, some: Sequence[int]) -> Array:
    """(amplitudes of the noise, of the other) log evidence of two terms at once beyond that of neither.

    Args:
        noise: of every sample, the calibration left in it. absorbed: the calibration's tangent.
        some: of the noise's amplitudes; all others are hopeless.
    """
    columns = linear.columns
    seen_best = np.argsort(-other.values)[:_MOST]
    along, seen = noise.along(columns), other.along(columns)[seen_best]
    shared = np.empty((len(noise.values), len(seen_best)))
    for first in range(0, len(seen_best), _AT_ONCE):
        own = seen_best[first : first + _AT_ONCE]
        unit = np.zeros((len(other.values), len(own)))
        unit[own, np.arange(len(own))] = 1.0
        made = project(other.errors.absorbed or absorbed, other.every_sample(other.made(unit)))
        shared[:, first : first + len(own)] = noise.along(made)
    found = np.full((len(noise.variances), len(other.variances)), -np.inf)
    for index in some:
        weight, determinant = noise.shrunk[0][index][:, None], noise.shrunk[1][index]
        core = np.diag(other.values[seen_best]) - (shared * weight).T @ shared
        values, vectors = np.linalg.eigh(core)
        right = vectors.T @ (seen - (shared * weight).T @ along)
        ratio = np.outer(other.variances, np.maximum(values, 0.0))
        less = np.einsum("ir,rp,rq->ipq", other.variances[:, None] / (1.0 + ratio), right, right, optimize=True)
        gained = linear.beyond((along * weight).T @ along + less)
        found[index] = gained - 0.5 * (determinant + np.log1p(ratio).sum(axis=1))
    return found
