"""Which causes: forward selection among all kinds, refitted for real after every step, then backward.

The causes are added in the order of their evidence; a cause that another one makes superfluous is dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench, Columns, project
from estimators.gap.blocks import block_means
from estimators.gap.candidates import Candidate, all_candidates
from estimators.gap.converge import converged
from estimators.gap.rebase import around
from estimators.gap.refine import Fitted, started, tangents
from estimators.gap.scan import Offer, Scanner
from estimators.gap.score import Explained, evidence
from estimators.gap.stochastic import NoiseOffer, noise_offers
from rig.effects import EFFECTS
from rig.effects.timing import Latency

Array = NDArray[np.float64]

#: Logarithm of the largest p-value, over all mean or all noise effects, at which a cause is added: at most one false
#: alarm in a thousand runs.
SIGNIFICANT = float(np.log(5e-4))
#: Smallest evidence (twice a log Bayes factor) of a cause: "very strong" (Kass and Raftery, JASA 90, 1995).
STRONG = 10.0
#: More causes than this at once are no explanation.
MOST_CAUSES = 3
#: Evidence by which two offers differ at most to be twins.
TIE = 0.5
#: Beyond this evidence a cause may stretch the calibration further than its tangent: effects that offer nearly as much
#: are refitted too, so many of them.
_STRETCHED, _NEAR, _TRIED = 500.0, 0.3, 4
#: Of these, what is worse by this share on means over neighbouring samples is not refitted sample by sample.
_CLOSE = 0.02
#: Evidence by which one refit must be better than another: beyond what unfinished ones differ by.
BETTER = 3.0
#: Where noise and a mean effect explain amounts that differ by less than this factor, both ways are followed.
CONTESTED = 0.5


@dataclass(frozen=True)
class MeanCause:
    """A mean effect that was selected.

    Attributes:
        fit: with its parameters.
        offer: what it explained when it was scanned with the others in place.
        statistic, rank: what it explains beyond the others, refitted.
    """

    fit: Fitted
    offer: Offer
    statistic: float = 0.0
    rank: int = 1

    @property
    def evidence(self) -> float:
        """Twice the log Bayes factor of the cause, with the others in place."""
        return evidence(self.statistic, self.rank) - 2.0 * float(np.log(self.offer.searched))


@dataclass(frozen=True)
class Selection:
    """The selected causes, and what they leave.

    Attributes:
        bench: with the selected noise whitened too.
        causes: the mean effects.
        noises: the noise effects.
        explained: tangent of calibration and causes; the residual that is left.
        candidates: what was considered. scanner: its columns on the bench.
        quiet: the scanner on the bench before any noise effect.
    """

    bench: Bench
    causes: tuple[MeanCause, ...]
    noises: tuple[NoiseOffer, ...]
    explained: Explained
    candidates: tuple[Candidate, ...]
    scanner: Scanner
    quiet: Scanner

    @cached_property
    def rough(self) -> Bench:
        """The bench as means over neighbouring samples."""
        rough = self.scanner.rough.bench
        return rough if rough.pipeline is self.bench.pipeline else around(rough, self.bench.pipeline)

    @property
    def count(self) -> int:
        """How many causes."""
        return len(self.causes) + len(self.noises)


def start(bench: Bench, without: Sequence[str] = ()) -> Selection:
    """No cause yet."""
    explained = Explained(bench.absorbed, bench.whitened)
    scanner = Scanner.of(bench)
    return Selection(bench, (), (), explained, tuple(all_candidates(bench, without)), scanner, scanner)


def select(bench: Bench, without: Sequence[str] = (), progress: Callable[[float], None] | None = None) -> Selection:
    """Forward, then backward selection; where noise and a mean effect both explain the gap, both ways are followed."""
    return _apart(_followed(start(bench, without), without, progress))


def _apart(state: Selection) -> Selection:
    """A delay of all channels and a further one of one sensor as what they are: a delay of each sensor."""
    delays = {cause.fit.candidate.where: cause for cause in state.causes if cause.fit.candidate.effect is Latency}
    common = delays.pop("acquisition", None)
    if common is None or len(delays) != 1:
        return state
    ((where, further),) = delays.items()
    causes = [cause for cause in state.causes if cause is not common and cause is not further]
    for sensor in state.bench.pipeline.sensors:
        candidate = replace(common.fit.candidate, where=sensor)
        values = common.fit.values + (further.fit.values if sensor == where else 0.0)
        fit = replace(common.fit, candidate=candidate, values=values)
        causes.append(MeanCause(fit, replace(common.offer, candidate=candidate)))
    return with_mean(state, causes)


def _followed(
    state: Selection, without: Sequence[str], progress: Callable[[float], None] | None, parting: bool = True
) -> Selection:
    while state.count < MOST_CAUSES:
        if progress is not None:
            progress(state.count / MOST_CAUSES)
        means, noise = _mean_offers(state), _noise_offer(state, without)
        if not means and noise is None:
            break
        mean = means[0] if means else None
        if parting and mean is not None and noise is not None and not state.noises and _contested(mean, noise):
            ways = [_with_offers(state, means), with_noise(state, noise)]
            return min((_followed(way, without, None, parting=False) for way in ways), key=cost)
        if noise is None or (mean is not None and mean.evidence >= noise.evidence):
            state = _with_offers(state, means)
        else:
            state = with_noise(state, noise)
    return pruned(state, without)


def _contested(mean: Offer, noise: NoiseOffer) -> bool:
    return min(mean.evidence, noise.evidence) > CONTESTED * max(mean.evidence, noise.evidence)


def cost(state: Selection) -> float:
    """Minus twice the log evidence of a selection, up to a constant: misfit, and what the causes cost."""
    misfit = float(state.explained.residual @ state.explained.residual)
    columns = state.bench.columns
    for offer in state.noises:
        misfit += float(np.sum(np.log1p(offer.added[:, columns])))
    paid = sum(cause.statistic - cause.evidence for cause in state.causes)
    return misfit + paid + sum(offer.gain - offer.evidence for offer in state.noises)


def _mean_offers(state: Selection) -> list[Offer]:
    """The mean effects to add next: one, or several of which only a refit can tell which is best.

    Of exact twins the likelier before the data comes first.
    """
    taken = {cause.fit.candidate.label for cause in state.causes}
    offers = [
        offer
        for offer in scanned(state, [cause.fit for cause in state.causes], state.explained)
        if offer.candidate.label not in taken and offer.score.rank
    ]
    if not offers:
        return []
    twins = [offer for offer in offers if offer.evidence > offers[0].evidence - TIE]
    best = min(twins, key=lambda offer: preference(offer.candidate, state.bench))
    if best.log_p + np.log(len(offers)) >= SIGNIFICANT or best.evidence < STRONG:
        return []
    near = [offer for offer in offers if offer.evidence > best.evidence * (1.0 - _NEAR) and offer.score.strengths.size]
    several = best.evidence > _STRETCHED and len({offer.candidate.effect.name for offer in near}) > 1
    kinds = {offer.candidate.effect.name: offer for offer in [*reversed(near), best]} if several else {}
    return [best, *[offer for offer in kinds.values() if offer is not best][:_TRIED]]


def scanned(state: Selection, fits: Sequence[Fitted], explained: Explained) -> list[Offer]:
    """The offers of all candidates beside fitted effects, the most evident first."""
    return state.scanner.scan(state.candidates, explained, roughly(state, fits, explained))


def roughly(state: Selection, fits: Sequence[Fitted], explained: Explained) -> Explained:
    """What fitted effects leave on the selection's bench, as means over neighbouring samples."""
    bench, rough = state.bench, state.scanner.rough.bench
    if state.scanner.rough is state.scanner.fine:
        return explained
    size = bench.count // rough.count
    left = bench.residual - bench.change([fit.effect for fit in fits])
    means = np.stack([block_means(left[:, each], size, bench.weights[:, each] > 0) for each in range(6)], axis=1)
    explained = Explained(rough.absorbed, project(rough.absorbed, rough.whiten(means)))
    return explained.extended(np.hstack(tangents(fits, rough))) if fits else explained


