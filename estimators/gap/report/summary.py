"""From the posterior to the diagnosis: verdict, causes, channels, closure, what is left, what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.defects import Defect
from estimators.gap.data.stack import Stack
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import (
    ESTIMATED_FLOOR,
    Cause,
    Closed,
    Diagnosis,
    Estimate,
    Hypothesis,
    OneOf,
    verdict_of,
)
from estimators.gap.evidence.converge import converged
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.pooled import pooled
from estimators.gap.report import by_channel, closed_shares, closure, left_over, marginal, same_sets
from estimators.gap.report.by_recording import of_several
from estimators.gap.report.louder_rest import loud_floor_words
from estimators.gap.report.one_of import at_least_one
from estimators.gap.report.p_values import defect_probability, doubts
from estimators.gap.report.recorded_units import in_recorded_units
from estimators.gap.report.shift import calibration_shift
from estimators.gap.report.told import REPORTED, Told, told
from estimators.gap.report.unsure_rest import unsure_floor_words
from estimators.gap.search.hypothesis import Hypothesis as Found
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.effects import Effect
from rig.errors import in_short
from rig.recording import Recording

#: Explanations that are listed: how likely, and how many.
_LISTED, _MOST = 0.005, 50
#: Causes that are likely enough to be told of, beside those of the likeliest explanation.
_TOLD: Final = 0.1
#: Shares of a hypothesis' probability that are not followed.
_NO_SHARE: Final = 1e-9
_NO_CLOSURE: Final = Closed(None, None, None)


def conclude(
    recordings: Sequence[Recording],
    data: WhitenedData,
    posterior: Posterior,
    defects: Sequence[Sequence[Defect]],
    without: Sequence[str],
    floors: Sequence[tuple[ChannelNoise, ...]],
    sources: Sequence[str],
) -> tuple[Diagnosis, list[Effect]]:
    """The diagnosis that a posterior supports, and the mean effects of its leading explanation that are reported.

    Args:
        recordings, data: what was diagnosed; the data with the base fit's noise, defects left out.
        posterior: over everything but the defects.
        defects: of each recording's single readings.
        without: effects left out of the catalogue: their defects have no name.
        floors: of each recording, the noise of each channel. sources: where these come from.
    """
    posterior = same_sets.merged(posterior)
    defects = [
        # nobody knows the converter's own step: a lattice is no cause
        [defect for defect in own if source == "locked recording" or defect.effect != "adc_quantisation"]
        for own, source in zip(defects, sources, strict=True)
    ]
    named = [(defect, number) for number, own in enumerate(defects) for defect in own if defect.effect not in without]
    nameless = any(defect.effect in without for own in defects for defect in own)
    certain: dict[tuple[str, str], float] = {}
    for each, number in named:
        key, beside = (each.effect, each.where), data.parts[number] if posterior.leading.other else None
        certain[key] = max(certain.get(key, 0.0), defect_probability(each, posterior.prior, beside))
    named = [(each, number) for each, number in named if certain[each.effect, each.where] >= _TOLD]
    certain = {key: probability for key, probability in certain.items() if probability >= _TOLD}
    same = marginal.twins(posterior)
    places = marginal.places(posterior, same)
    doubted = doubts(posterior)
    hypotheses, masses, omitted, one_of = _listed(posterior, places, same, certain, nameless, doubted)
    single = [name for name, probability in certain.items() if probability >= REPORTED]
    number = _told_of(posterior, places, same, doubted, hypotheses[:1], single, nameless)
    weighed, believed = posterior.hypotheses[number], _believed(posterior.hypotheses[number], doubted.get(number))
    likely = [at for at, share in enumerate(posterior.probabilities) if share >= _TOLD or at == number]
    without_images = {
        at: told(each, [share for _, share in _believed(each, doubted.get(at))])
        for at, each in ((at, posterior.hypotheses[at]) for at in likely)
    }
    leading = without_images[number].hypothesis
    rng = np.random.default_rng(0)
    held = {label for label, share in believed[len(weighed.explanation.members) :] if share >= REPORTED}
    noises = tuple(fitted for fitted in leading.state.fitted if fitted.label in held)
    fits = _at_every_sample(leading, data)
    after, before = closed_shares.of_causes(posterior, leading, rng)
    effects = [fit.effect for fit in fits]
    of_noise = closed_shares.of_noise_by_channel(
        noises, [one for one in named if certain[one[0].effect, one[0].where] >= REPORTED], data, rng
    )
    noise_after, noise_before = (each.sum(axis=1) for each in of_noise)
    no_name = [(each, number) for number, own in enumerate(defects) for each in own if each.effect in without]
    unnamed = closed_shares.of_noise((), no_name, data, rng)[1]
    whole = before + noise_before + unnamed
    quiet = masses["nothing"] >= 0.5
    has_cause = bool(fits or noises or named)
    closed = closure.share(after + noise_after + unnamed, whole) if has_cause and not quiet else _NO_CLOSURE
    causes = (
        ()
        if quiet
        else _causes(
            posterior, without_images, number, places, same, named, certain, doubted, before - after, whole, data, rng
        )
    )
    causes = in_recorded_units(causes, recordings[0].units)
    kind = verdict_of(masses, hypotheses, causes)
    settled = data.like(leading.explanation.data) if effects else data
    other = masses["other"] >= 0.5
    gap = float(np.median(whole))
    remainder = left_over.remainder(
        posterior, weighed, leading, [each for each, _ in no_name], float(unnamed[0]), other, gap, rng
    )
    noise_left = np.median(of_noise[0], axis=0) / np.maximum(of_noise[1][0], 1e-12)
    left_of = float(np.median(after)) * closed_shares.where_left(leading)
    channels = by_channel.channels(data, settled, effects, noises, defects, floors, quiet, other, left_of, noise_left)
    counts = [len(recording) for recording in recordings]
    names = [recording.name for recording in recordings]
    estimated = [name for name, source in zip(names, sources, strict=True) if source != "locked recording"]
    which = f": {in_short(estimated)}" if len(names) > 1 and estimated else ""
    return Diagnosis(
        recordings=tuple(names),
        samples=sum(counts),
        seconds=0.0,
        verdict=kind,
        posterior=masses,
        omitted=omitted,
        hypotheses=hypotheses,
        causes=causes,
        channels=pooled(channels, counts),
        follows=() if quiet else left_over.follows(posterior, gap),
        closed=closed,
        closed_on="held-out blocks",
        remainder=remainder,
        calibration_shift=calibration_shift(recordings, settled, effects, floors) if effects and not quiet else {},
        cannot_tell=by_channel.cannot_tell(posterior, data, without, not estimated, [cause.effect for cause in causes]),
        next=None,
        floor=" and ".join(dict.fromkeys(sources)),
        names={} if data.base.arm is None else data.base.arm.place_names,
        warnings=(
            *((f"{ESTIMATED_FLOOR}{which}",) if estimated else ()),
            *_import_findings(recordings),
            *loud_floor_words(recordings, channels, floors, sources),
            *unsure_floor_words(recordings, floors, sources),
        ),
        by_recording=dict(zip(names, channels, strict=True)) if len(names) > 1 else {},
        at_least_one=one_of,
    ), effects


def _import_findings(recordings: Sequence[Recording]) -> list[str]:
    """What looked wrong where the recordings were made, which the diagnosis may then find as a cause."""
    several = len(recordings) > 1
    return [
        f"{recording.name}: " * several + f"rig import found: {line}"
        for recording in recordings
        for line in recording.metadata.findings
    ]


def _listed(
    posterior: Posterior,
    places: Mapping[str, marginal.Place],
    same: Mapping[str, str],
    certain: Mapping[tuple[str, str], float],
    nameless: bool,
    doubted: Mapping[int, Sequence[float]],
) -> tuple[tuple[Hypothesis, ...], dict[str, float], float, tuple[OneOf, ...]]:
    """Hypotheses with twins and states of the floor merged; the three masses; the probability that is not listed; and
    causes of which one at least is there."""
    merged: dict[tuple[tuple[tuple[str, str], ...], bool], float] = {}
    defects = _subsets(list(certain.items()))
    for number, (each, probability) in enumerate(zip(posterior.hypotheses, posterior.probabilities, strict=True)):
        own = [
            (places[same.get(label, label)].name, believed) for label, believed in _believed(each, doubted.get(number))
        ]
        for chosen, part in _subsets(own):
            for held, weight in defects:
                key = tuple(sorted([*chosen, *held])), each.other or nameless
                merged[key] = merged.get(key, 0.0) + float(probability) * part * weight
    masses = {"nothing": 0.0, "known": 0.0, "other": 0.0}
    for (causes, other), mass in merged.items():
        masses["other" if other else "known" if causes else "nothing"] += mass
    total = sum(masses.values())
    masses = {name: mass / total for name, mass in masses.items()}
    ranked = sorted(merged.items(), key=lambda item: -item[1])
    listed = [Hypothesis(causes, other, mass / total) for (causes, other), mass in ranked if mass / total >= _LISTED]
    listed = listed[:_MOST]
    sets: dict[tuple[tuple[str, str], ...], float] = {}
    for (causes, _), mass in merged.items():
        sets[causes] = sets.get(causes, 0.0) + mass / total
    return tuple(listed), masses, max(0.0, 1.0 - sum(one.probability for one in listed)), at_least_one(sets)


def _told_of(
    posterior: Posterior,
    places: Mapping[str, marginal.Place],
    same: Mapping[str, str],
    doubted: Mapping[int, Sequence[float]],
    first: Sequence[Hypothesis],
    single: Sequence[tuple[str, str]],
    nameless: bool,
) -> int:
    """The number of the hypothesis that all figures are of: the likeliest with the causes of the explanation that is
    listed first, without any that are doubted where there is one. Beside something outside the catalogue, doubts can
    put another set there than the likeliest's.

    Args:
        first: the explanation that is listed first. single, nameless: causes of single readings, and whether some have
            no name.
    """
    wanted = [(sorted(each.causes), each.other) for each in first]
    found = []
    for number, each in enumerate(posterior.hypotheses):
        believed = _believed(each, doubted.get(number))
        names = [places[same.get(label, label)].name for label, share in believed if share >= REPORTED]
        if (sorted([*names, *single]), each.other or nameless) in wanted:
            found.append((len(believed) - len(names), number))
    return min(found, default=(0, 0))[1]


def _believed(each: Found, doubted: Sequence[float] | None) -> list[tuple[str, float]]:
    """Labels of a hypothesis, mean effects first, and the probability of each where the hypothesis holds."""
    labels = [*(member.label for member in each.explanation.members), *each.state.labels]
    return list(zip(labels, doubted or (1.0,) * len(labels), strict=True))


def _at_least(probabilities: Sequence[float]) -> list[float]:
    """The probability that at least one, two, ... of independent things are there."""
    of_so_many = np.ones(1)
    for probability in probabilities:
        of_so_many = np.convolve(of_so_many, [1.0 - probability, probability])
    return [float(share) for share in np.cumsum(of_so_many[:0:-1])[::-1]]


def _subsets(causes: Sequence[tuple[tuple[str, str], float]]) -> list[tuple[tuple[tuple[str, str], ...], float]]:
    """Every subset of independent causes that has a share of the probability to speak of."""
    found: list[tuple[tuple[tuple[str, str], ...], float]] = [((), 1.0)]
    for cause, probability in causes:
        found = [
            ((*held, *extra), weight * part)
            for held, weight in found
            for extra, part in (((cause,), probability), ((), 1.0 - probability))
            if weight * part > _NO_SHARE
        ]
    return found


def _at_every_sample(leading: Found, data: WhitenedData) -> list:  # type: ignore[type-arg]
    """The fits of an explanation; of means over blocks, once more with the rig evaluated at every sample."""
    fits = leading.explanation.fits
    if data.block == 1 or not fits:
        return fits
    full = data.stepped(leading.explanation.data.steps).like(leading.explanation.data)
    return converged(fits, full).fits


def _causes(
    posterior: Posterior,
    without_images: Mapping[int, Told],
    leading: int,
    places: Mapping[str, marginal.Place],
    same: Mapping[str, str],
    defects: Sequence[tuple[Defect, int]],
    certain: Mapping[tuple[str, str], float],
    doubted: Mapping[int, Sequence[float]],
    took: Array,
    whole: Array,
    every: WhitenedData,
    rng: np.random.Generator,
) -> tuple[Cause, ...]:
    """Those of the hypothesis that is told of, and others that are likely.

    Args:
        without_images: hypotheses as they are told of, by their numbers. leading: the number of the one all figures
            are of.
        took, whole: (d,) draws of the squares that its mean effects took, and of the squared gap. every: the data.
    """
    holders: dict[tuple[str, int], list[tuple[Found, float, int]]] = {}
    reported = set()
    for number, (each, weight) in enumerate(zip(posterior.hypotheses, posterior.probabilities, strict=True)):
        alone = without_images.get(number)
        believed: dict[str, list[tuple[float, int]]] = {}
        for index, (label, share) in enumerate(_believed(each, doubted.get(number))):
            believed.setdefault(same.get(label, label), []).append((share, index))
        for label, shares in believed.items():
            # an effect can be there twice at one place: the first is the one that is most believed
            shares.sort(key=lambda one: -one[0])
            at_least = _at_least([share for share, _ in shares])
            for copy, ((share, index), so_many) in enumerate(zip(shares, at_least, strict=True)):
                for own, at, by in alone.places(index) if alone else [(each, index, 1.0)]:
                    holders.setdefault((label, copy), []).append((own, float(weight) * so_many * by, at))
                if number == leading and share >= REPORTED:
                    reported.add((label, copy))
    found, first = [], without_images[leading].hypothesis
    for (label, copy), held in holders.items():
        probability = min(sum(weight for _, weight, _ in held), 1.0)
        if (label, copy) not in reported and probability < _TOLD:
            continue
        place = places[label]
        effect, where = place.name
        equivalent = tuple(
            {"effect": e, "where": w, "probability": probability * part} for e, w, part in place.members[1:]
        )
        mean = [one for one in held if label in one[0].explanation.key]
        if mean:
            holder, _, index = mean[0]
            once = (label, 1) not in holders
            estimates = marginal.parameters(index, [one[:2] for one in mean] if once else [mean[0][:2]])
            only = took if holder is first and len(first.explanation.members) == 1 else None
            closed = closed_shares.by_cause(index, holder, posterior, only, whole, rng)
        else:
            holder, index = held[0][0], -1
            fitted = next((o for each, *_ in held for o in each.state.fitted if o.label == label), None)
            if fitted is None:  # a twin of what is listed elsewhere
                continue
            wrong, added = closed_shares.of_noise((fitted,), (), every, rng)
            estimates, closed = _of_noise(fitted), closed_shares.of_whole(added - wrong, whole)
        data = first.explanation.data
        cause = Cause(effect, where, probability, equivalent, estimates, closed)
        if isinstance(data, Stack):
            cause = of_several(cause, label, index, holder, data)
        found.append(cause)
    for defect, number in defects:
        estimates = {name: Estimate(*values) for name, values in defect.parameters.items()}
        wrong, added = closed_shares.of_noise((), ((defect, number),), every, rng)
        part = closed_shares.of_whole(added - wrong, whole)
        cause = Cause(defect.effect, defect.where, certain[defect.effect, defect.where], (), estimates, part)
        data = first.explanation.data
        found.append(replace(cause, recording=data.names[number]) if isinstance(data, Stack) else cause)
    return tuple(sorted(found, key=lambda cause: -cause.probability))


def _of_noise(fitted: FittedNoise) -> dict[str, Estimate]:
    found = {}
    for item in fitted.effect.parameters():
        std: float | tuple[float, ...] | None = fitted.widths.get(item.name)
        if item.strength:
            std = float(fitted.std[0]) if item.size == 1 else tuple(map(float, fitted.std))
        found[item.name] = Estimate(getattr(fitted.effect, item.name), std, item.unit)
    return found
