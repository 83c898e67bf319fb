"""Rivals of a selected cause: what the data cannot split from it.

Each rival takes the cause's place with the other causes kept, and is refitted; those of nearly the same evidence are
its equivalents. A richer effect that only contains the cause, and explains no more, is no rival.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimators.gap.bench import Bench, Columns
from estimators.gap.converge import converged
from estimators.gap.refine import Fitted, refit, started
from estimators.gap.scan import Offer
from estimators.gap.score import Explained, evidence
from estimators.gap.select import BETTER, TIE, MeanCause, Selection, scanned, with_mean, without_noise
from estimators.gap.stochastic import NoiseOffer, noise_offers
from rig.effects import Effect
from rig.effects.timing import Latency

#: Evidence (twice a log Bayes factor) by which a cause must beat a rival to be named alone: 20 to 1.
MARGIN = 2.0 * float(np.log(20.0))
#: So many rivals of the first scan are refitted.
_REFITTED = 6
#: A rival of more strengths must explain this much more to count beside the cause.
_NESTED = 4.0
#: A rival whose first refit is this share of the evidence away is not fitted to the end.
_FAR = 0.15
#: On means over neighbouring samples evidence is known to this share.
_ROUGHLY = 0.02
#: What another form of an effect comes to: a filter of higher order is a delay, an offset that follows the temperature
#: with a bend is a warm-up. Beside the first the second stands, wherever they are as alike as this.
_FORM_OF, _AS_ALIKE = {"latency": "sensor_lag", "bias_warmup": "bias_temperature"}, 0.97
#: So often a cause gives way to a better rival.
_SWAPS = 3


@dataclass(frozen=True)
class Rival:
    """A cause that could stand in another's place.

    Attributes:
        label: effect and place in one word.
        effect, where: its name and place.
        evidence: twice the log Bayes factor in that place.
        statistic, rank: chi-square and degrees of freedom.
        fit, offer: its parameters, and what it offered in the scan; of a noise effect there are none.
        cosine: between what it explains and what the cause does, whitened, with the calibration projected out.
    """

    label: str
    effect: str
    where: str
    evidence: float
    statistic: float
    rank: int
    fit: Fitted | None = None
    offer: Offer | None = None
    cosine: float = 1.0

    def elsewhere(self, offer: Offer) -> Rival:
        """The same effect where it does the same: on another link of one body, say."""
        return replace(self, label=offer.candidate.label, where=offer.candidate.where, fit=None, offer=offer)

    def exact(self, own: Rival) -> bool:
        """Whether it explains the same, to the last bit of evidence: no data of this maneuver could split the two."""
        return abs(self.evidence - own.evidence) < TIE


def rivals(state: Selection, cause: MeanCause) -> list[Rival]:
    """The cause itself first, then all within the margin of it, the most evident first."""
    others = [each for each in state.causes if each is not cause]
    fits, explained = refit([each.fit for each in others], state.bench)
    own = _own(state, cause, fits, explained)
    taken = {each.fit.candidate.label for each in state.causes}
    if sum(each.fit.candidate.effect is Latency for each in state.causes) > 1:
        taken.add("latency@acquisition")  # the same delays, counted otherwise
    every = [offer for offer in scanned(state, fits, explained) if offer.score.strengths.size]
    offers = [offer for offer in every if offer.candidate.label not in taken]
    mine = [offer for offer in every if offer.candidate.label == cause.fit.candidate.label]
    scanned_as = min(own.evidence, *(offer.evidence for offer in mine), np.inf)  # less than refitted, mostly
    near = [offer for offer in offers if offer.evidence > scanned_as - 4.0 * MARGIN]
    found = [own.elsewhere(offer) for offer in near for each in mine if _same(offer, each)]
    placed = {rival.label for rival in found}
    firsts: list[Offer] = []
    for offer in [offer for offer in near if offer.candidate.label not in placed][:_REFITTED]:
        if not any(_same(offer, first) for first in firsts):
            firsts.append(offer)
    for offer in _close(firsts, state, cause, others):
        fit = started(offer, state.bench, explained)
        rival = _stand_in(offer, fit, fits, state.bench, explained, own.evidence - _FAR * (own.evidence + MARGIN))
        if rival.evidence > own.evidence - MARGIN:
            rival = replace(rival, cosine=_cosine(rival, own, state, explained))
            found += [rival, *(rival.elsewhere(twin) for twin in near if twin is not offer and _same(twin, offer))]
    seen = {rival.label for rival in found} | {offer.candidate.label for offer in near[:_REFITTED]}
    exact = [
        _linear(offer)
        for offer in offers
        if offer.candidate.label not in seen and offer.evidence > own.evidence - MARGIN
    ]
    exact = [replace(rival, cosine=_cosine(rival, own, state, explained)) for rival in exact]
    kept = [rival for rival in [*found, *exact] if not _contains(rival, own)]
    named = {rival.label for rival in kept}
    kept += _in_another_form(own, [offer for offer in offers if offer.candidate.label not in named], state, explained)
    return [own, *sorted(kept, key=lambda rival: -rival.evidence)]


def _in_another_form(own: Rival, offers: Sequence[Offer], state: Selection, explained: Explained) -> list[Rival]:
    """The effect that would do as well in another form than the catalogue's."""
    alike = [
        _linear(offer)
        for offer in offers
        if offer.candidate.effect.name == _FORM_OF.get(own.effect) and offer.candidate.where == own.where
    ]
    found = [replace(rival, cosine=_cosine(rival, own, state, explained)) for rival in alike]
    return [rival for rival in found if rival.cosine > _AS_ALIKE]


