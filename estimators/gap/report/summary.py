"""From the posterior to the diagnosis: verdict, causes, channels, closure, what is left, what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.defects import Defect
from estimators.gap.data.stack import Stack
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Cause, Closed, Diagnosis, Estimate, Hypothesis, OneOf, Remainder, verdict_of
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.discrepancy import Weighed, weighed
from estimators.gap.evidence.laplace import linearised
from estimators.gap.evidence.refine import at
from estimators.gap.evidence.terms import every_along
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.pooled import pooled
from estimators.gap.report import by_channel, closed_shares, closure, marginal
from estimators.gap.report.by_recording import of_several
from estimators.gap.report.one_of import at_least_one
from estimators.gap.report.p_values import defect_probability, doubts
from estimators.gap.report.recorded_units import in_recorded_units
from estimators.gap.report.shift import calibration_shift
from estimators.gap.search.hypothesis import Hypothesis as Found
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import Effect
from rig.errors import in_short
from rig.recording import Recording

#: Explanations that are listed: how likely, and how many.
_LISTED, _MOST = 0.005, 50
#: Causes that are likely enough to be told of, beside those of the likeliest explanation.
_TOLD: Final = 0.1
#: Of the likeliest explanation, where it holds something outside the catalogue, the causes that are told of and fitted.
_REPORTED: Final = 0.5
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
    defects = [
        # nobody knows the converter's own step: a lattice is no cause
        [defect for defect in own if source == "locked recording" or defect.effect != "adc_quantisation"]
        for own, source in zip(defects, sources, strict=True)
    ]
    named = [(defect, number) for number, own in enumerate(defects) for defect in own if defect.effect not in without]
    nameless = [defect for own in defects for defect in own if defect.effect in without]
    certain: dict[tuple[str, str], float] = {}
    for each, number in named:
        key, beside = (each.effect, each.where), data.parts[number] if posterior.leading.other else None
        certain[key] = max(certain.get(key, 0.0), defect_probability(each, posterior.prior, beside))
    named = [(each, number) for each, number in named if certain[each.effect, each.where] >= _TOLD]
    certain = {key: probability for key, probability in certain.items() if probability >= _TOLD}
    same = marginal.twins(posterior)
    places = marginal.places(posterior, same)
    doubted = doubts(posterior)
    hypotheses, masses, omitted, one_of = _listed(posterior, places, same, certain, bool(nameless), doubted)
    leading = posterior.leading
    rng = np.random.default_rng(0)
    believed = _believed(leading, doubted.get(0))
    reported = [index for index in range(len(leading.explanation.members)) if believed[index][1] >= _REPORTED]
    held = {label for label, share in believed[len(leading.explanation.members) :] if share >= _REPORTED}
    noises = tuple(fitted for fitted in leading.state.fitted if fitted.label in held)
    fits = [fit for index, fit in enumerate(_at_every_sample(leading, data)) if index in reported]
    after, before = closed_shares.of_causes(posterior, reported, rng)
    effects = [fit.effect for fit in fits]
    noise_after, noise_before = closed_shares.of_noise(
        noises, [one for one in named if certain[one[0].effect, one[0].where] >= _REPORTED], data, rng
    )
    quiet = masses["nothing"] >= 0.5
    has_cause = bool(fits or noises or named)
    closed = closure.share(after + noise_after, before + noise_before) if has_cause and not quiet else _NO_CLOSURE
    causes = (
        ()
        if quiet
        else _causes(posterior, leading, places, same, named, certain, doubted, reported, after, before, rng)
    )
    causes = in_recorded_units(causes, recordings[0].units)
    kind = verdict_of(masses, hypotheses, causes)
    settled = data.around(leading.explanation.data.pipeline) if effects else data
    other = masses["other"] >= 0.5
    remainder = _remainder(posterior, nameless, other, rng)
    channels = by_channel.channels(data, settled, effects, noises, defects, floors, quiet, other, after)
    counts = [len(recording) for recording in recordings]
    names = [recording.name for recording in recordings]
    estimated = [name for name, source in zip(names, sources, strict=True) if source != "locked recording"]
    if len(names) > 1 and estimated:
        warned = f"the noise floor is estimated from the recording itself: {in_short(estimated)}"
    else:
        warned = "the noise floor is estimated from the recording itself"
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
        follows=() if quiet else _follows(posterior),
        closed=closed,
        closed_on="held-out blocks",
        remainder=remainder,
        calibration_shift=calibration_shift(recordings, settled, effects, floors) if effects and not quiet else {},
        cannot_tell=by_channel.cannot_tell(posterior, data, without, not estimated, [cause.effect for cause in causes]),
        next=None,
        floor=" and ".join(dict.fromkeys(sources)),
        names={} if data.base.arm is None else data.base.arm.place_names,
        warnings=(warned,) if estimated else (),
        by_recording=dict(zip(names, channels, strict=True)) if len(names) > 1 else {},
        at_least_one=one_of,
    ), effects


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


def _believed(each: Found, doubted: Sequence[float] | None) -> list[tuple[str, float]]:
    """Labels of a hypothesis, mean effects first, and the probability of each where the hypothesis holds."""
    labels = [*(member.label for member in each.explanation.members), *each.state.labels]
    return list(zip(labels, doubted or (1.0,) * len(labels), strict=True))


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
    full = data.stepped(leading.explanation.data.steps).around(leading.explanation.data.pipeline)
    return converged(fits, full).fits


def _causes(
    posterior: Posterior,
    leading: Found,
    places: Mapping[str, marginal.Place],
    same: Mapping[str, str],
    defects: Sequence[tuple[Defect, int]],
    certain: Mapping[tuple[str, str], float],
    doubted: Mapping[int, Sequence[float]],
    means: Sequence[int],
    after: Array,
    before: Array,
    rng: np.random.Generator,
) -> tuple[Cause, ...]:
    """Those of the leading explanation (``means``: the numbers of its reported members), and others that are likely."""
    holders: dict[tuple[str, int], list[tuple[Found, float, int]]] = {}
    reported = set()
    for number, (each, weight) in enumerate(zip(posterior.hypotheses, posterior.probabilities, strict=True)):
        believed: dict[str, list[tuple[float, int]]] = {}
        for index, (label, share) in enumerate(_believed(each, doubted.get(number))):
            believed.setdefault(same.get(label, label), []).append((share, index))
        for label, shares in believed.items():
            # an effect can be there twice at one place: the first is the one that is most believed
            for copy, (share, index) in enumerate(sorted(shares, key=lambda one: -one[0])):
                holders.setdefault((label, copy), []).append((each, float(weight) * share, index))
                if each is leading and share >= _REPORTED:
                    reported.add((label, copy))
    found = []
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
            alone = (label, 1) not in holders
            estimates = marginal.parameters(index, [one[:2] for one in mean] if alone else [mean[0][:2]])
            closed = closed_shares.by_cause(index, holder, posterior, means, after, before, rng)
        else:
            holder, index = held[0][0], -1
            fitted = next((o for each, *_ in held for o in each.state.fitted if o.label == label), None)
            if fitted is None:  # a twin of what is listed elsewhere
                continue
            estimates, closed = _of_noise(fitted), closed_shares.by_noise(fitted, rng)
        data = leading.explanation.data
        cause = Cause(effect, where, probability, equivalent, estimates, closed)
        if isinstance(data, Stack):
            cause = of_several(cause, label, index, holder, data)
        found.append(cause)
    for defect, number in defects:
        estimates = {name: Estimate(*values) for name, values in defect.parameters.items()}
        wrong = closure.of_noise(1.0, float(1.0 / np.sqrt(max(defect.affected.sum(), 1))), rng)
        part = closure.share(np.minimum(wrong, 1.0) ** 2, np.ones(len(wrong)))
        cause = Cause(defect.effect, defect.where, certain[defect.effect, defect.where], (), estimates, part)
        data = leading.explanation.data
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


def _follows(posterior: Posterior) -> tuple[dict[str, object], ...]:
    """What the whole gap follows: for each course the share of it that the likeliest source takes along that."""
    linear = linearised(at([], posterior.scanner.fine.data))
    rough = posterior.scanner.rough.data
    found: dict[str, float] = {}
    size = max(float(rough.whitened @ rough.whitened) - rough.size + rough.absorbed.rank, 1.0)
    every = weighed(linear, posterior.discrepancies)
    for each, taken in zip(every, _taken(every, linear.left), strict=True):
        size = max(size, taken)  # means over neighbours hide what is fast
        if not each.term.course.startswith("time,"):  # pieces of time: the same course, more roughly
            found[each.term.course] = max(found.get(each.term.course, 0.0), taken)
    ranked = [(name, float(np.clip(taken / size, 0.0, 1.0))) for name, taken in found.items()]
    ranked.sort(key=lambda item: -item[1])
    return tuple({"variable": name, "share": share} for name, share in ranked if share > 0.01)


def _taken(every: Sequence[Weighed], residual: Array) -> list[float]:
    """The squared gap that each term takes of a residual, shrunk by its likeliest amplitude, less what noise makes."""
    found = []
    for each, along in zip(every, every_along([each.term for each in every], residual[:, None]), strict=True):
        values, variance = each.term.values, float(each.term.variances[int(np.argmax(each.gains))])
        shrink = variance / (1.0 + variance * values)
        found.append(float(np.sum(shrink**2 * values * np.maximum(along[:, 0] ** 2 - values, 0.0))))
    return found


def _remainder(posterior: Posterior, nameless: Sequence[Defect], other: bool, rng: np.random.Generator) -> Remainder:
    rough = posterior.scanner.rough.data
    hidden = closure.could_hide(posterior.discrepancies, rng)
    follows: list[dict[str, object]] = [
        {"source": "single readings", "course": f"{each.effect}-like", "share": 1.0} for each in nameless
    ]
    if other:
        with_terms = next((each for each in posterior.hypotheses if each.terms), None)
        gap = max(float(rough.whitened @ rough.whitened) - rough.size, 1.0)
        if with_terms is not None:
            near = [each for each in with_terms.terms if each.log_mass > with_terms.terms[0].log_mass - 3.0]
            first = {each.term.source: each for each in reversed(near)}  # of each source the likeliest
            told = sorted(first.values(), key=lambda each: -each.log_mass)[:3]
            taken = _taken(told, with_terms.explanation.linear.left)
            gap = max(gap, *taken)  # means over neighbours hide what is fast
            for each, square in zip(told, taken, strict=True):
                share = float(np.clip(square / gap, 0.0, 1.0))
                follows.append({"source": each.term.source, "course": each.term.course, "share": share})
        if posterior.hypotheses[0].state.other:
            for step in posterior.hypotheses[0].state.steps:
                if step.in_time:
                    continue
                added = float(np.sum(1.0 / np.maximum(step.factor, 1e-9) ** 2 - 1.0))
                follows.append(
                    {
                        "source": f"noise of {CHANNELS[step.column]} by itself{_in(rough, step.part)}",
                        "course": _band(step.factor, rough.parts[step.part]),
                        "share": float(np.clip(added / max(added, gap), 0.0, 1.0)),
                    }
                )
    return Remainder("structured" if other or nameless else "noise", tuple(follows), float(hidden))


def _in(data: WhitenedData, number: int) -> str:
    """Which of several recordings, in words."""
    return f" in {data.names[number]}" if isinstance(data, Stack) and len(data.parts) > 1 else ""


def _band(factor: Array, data: WhitenedData) -> str:
    """The frequencies at which noise is raised most."""
    power = 1.0 / np.maximum(factor[1:], 1e-9) ** 2
    raised = power - power.min()
    cumulated = np.cumsum(raised) / max(float(raised.sum()), 1e-300)
    low, high = np.searchsorted(cumulated, [0.1, 0.9])
    unit = 0.5 * data.samples / (data.interval_s * len(raised))
    return f"{max(low, 1) * unit:.2g} to {max(high, 1) * unit:.2g} Hz"
