"""How far a maneuver would separate the explanations between which a recording does not decide.

T-optimality (Atkinson and Fedorov, "The design of experiments for discriminating between two rival models", Biometrika
62, 1975): one of them, as it was fitted, makes the readings of the maneuver; another explains them as well as it can,
with its own parameters and the calibration free. The squared whitened distance that is left is the noncentrality of
the chi-square by which the wrong one will fit worse.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import ndtr, ndtri

from estimators.gap.data.modelled import known
from estimators.gap.data.projection import orthonormal, project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Cause, Diagnosis
from estimators.gap.evidence.refine import Fitted, explained_by, refit, started, tangents
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.candidates import Candidate, all_candidates
from estimators.gap.hypotheses.scan import KEPT, Scanner
from estimators.gap.hypotheses.score import ABSORBED
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind, make_effect, without_nulls
from rig.pipeline import Pipeline
from rig.signals import Signals

#: Two-sided 95 % of a normal distribution.
_Z95 = float(ndtri(0.975))
#: Squared share of a column's length below which it depends on the others: Gram matrices resolve no smaller ones.
_RANK = 1e-10
#: So many explanations are weighed against each other: the likeliest.
MOST_EXPLANATIONS = 5

#: A set of causes, each (effect, place).
Causes = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Explanation:
    """A set of effects fitted to a recording together.

    Attributes:
        fits: the effects with their parameters.
        covariance: (p, p) of all their values, in typical sizes.
        hidden: (p, h) directions of them that the recording does not feel, in typical sizes.
    """

    fits: tuple[Fitted, ...]
    covariance: Array
    hidden: Array

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Its effects."""
        return tuple(fit.effect for fit in self.fits)

    @property
    def size(self) -> int:
        """The number of fitted parameters."""
        return len(self.covariance)

    def within(self, other: Explanation) -> bool:
        """Whether another explanation has all of its effects, and more."""
        mine, others = (Counter((each.name, each.where) for each in one.effects) for one in (self, other))
        return mine < others

    def moved(self, change: Array) -> Explanation:
        """With the values changed by ``change`` (p,) in typical sizes."""
        ends = np.cumsum([len(fit.values) for fit in self.fits])[:-1]
        parts = zip(self.fits, np.split(change, ends), strict=True)
        return replace(self, fits=tuple(replace(fit, values=fit.values + part * fit.scale) for fit, part in parts))

    def tangent(self, data: WhitenedData) -> Array:
        """(c n, p) whitened derivatives, each scaled to a typical size."""
        return np.hstack(tangents(self.fits, data))


@dataclass(frozen=True)
class Separation:
    """What a maneuver promises for a pair: the truth, and a rival that explains its readings as well as it can.

    Attributes:
        truth, rival: the effects of both.
        noncentrality: of the chi-square by which the rival fits worse.
        low, high: 95 % interval of that chi-square as it will be measured: noise, and the truth's fitted parameters.
            Where the recording does not feel all of these, the least separation is promised, and high is infinite.
    """

    truth: tuple[Effect, ...]
    rival: tuple[Effect, ...]
    noncentrality: float
    low: float
    high: float

    @property
    def mistaken(self) -> float:
        """The probability that noise makes the rival fit better."""
        return float(ndtr(-0.5 * np.sqrt(self.noncentrality)))


def rivals(diagnosis: Diagnosis) -> tuple[Causes, ...]:
    """The sets of causes between which a recording does not decide, the likeliest first; empty where it does.

    The likeliest sets of catalogue effects alone, as many as it takes to reach the probability of a named one; then
    the likeliest of them with what does the same to this recording in a cause's place.
    """
    if diagnosis.verdict not in ("named", "ambiguous"):
        return ()
    found = [one.causes for one in diagnosis.alternatives]
    for cause in diagnosis.causes:
        own = cause.effect, cause.where
        if found and own in found[0]:
            index = found[0].index(own)
            for each in cause.equivalent:
                other = str(each["effect"]), str(each["where"])
                found.append((*found[0][:index], other, *found[0][index + 1 :]))
    kept = tuple(dict.fromkeys(found))[:MOST_EXPLANATIONS]
    return kept if len(kept) > 1 else ()