def _close(near: list[Offer], state: Selection, cause: MeanCause, others: Sequence[MeanCause]) -> list[Offer]:
    """Of the offers those that come close to the cause on means over neighbouring samples, or cannot be seen there."""
    rough = state.rough
    if rough is state.bench or not near or not all(each.fit.candidate.smooth for each in state.causes):
        return near
    fits, explained = refit([each.fit for each in others], rough)
    own = _stand_in(cause.offer, cause.fit, fits, rough, explained, -np.inf)
    least = own.evidence - MARGIN - BETTER - _ROUGHLY * own.evidence
    return [
        offer
        for offer in near
        if not offer.candidate.smooth
        or _stand_in(offer, started(offer, rough, explained), fits, rough, explained, least).evidence > least
    ]


def settled(state: Selection, worthwhile: bool = True) -> tuple[Selection, list[list[Rival]]]:
    """The selection in which no cause has a better rival, and the rivals of each.

    Forward selection takes the first cause before it knows the second: a cause that another would serve better in its
    place, now that all are known, gives way to it.

    Args:
        worthwhile: False where the causes are no explanation whatever their rivals: these are not looked for.
    """
    groups: list[list[Rival]] = []
    if not worthwhile:
        return state, [[_as_selected(cause)] for cause in state.causes]
    for swap in range(_SWAPS + 1):
        groups = [rivals(state, cause) for cause in state.causes]
        better = [
            (max(group[1:], key=lambda rival: rival.evidence), index)
            for index, group in enumerate(groups)
            if len(group) > 1 and max(rival.evidence for rival in group[1:]) > group[0].evidence + BETTER
        ]
        if not better:
            break
        if swap == _SWAPS:
            break
        rival, index = max(better, key=lambda pair: pair[0].evidence - groups[pair[1]][0].evidence)
        assert rival.offer is not None
        others = [cause for position, cause in enumerate(state.causes) if position != index]
        _, explained = refit([cause.fit for cause in others], state.bench)
        fit = rival.fit or started(rival.offer, state.bench, explained)
        state = with_mean(state, [*others, MeanCause(fit, rival.offer)])
    return state, groups


def noise_rivals(state: Selection, offer: NoiseOffer, without: Sequence[str]) -> list[Rival]:
    """The noise effect itself first, then the other noise effects within the margin of it."""
    own = _noise(offer)
    rest = without_noise(state, offer)
    offers = noise_offers(rest.bench, rest.explained, without)
    again = next((each for each in offers if each.label == own.label), offer)
    others = [each for each in offers if each.label != own.label and each.evidence > again.evidence - MARGIN]
    return [own, *(_noise(each) for each in others)]


def _cosine(rival: Rival, own: Rival, state: Selection, explained: Explained) -> float:
    assert rival.offer is not None
    assert own.fit is not None
    fits = [rival.fit or started(rival.offer, state.bench, explained), own.fit]
    one, other = (explained.without(state.bench.whiten(state.bench.change([fit.effect]))) for fit in fits)
    return float(abs(one @ other) / max(float(np.linalg.norm(one) * np.linalg.norm(other)), 1e-12))


def _same(one: Offer, other: Offer) -> bool:
    """Whether two offers are one effect that does the same at both places."""
    alike = np.isclose(one.score.statistic, other.score.statistic, rtol=1e-7)
    return bool(one.candidate.effect is other.candidate.effect and alike)


def _contains(rival: Rival, own: Rival) -> bool:
    return rival.rank > own.rank and rival.statistic < own.statistic + _NESTED * (rival.rank - own.rank)


def _as_selected(cause: MeanCause) -> Rival:
    effect, where = cause.fit.candidate.effect.name, cause.fit.candidate.where
    return Rival(cause.fit.candidate.label, effect, where, cause.evidence, cause.statistic, cause.rank, cause.fit)


def _linear(offer: Offer) -> Rival:
    effect = offer.candidate.effect.name
    score = offer.score
    place = offer.candidate.where
    return Rival(offer.candidate.label, effect, place, offer.evidence, score.statistic, score.rank, None, offer)


def _noise(offer: NoiseOffer) -> Rival:
    return Rival(offer.label, offer.effect.name, offer.effect.where, offer.evidence, offer.gain, offer.rank)


def _own(state: Selection, cause: MeanCause, fits: list[Fitted], explained: Explained) -> Rival:
    """The cause in its own place: it is fitted already."""
    return _weighed(cause.offer, cause.fit, [fit.effect for fit in fits], state.bench, explained, state.explained)


def _stand_in(
    offer: Offer, fit: Fitted, others: list[Fitted], bench: Bench, explained: Explained, worthwhile: float
) -> Rival:
    """An offer refitted together with the other causes; the calibration as well where the evidence is worthwhile."""
    refitted, after = refit([*others, fit], bench)
    gain = float(explained.residual @ explained.residual) - float(after.residual @ after.residual)
    if gain > worthwhile:
        refitted, after, bench = converged(refitted, bench)
    return _weighed(offer, refitted[-1], [each.effect for each in refitted[:-1]], bench, explained, after)


def _weighed(
    offer: Offer, fit: Fitted, others: list[Effect], bench: Bench, before: Explained, after: Explained
) -> Rival:
    statistic = float(before.residual @ before.residual) - float(after.residual @ after.residual)
    rank = max(1, before.score(Columns(fit.tangent(bench, others), 0)).rank)
    strength = evidence(statistic, rank) - 2.0 * float(np.log(offer.searched)) * (rank <= offer.score.rank)
    effect = offer.candidate.effect.name
    return Rival(offer.candidate.label, effect, offer.candidate.where, strength, statistic, rank, fit, offer)