def _noise_offer(state: Selection, without: Sequence[str]) -> NoiseOffer | None:
    """The noise effect to add next."""
    named = {offer.label for offer in state.noises}
    offers = [offer for offer in noise_offers(state.bench, state.explained, without) if offer.label not in named]
    if not offers or offers[0].log_p + np.log(len(offers)) > SIGNIFICANT or offers[0].evidence < STRONG:
        return None
    return offers[0]


def _with_offers(state: Selection, offers: Sequence[Offer]) -> Selection:
    """With one more mean cause: of several offers the one that explains most once it is refitted."""
    fresh = [MeanCause(started(offer, state.bench, state.explained), offer) for offer in offers]
    if len(fresh) > 1 and (rough := state.rough) is not state.bench:
        kept = [cause.fit for cause in state.causes]
        left = [converged([*kept, cause.fit], rough)[1].residual for cause in fresh]
        misfits = [float(each @ each) for each in left]
        close = min(misfits) + _CLOSE * offers[0].evidence
        fresh = [
            cause
            for cause, misfit in zip(fresh, misfits, strict=True)
            if misfit < close or not cause.fit.candidate.smooth
        ]
    ways = [with_mean(state, [*state.causes, cause]) for cause in fresh]
    least = min(cost(way) for way in ways)
    return next(way for way in ways if cost(way) < least + BETTER)  # of twins the likelier before the data