def contest(data: WhitenedData, diagnosis: Diagnosis) -> tuple[Explanation, ...]:
    """The sets between which a recording does not decide, each fitted to it; empty where fewer than two are left.

    Noise effects are no part of it: no maneuver tells one spectrum from another.

    Args:
        data: of the diagnosed recording, the calibration alone fitted.
    """
    scanner = Scanner.of(data)
    found: dict[Causes, Explanation] = {}
    for causes in rivals(diagnosis):
        means = tuple(sorted(each for each in causes if EFFECTS[each[0]].kind is Kind.MEAN))
        if means and means not in found and (fits := _fitted(means, diagnosis, data, scanner)):
            found[means] = _explanation(fits, data)
    return tuple(found.values()) if len(found) > 1 else ()


def _fitted(causes: Causes, diagnosis: Diagnosis, data: WhitenedData, scanner: Scanner) -> tuple[Fitted, ...]:
    """A set fitted: from the diagnosed parameters, and what it did not report from a scan beside these."""
    told = list(diagnosis.causes)
    fits: list[Fitted] = []
    missing = []
    for name in causes:
        cause = next((each for each in told if (each.effect, each.where) == name), None)
        if cause is None:
            missing.append(name)
        else:
            told.remove(cause)
            fits.append(fitted_cause(cause))
    found = refit(fits, data)
    for name in missing:
        tests = scanner.scan(_named(data, *name), found.explained, explained_by(found.fits, scanner.rough.data))
        if not tests or not tests[0].score.rank:
            return ()
        found = refit([*found.fits, started(tests[0], data, found.explained)], data)
    return tuple(found.fits)


def fitted_cause(cause: Cause) -> Fitted:
    """A diagnosed mean cause as it was fitted; what the recording did not feel has its neutral value."""
    effect = EFFECTS[cause.effect]
    names = {name: str(cause.parameters[name].value) for name in effect.choices()}
    values = {name: estimate.value for name, estimate in cause.parameters.items()}
    made = make_effect(cause.effect, without_nulls(cause.effect, {"where": cause.where, **values}))
    kept = {
        item.name: getattr(made, item.name)
        for item in effect.parameters()
        if item.name in KEPT or values.get(item.name) is None
    }
    fit = Fitted(Candidate(effect, cause.where, names), np.empty(0), kept)
    numbers = [np.atleast_1d(np.asarray(getattr(made, item.name), dtype=float)) for item in fit.free]
    return replace(fit, values=np.concatenate(numbers) if numbers else np.empty(0))


def _named(data: WhitenedData, effect: str, where: str) -> list[Candidate]:
    return [each for each in all_candidates(data) if (each.effect.name, each.where) == (effect, where)]


def _explanation(fits: tuple[Fitted, ...], data: WhitenedData) -> Explanation:
    found = Explanation(fits, np.empty((0, 0)), np.empty((0, 0)))
    tangent = found.tangent(data)
    length = np.maximum(np.linalg.norm(tangent, axis=0), 1e-100)
    left = project(data.absorbed, tangent / length)
    values, vectors = np.linalg.eigh(left.T @ left)
    felt = values > ABSORBED**2
    directions = vectors / length[:, None]
    covariance = (directions[:, felt] / values[felt]) @ directions[:, felt].T
    return replace(found, covariance=covariance, hidden=directions[:, ~felt])


