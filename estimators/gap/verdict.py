"""From the selection to the verdict: what is named, what the data cannot split, what is left, what it cannot tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from estimators.gap.bench import Bench, project
from estimators.gap.channel_noise import ChannelNoise
from estimators.gap.closure import Closure, close
from estimators.gap.credible import credible, plausible
from estimators.gap.defects import Defect
from estimators.gap.diagnosis import Cause, Channel, Diagnosis, Estimate, Verdict
from estimators.gap.fullrate import at_every_sample
from estimators.gap.rebase import around
from estimators.gap.remainder import Finding, findings, significant
from estimators.gap.rivals import Rival, noise_rivals, settled
from estimators.gap.score import ABSORBED, Explained
from estimators.gap.select import MeanCause, Selection, roughly
from estimators.gap.shift import calibration_shift
from estimators.gap.stochastic import NoiseOffer
from estimators.gap.where import shares
from rig.channels import CHANNELS
from rig.effects import EFFECTS
from rig.errors import unknown_name
from rig.recording import Recording

Array = NDArray[np.float64]

#: A remainder of less than this share of what the causes explain leaves their name standing.
SMALL = 0.005


def check_names(without: Sequence[str]) -> None:
    """Refuse names that are no effects.

    Raises:
        RigError: an unknown effect.
    """
    for name in without:
        if name not in EFFECTS:
            raise unknown_name("effect", name, EFFECTS)


def conclude(
    recording: Recording,
    bench: Bench,
    state: Selection,
    defects: Sequence[Defect],
    without: Sequence[str],
    floor: tuple[ChannelNoise, ...],
    source: str,
) -> Diagnosis:
    """The diagnosis that a selection supports.

    Args:
        recording, bench: what was diagnosed; the bench with the base fit's noise, defects left out.
        state: the selected causes.
        defects: of single readings.
        without: effects left out of the catalogue: their defects have no name.
        floor: noise of each channel. source: where it comes from.
    """
    state, groups = settled(state, plausible(state))
    noise_groups = [noise_rivals(state, offer, without) for offer in state.noises]
    pointwise, rough = state.bench, state.scanner.rough.bench
    means = roughly(state, [cause.fit for cause in state.causes], state.explained)
    state = at_every_sample(state, bench)
    smooth = (rough, means) if bench.block == 1 else (pointwise, state.explained)
    left = significant(findings(pointwise, state.explained, state.noises, smooth))
    named = [defect for defect in defects if defect.effect not in without]
    nameless = [defect for defect in defects if defect.effect in without]
    explained = float(bench.whitened @ bench.whitened - state.explained.residual @ state.explained.residual)
    explained += sum(offer.gain for offer in state.noises)
    remainder = _excess(left)
    structured = bool(left) or bool(nameless)
    several = state.count > 1 or bool(state.noises)
    unknown = bool(nameless) or (bool(left) and (several or remainder > SMALL * max(explained, 0.0)))
    unknown = unknown or not credible(state, groups, bench.pointwise())
    settled_bench = bench if state.bench.pipeline is bench.pipeline else around(bench, state.bench.pipeline)
    closure = close(
        settled_bench,
        bench.residual,
        [cause.fit for cause in state.causes],
        remainder if left else 0.0,
        np.random.default_rng(0),
    )
    causes = [_mean_cause(cause, group, state, closure) for cause, group in zip(state.causes, groups, strict=True)]
    causes += [_noise_cause(offer, group) for offer, group in zip(state.noises, noise_groups, strict=True)]
    causes += [_defect_cause(defect) for defect in named]
    if unknown:
        kind: Verdict = "unknown"
    elif not causes:
        kind = "no-gap"
    else:
        kind = "ambiguous" if any(cause.equivalent for cause in causes) else "named"
    base = Explained(bench.absorbed, bench.whitened)
    gap = max(explained + remainder, 1e-9)
    has_mean = bool(state.causes)
    return Diagnosis(
        recording=recording.name,
        samples=len(recording),
        seconds=0.0,
        verdict=kind,
        causes=tuple(causes),
        channels=_channels(bench, closure, state, defects, floor),
        follows=tuple(
            {"variable": s.variable, "share": s.share} for s in shares(bench.pointwise(), base, gap) if s.share > 0.01
        )
        if causes or structured
        else (),
        closed=closure.closed if has_mean else (1.0 if causes else None),
        closed_low=closure.low if has_mean else (1.0 if causes else None),
        closed_high=closure.high if has_mean else (1.0 if causes else None),
        closed_on="held-out blocks",
        remainder="structured" if structured else "noise",
        remainder_follows=_remainder_follows(left, nameless, remainder),
        calibration_shift=calibration_shift(recording, settled_bench, state, floor) if has_mean else {},
        cannot_tell=cannot_tell(state, without),
        next=None,
        floor=source,
        warnings=() if source == "locked recording" else ("the noise floor is estimated from the recording itself",),
    )


def judged_elsewhere(result: Diagnosis, state: Selection, bench: Bench) -> Diagnosis:
    """The diagnosis with its closure judged on another maneuver as well, the causes kept."""
    if not state.causes:
        return result
    change = project(bench.absorbed, bench.whiten(bench.change([cause.fit.effect for cause in state.causes])))
    gain = float(2.0 * bench.whitened @ change - change @ change)
    floor = bench.size - bench.absorbed.shape[1]
    gap = max(float(bench.whitened @ bench.whitened) - floor, gain)
    value = float(np.clip(gain / max(gap, 1e-9), -1.0, 1.0))
    return replace(result, closed_on="both", closed_elsewhere=value)


def _excess(left: Sequence[Finding]) -> float:
    """Squared signal-to-noise of what is left: the largest of the overlapping tests."""
    return max((finding.excess for finding in left), default=0.0)


def _remainder_follows(
    left: Sequence[Finding], nameless: Sequence[Defect], size: float
) -> tuple[dict[str, object], ...]:
    follows: list[dict[str, object]] = [
        {"variable": f"single readings ({each.effect}-like)", "share": 1.0} for each in nameless
    ]
    seen: set[str] = set()
    for finding in left:
        if finding.follows not in seen:
            seen.add(finding.follows)
            follows.append(
                {"variable": finding.follows, "channel": finding.channel, "share": finding.excess / max(size, 1e-9)}
            )
    return tuple(follows)


def _mean_cause(cause: MeanCause, group: Sequence[Rival], state: Selection, closure: Closure) -> Cause:
    effect = cause.fit.effect
    tangent = cause.fit.tangent(state.bench)
    rest = [other.fit.tangent(state.bench) for other in state.causes if other is not cause]
    other = Explained(state.bench.absorbed, state.bench.whitened)
    for columns in rest:
        other = other.extended(columns)
    left = other.without(tangent)
    covariance = np.linalg.pinv(left.T @ left, rcond=1e-9, hermitian=True)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * cause.fit.scale
    parameters: dict[str, Estimate] = {name: Estimate(getattr(effect, name), None, "name") for name in effect.choices()}
    first = 0
    for item in cause.fit.free:
        part = std[first : first + item.size]
        first += item.size
        value = getattr(effect, item.name)
        parameters[item.name] = Estimate(
            value, float(part[0]) if item.size == 1 else tuple(map(float, part)), item.unit
        )
    units = {item.name: item.unit for item in effect.parameters()}
    for name in cause.fit.kept:
        parameters[name] = Estimate(getattr(effect, name), None, units[name])
    total = max(sum(each.statistic for each in state.causes), 1e-12)
    return Cause(
        effect=effect.name,
        where=effect.where,
        probability=float(softmax([0.5 * rival.evidence for rival in group])[0]),
        equivalent=tuple({"effect": rival.effect, "where": rival.where} for rival in group[1:]),
        parameters=parameters,
        p_value=float(math.exp(max(cause.offer.log_p, -700.0))),
        closed=closure.closed * cause.statistic / total,
    )


def _noise_cause(offer: NoiseOffer, group: Sequence[Rival]) -> Cause:
    effect = offer.effect
    parameters: dict[str, Estimate] = {}
    for item in effect.parameters():
        std = (float(offer.std[0]) if item.size == 1 else tuple(map(float, offer.std))) if item.strength else None
        parameters[item.name] = Estimate(getattr(effect, item.name), std, item.unit)
    return Cause(
        effect=effect.name,
        where=effect.where,
        probability=float(softmax([0.5 * rival.evidence for rival in group])[0]),
        equivalent=tuple({"effect": rival.effect, "where": rival.where} for rival in group[1:]),
        parameters=parameters,
        p_value=float(math.exp(max(offer.log_p, -700.0))),
        closed=1.0,
    )


def _defect_cause(defect: Defect) -> Cause:
    parameters = {name: Estimate(*values) for name, values in defect.parameters.items()}
    p_value = float(math.exp(max(defect.log_p, -700.0)))
    return Cause(defect.effect, defect.where, 1.0, (), parameters, p_value, 1.0)


def _channels(
    bench: Bench, closure: Closure, state: Selection, defects: Sequence[Defect], floor: tuple[ChannelNoise, ...]
) -> dict[str, Channel]:
    found = {}
    for column in bench.columns:
        sigma = math.sqrt(floor[column].variance)
        gaps = [defect.gap for defect in defects] + [offer.gap for offer in state.noises]
        others = float(sum(gap[column] ** 2 for gap in gaps))
        before = math.sqrt(closure.before[column] ** 2 + others)
        has_gap = before > 1e-3 * sigma
        found[CHANNELS[column]] = Channel(
            noise_floor=sigma,
            rms_before=float(np.sqrt(np.mean(bench.residual[:, column] ** 2))),
            gap_before=before,
            rms_after=float(closure.rms_after[column]),
            gap_after=float(closure.after[column]),
            closed=float(1.0 - (closure.after[column] / before) ** 2) if has_gap else None,
        )
    return found


def cannot_tell(state: Selection, without: Sequence[str]) -> tuple[dict[str, str], ...]:
    """The effects that the recording cannot show: those the calibration absorbs, and those it has no data for."""
    rough = state.scanner.rough.bench
    base = Explained(rough.absorbed, rough.whitened)
    told: dict[tuple[str, str], bool] = {}  # of several sources, say, one that shows is enough
    for candidate in state.candidates:
        if not candidate.effect.tone and candidate.effect.searched(state.bench.base) == [{}]:
            place = candidate.effect.name, candidate.where
            told[place] = told.get(place, False) or state.scanner.visible(candidate, base) > ABSORBED
    why = "the calibration absorbs it on this maneuver"
    found = [{"effect": name, "where": where, "why": why} for (name, where), seen in told.items() if not seen]
    for effect in EFFECTS.values():
        lacking = effect.lacking(state.bench.base)
        if lacking and effect.name not in without:
            found += [
                {"effect": effect.name, "where": where, "why": f"the recording lacks {lacking}"}
                for where in effect.places
            ]
    return tuple(found)
