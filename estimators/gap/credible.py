"""Whether several causes together are an explanation, or the shape of one that is not in the catalogue."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from estimators.gap.bench import Bench
from estimators.gap.candidates import Candidate
from estimators.gap.coherent import CLOCK, angle_of, drifts, likeliest, of_one_joint
from estimators.gap.refine import refit
from estimators.gap.rivals import MARGIN, Rival
from estimators.gap.score import Explained
from estimators.gap.select import MeanCause, Selection, cost, scanned
from rig.channels import CHANNELS, COLUMNS_OF
from rig.effects import Effect
from rig.effects.base import Stage
from rig.effects.timing import Latency

#: Cosine above which what two causes explain is of one shape.
ALIKE = 0.95
#: Three causes where one would do are a sign that the true one is not in the catalogue: each must hold its own.
_SEVERAL, _COMPARABLE = 3, 0.1
#: Sources of a field that varies with the arm: two of them together come close to most such fields.
_SOURCES = {"field_gradient", "base_dipole", "link_hard_iron", "link_soft_iron", "motor_current_field"}
#: Effects that stand for one another where neither is the true one: of two at once, the weaker must hold this share.
_KIN = (
    {
        "bias_warmup",
        "bias_temperature",
        "bias_step",
        "bias_random_walk",
        "noise_coloured",
        "scale_temperature",
        "supply_ratiometric",
    },
    {"latency", "sensor_lag", "hysteresis"},
    {*_SOURCES, "bias_random_walk", "noise_coloured"},
)
_OWN_SHARE = 0.1
#: Cycles in a recording below which a tone is taken for a slow wave, unless most channels feel it, each by so much.
_CYCLES, _MOST, _SEEN = 50.0, 0.6, 2.5
#: Evidence above which such a wave is a tone, and an effect of a sensor shows in two axes at least, in this ratio.
_EVIDENT, _ONE_AXIS = 200.0, 0.1
#: An error of one joint that lacks less than this share of the evidence of several causes, and less than this share of
#: the weakest's own, may well be what they stand for.
_LACKS, _LACKS_OWN = 0.1, 0.5


def plausible(state: Selection) -> bool:
    """Whether causes hold together, whatever their rivals.

    One does, unless it is a weak slow wave taken for an alias, or the effect of a sensor that shows in one of its
    axes alone. Several are invented, more likely than not, where the same effect is needed at two places, where two
    bend the same joint or the same field, where a weak one is of the same kin as a strong one, or where three are
    needed of which one is noise or small beside the strongest.
    """
    # each sensor may well have a delay of its own
    names = [cause.fit.candidate.effect.name for cause in state.causes if cause.fit.candidate.effect is not Latency]
    if len(set(names)) < len(names) or any(_slow(cause, state.bench) for cause in state.causes):
        return False
    effects = [(cause.fit.effect, cause.evidence) for cause in state.causes]
    effects += [(offer.effect, offer.evidence) for offer in state.noises]
    if any(evident > _EVIDENT and _one_axis(effect) for effect, evident in effects):
        return False
    causes = [cause.fit.effect for cause in state.causes]
    if any(_kin(offer.effect, cause) for offer in state.noises for cause in causes):
        return False
    for one, other in itertools.combinations(state.causes, 2):
        both = {one.fit.candidate.effect.name, other.fit.candidate.effect.name}
        if _one_organ(one.fit.candidate, other.fit.candidate) or both <= _SOURCES:
            return False
        sizes = sorted([one.statistic, other.statistic])
        if _kin(one.fit.effect, other.fit.effect) and sizes[0] < _OWN_SHARE * sizes[1]:
            return False
    if state.count < _SEVERAL:
        return True
    sizes = [cause.statistic for cause in state.causes]
    return not state.noises and state.count == _SEVERAL and min(sizes) > _COMPARABLE * max(sizes)


def _kin(one: Effect, other: Effect) -> bool:
    """Whether two effects stand for one another, on a channel that both change."""
    shared = set(range(len(CHANNELS))[one.columns]) & set(range(len(CHANNELS))[other.columns])
    return bool(shared) and any({one.name, other.name} <= kin for kin in _KIN)


def _slow(cause: MeanCause, bench: Bench) -> bool:
    """Whether a weak tone looks so slow, sampled, that a drift or the arm's own motion comes close to it.

    Hum from the mains does too, where a multiple of the sampling rate is near its frequency; but that is on every
    channel.
    """
    if not cause.fit.candidate.effect.tone or cause.evidence > _EVIDENT:
        return False
    interval_s = bench.interval_s / bench.samples
    cycles = float(vars(cause.fit.effect)["freq_Hz"]) * interval_s
    if abs(cycles - round(cycles)) * float(np.ptp(bench.t)) / interval_s > _CYCLES:
        return False
    white = bench.whiten(bench.change([cause.fit.effect]))
    felt = [float(np.linalg.norm(bench.channel(white, column))) > _SEEN for column in bench.columns]
    return sum(felt) < _MOST * len(felt)


def _one_axis(effect: Effect) -> bool:
    """Whether an effect of a whole sensor is next to nothing in two of its axes."""
    strengths = [item for item in effect.parameters() if item.strength]
    if effect.where not in COLUMNS_OF or [item.size for item in strengths] != [3]:
        return False
    sizes = np.sort(np.abs(getattr(effect, strengths[0].name)))
    return bool(sizes[1] < _ONE_AXIS * sizes[2])


def _one_organ(one: Candidate, other: Candidate) -> bool:
    return one.effect.stage is other.effect.stage is Stage.TRANSMISSION and one.where == other.where


def credible(state: Selection, groups: Sequence[Sequence[Rival]], bench: Bench) -> bool:
    """Whether causes are plausible, and nothing of another shape explains nearly as much.

    Nothing that is off along a course of its own, in the catalogue or not, and no clock; of several, no rival in the
    place of one, and none of them a second time; beside the strongest, no further error of its joint; and where none of
    them acts on a joint, no error of one joint's angle along many courses in the place of all.

    Args:
        bench: of the base fit, each mean with the rig evaluated once.
    """
    explained = float(bench.whitened @ bench.whitened) - cost(state)
    stages = {cause.fit.candidate.effect.stage for cause in state.causes}
    if len(state.causes) > 1 and Stage.TRANSMISSION not in stages and bench.base.q_encoder is not None:
        joint = of_one_joint(bench, Explained(bench.absorbed, bench.whitened))
        weakest = min(cause.evidence for cause in state.causes)
        if joint.evidence > explained - min(_LACKS * explained, _LACKS_OWN * weakest):
            return False
    clear = MARGIN if state.count == 1 else -MARGIN  # one error is likelier before the data than two
    if state.count and likeliest(bench.coarse(), len(state.candidates)) > explained + clear:
        return False
    if state.count == 1 and _clock(state, bench) > explained - MARGIN:
        return False
    if state.count > 1 and (_of_the_same_joint(state) or _twice(state)):
        return False
    inexact = any(not rival.exact(group[0]) and rival.cosine < ALIKE for group in groups for rival in group[1:])
    return plausible(state) and (state.count < 2 or not inexact)


def _clock(state: Selection, bench: Bench) -> float:
    """The evidence of a clock that drifts or jumps.

    In no catalogue, and no less likely than the scale of a joint that rolls on, or a slip about its axis.
    """
    steps = [at for cause in state.causes if isinstance(at := cause.fit.kept.get("at_s"), float)]
    return likeliest(bench, len(state.candidates), courses=drifts(bench, steps), only=[CLOCK])


def _of_the_same_joint(state: Selection) -> bool:
    """Whether a further error of the joint that the strongest cause acts on would do in the place of another cause."""
    if not state.causes:
        return False
    first = max(state.causes, key=lambda cause: cause.evidence)
    if first.fit.candidate.effect.stage is not Stage.TRANSMISSION:
        return False
    _, explained = refit([first.fit], state.rough)
    more = likeliest(state.rough, len(state.candidates), explained, only=[angle_of(first.fit.candidate.where)])
    return any(cause is not first and more > cause.evidence - MARGIN for cause in state.causes)


def _twice(state: Selection) -> bool:
    """Whether a cause a second time, in another shape, would do in the place of another: it has another form, then."""
    for cause in state.causes:
        others = [each.fit for each in state.causes if each is not cause]
        kinds = {each.candidate.label for each in others if each.candidate.effect.searched(state.bench.base) != [{}]}
        if not kinds:
            continue
        _, explained = refit(others, state.bench)
        found = {offer.candidate.label: offer.evidence for offer in scanned(state, others, explained)}
        own = found[cause.fit.candidate.label]
        if any(found[label] > own - MARGIN for label in kinds):
            return True
    return False