@dataclass(frozen=True)
class Trial:
    """A maneuver tried out on the calibrated rig, without noise.

    Attributes:
        data: its readings are those of the rig without effects.
        explanations: at least two.
    """

    data: WhitenedData
    explanations: tuple[Explanation, ...]

    @classmethod
    def of(
        cls,
        signals: Signals,
        pipeline: Pipeline,
        floor: Sequence[ChannelNoise],
        stride: int,
        group: tuple[Explanation, ...],
    ) -> Trial:
        """Of a maneuver's encoder angles.

        Args:
            signals: every ``stride``-th sample of it.
            pipeline: the calibrated rig, without effects.
            floor: noise of each channel, at every sample.
        """
        base = known(pipeline.expected(signals, np.random.default_rng(0)))
        interval = float(np.median(np.diff(base.t)))
        noises = tuple(channel.averaged(stride, interval / stride) for channel in floor)
        weights = np.ones_like(base.volts)
        return cls(WhitenedData(base, pipeline, base.volts, noises, weights, tuple(floor)), group)

    @cached_property
    def changes(self) -> list[Array]:
        """Of each explanation: (c n,) whitened, what its effects change."""
        return [self.data.whiten(self.data.change(list(each.effects))) for each in self.explanations]

    @cached_property
    def tangents(self) -> list[Array]:
        """Of each explanation: (c n, p) whitened."""
        return [each.tangent(self.data) for each in self.explanations]

    @cached_property
    def noncentralities(self) -> Array:
        """(k, k) for each truth (row) and each rival (column), to first order; zero on the diagonal."""
        hidden = [tangent @ each.hidden for tangent, each in zip(self.tangents, self.explanations, strict=True)]
        blocks = [self.data.tangent, *self.tangents, *hidden, np.stack(self.changes, axis=1)]
        columns = np.hstack(blocks)
        first = np.cumsum([0] + [block.shape[1] for block in blocks])
        parts = [slice(start, end) for start, end in pairwise(first)]
        gram = columns.T @ columns
        length = np.sqrt(np.where(np.diag(gram) > 0.0, np.diag(gram), 1.0))
        calibrated = _left_over(gram, parts[0], length)
        count = len(self.explanations)
        found = np.zeros((count, count))
        for rival in range(count):
            fitted = _left_over(calibrated, parts[1 + rival], length)
            for truth in set(range(count)) - {rival}:
                left = _left_over(fitted, parts[1 + count + truth], length)[first[-2] :, first[-2] :]
                found[truth, rival] = left[truth, truth] + left[rival, rival] - 2.0 * left[truth, rival]
        return np.maximum(found, 0.0)

    def promise(self, truth: int, rival: int) -> Separation:
        """The separation with the rival refitted for real, and its interval."""
        true, other = self.explanations[truth], self.explanations[rival]
        own = orthonormal(project(self.data.absorbed, self.tangents[rival]))
        tangent = project(own, project(self.data.absorbed, self.tangents[truth]))
        left = project(own, project(self.data.absorbed, self.changes[truth] - self.changes[rival]))
        nearest, *_ = np.linalg.lstsq(tangent @ true.hidden, -left, rcond=1e-6)
        left = left + tangent @ true.hidden @ nearest
        effects = true.moved(true.hidden @ nearest).effects
        made = replace(self.data, readings=self.data.base.volts + self.data.change(list(effects)))
        left_over = refit(other.fits, made).explained.residual
        size = float(left_over @ left_over)
        gradient = 2.0 * tangent.T @ left
        fitted = float(gradient @ true.covariance @ gradient)
        # the difference of two residual sums of squares: chi-square of the rival less that of the truth
        mean = size + true.size - other.size
        spread = _Z95 * float(np.sqrt(4.0 * size + 2.0 * (true.size + other.size) + fitted))
        high = np.inf if true.hidden.shape[1] else mean + spread
        return Separation(true.effects, other.effects, size, mean - spread, high)


def _left_over(gram: Array, explained: slice, length: Array) -> Array:
    """The Gram matrix (m, m) of columns once some of them, of original lengths (m,), are projected out of all."""
    scale = length[explained]
    values, vectors = np.linalg.eigh(gram[explained, explained] / np.outer(scale, scale))
    kept = values > _RANK
    along = (vectors[:, kept] / np.sqrt(values[kept])).T @ (gram[explained] / scale[:, None])
    return np.asarray(gram - along.T @ along)