def preference(candidate: Candidate, bench: Bench) -> tuple[bool, int]:
    """The order among twins: joints that stand still last, then the catalogue's order."""
    still = False
    if candidate.where.startswith("joint") and bench.base.q_encoder is not None:
        still = bool(np.ptp(bench.base.q_encoder[:, int(candidate.where[-1]) - 1]) < 1e-3)
    return still, list(EFFECTS).index(candidate.effect.name)


def with_mean(state: Selection, causes: Sequence[MeanCause]) -> Selection:
    """The selection with these mean causes, refitted together."""
    fits, explained, bench = converged([cause.fit for cause in causes], state.bench, state.rough)
    if bench is not state.bench:
        scanner = state.scanner.around(bench)
        quiet = state.quiet.around(around(state.quiet.fine.bench, bench.pipeline)) if state.noises else scanner
        state = replace(state, bench=bench, quiet=quiet, scanner=scanner)
    fresh = [replace(cause, fit=fit) for cause, fit in zip(causes, fits, strict=True)]
    return replace(state, causes=tuple(weighed(fresh, bench, explained)), explained=explained)


def with_noise(state: Selection, offer: NoiseOffer) -> Selection:
    """The selection with one more noise effect whitened, the mean causes refitted."""
    scanner = state.scanner.stepped(offer.steps(state.bench))
    fresh = replace(state, bench=scanner.fine.bench, noises=(*state.noises, offer), scanner=scanner)
    return with_mean(fresh, state.causes)


def weighed(causes: Sequence[MeanCause], bench: Bench, explained: Explained) -> list[MeanCause]:
    """Each cause with what it explains beyond the others: its part of the residual, tested with theirs projected
    out."""
    result = []
    causes = list(causes)
    effects = [cause.fit.effect for cause in causes]
    own_tangents = [cause.fit.tangent(bench) for cause in causes]
    for index, cause in enumerate(causes):
        rest = Explained(bench.absorbed, bench.whitened)
        for other in own_tangents[:index] + own_tangents[index + 1 :]:
            rest = rest.extended(other)
        own = bench.whiten(bench.change(effects) - bench.change(effects[:index] + effects[index + 1 :]))
        residual = rest.without(own) + explained.residual
        score = replace(rest, residual=residual).score(Columns(own_tangents[index], 0))
        result.append(replace(cause, statistic=score.statistic, rank=max(score.rank, 1)))
    return result


def pruned(state: Selection, without: Sequence[str] = ()) -> Selection:
    """Without the causes that the others make superfluous."""
    while state.causes:
        weakest = min(state.causes, key=lambda cause: cause.evidence)
        if weakest.evidence >= STRONG:
            break
        state = with_mean(state, [cause for cause in state.causes if cause is not weakest])
    for offer in state.noises:
        rest = without_noise(state, offer)
        again = [each for each in noise_offers(rest.bench, rest.explained, without) if each.label == offer.label]
        if not again or again[0].evidence < STRONG or again[0].log_p > SIGNIFICANT - np.log(len(EFFECTS)):
            return pruned(rest, without)
    return state


def without_noise(state: Selection, offer: NoiseOffer) -> Selection:
    """The selection without one of its noise effects, the mean causes refitted."""
    kept = tuple(each for each in state.noises if each is not offer)
    scanner = state.quiet
    for each in kept:
        scanner = scanner.stepped(each.steps(scanner.fine.bench))
    return with_mean(replace(state, bench=scanner.fine.bench, noises=kept, scanner=scanner), state.causes)
