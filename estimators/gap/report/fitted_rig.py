"""A fitted rig on a recording: the effects that it adds to the model, and whether it is better than the ideal rig.

A rig is called better only by a recording that chose nothing of it: that recording must be likelier under the fitted
rig than under the ideal one, calibrations refitted for both, and what the fitted rig leaves of it must be the floor,
but for the errors of its own parameters as far as these were to be expected.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from estimators.gap.data.defects import Defect, masked
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.evidence.states import log_det
from estimators.gap.hypotheses.stochastic import known_steps
from estimators.gap.readable_units import two_digits
from estimators.gap.report.p_values import log_bayes_factor
from estimators.p_words import p_words
from rig.channels import CHANNELS
from rig.effects import Effect, Kind
from rig.effects.parameters import Value
from rig.recording import Recording

#: A rig that leaves nothing but the floor is refused by the test of what it leaves so often.
REFUSED: Final = 0.05
#: Log likelihood ratio that a better rig must reach. Both rigs are fixed before the recording is seen, so that by
#: Markov's inequality the ideal rig comes out worse by chance once in twenty recordings at most.
BETTER: Final = math.log(20.0)


@dataclass(frozen=True)
class FittedRig:
    """What a fitted rig adds to the model.

    Attributes:
        name: of its file.
        effects: on a clock that starts with the recording.
        fitted_to: fingerprints of the recordings that chose them.
        std: of the first effects, standard deviations of their parameters by name; what is not there is exact.
    """

    name: str
    effects: tuple[Effect, ...]
    fitted_to: tuple[str, ...] = ()
    std: tuple[Mapping[str, Value], ...] = ()

    def on(self, recording: Recording) -> FittedRig:
        """On the recording's own clock."""
        begin_s = float(recording.t[0])
        return replace(self, effects=tuple(delayed(effect, begin_s) for effect in self.effects))

    def of_kind(self, kind: Kind) -> tuple[Effect, ...]:
        """Its effects of a kind."""
        return tuple(effect for effect in self.effects if effect.kind is kind)

    def std_of(self, kind: Kind) -> tuple[Mapping[str, Value], ...]:
        """Of its effects of a kind, in their order."""
        exact: Mapping[str, Value] = {}
        every = (*self.std, *[exact] * (len(self.effects) - len(self.std)))
        return tuple(std for effect, std in zip(self.effects, every, strict=True) if effect.kind is kind)

    def whitened(self, data: WhitenedData) -> WhitenedData:
        """The data with the rig's noise in the floor."""
        for effect in self.of_kind(Kind.NOISE):
            data = data.stepped(known_steps(effect, data))
        return data

    def has(self, defect: Defect) -> bool:
        """Whether a defect of single readings is part of the rig."""
        return any((effect.name, effect.where) == (defect.effect, defect.where) for effect in self.effects)


def known_to(effect: Effect, diagnosis: Diagnosis) -> Mapping[str, Value]:
    """Standard deviations of a diagnosed cause's parameters, by name; zero of what the recording did not feel."""
    names = effect.choices()  # two crosstalks into a channel differ by their source
    cause = next(
        (
            one
            for one in diagnosis.leading
            if (one.effect, one.where) == (effect.name, effect.where)
            and all(name in one.parameters and one.parameters[name].value == getattr(effect, name) for name in names)
        ),
        None,
    )
    found: dict[str, Value] = {}
    for item in effect.parameters():
        estimate = None if cause is None else cause.parameters.get(item.name)
        if estimate is not None and estimate.std is not None:
            std = np.nan_to_num(np.atleast_1d(np.asarray(estimate.std, dtype=float)))
            if np.any(std > 0.0):
                found[item.name] = float(std[0]) if item.size == 1 else tuple(map(float, std))
    return found


def delayed(effect: Effect, by_s: float) -> Effect:
    """An effect on a clock that shows ``by_s`` [s] more: what happens at an instant happens then as it did."""
    if by_s == 0.0:
        return effect
    values = asdict(effect)
    if "at_s" in values:
        values["at_s"] += by_s
    if effect.tone:
        turn = 2.0 * np.pi * values["freq_Hz"] * by_s
        values["phase_rad"] = np.remainder(np.asarray(values["phase_rad"]) - turn, 2.0 * np.pi).tolist()
    return effect.from_mapping(values)


def judged(
    rig: FittedRig,
    recording: Recording,
    diagnosis: Diagnosis,
    ideal: WhitenedData,
    fitted: WhitenedData,
    defects: Sequence[Defect],
    p_value: float | None = None,
) -> Mapping[str, Any]:
    """The gap before, against the ideal rig, and after, against the fitted one; what is left; whether it is better.

    Args:
        diagnosis: of what the fitted rig leaves.
        ideal, fitted: whitened of single samples; the fitted one with the rig's effects.
        defects: of single readings, left out of both.
        p_value: of what the fitted rig leaves, against the floor and against how well its parameters are known
            (``remainder_test``); None where the floor is not known well enough to tell.
    """
    before, after = (masked(data, defects) for data in (ideal, fitted))
    steps = after.steps[len(before.steps) :]
    ratio = 0.5 * float(before.whitened @ before.whitened - after.whitened @ after.whitened) + log_det(before, steps)
    ratio += sum(log_bayes_factor(defect.log_p) for defect in defects if rig.has(defect))  # found again
    chose = recording.fingerprint in rig.fitted_to
    own = Counter((effect.name, effect.where) for effect in rig.effects)
    found = Counter((cause.effect, cause.where) for cause in diagnosis.leading)
    # other values of its own parameters are for the test to judge, which knows how well they were known
    moved = p_value is not None and bool(rig.std) and bool(found) and found <= own
    at_floor = diagnosis.verdict == "no-gap" or (moved and not diagnosis.hypotheses[0].other)
    refused = p_value is not None and p_value <= REFUSED
    channels: dict[str, dict[str, float]] = {}
    total = [0.0, 0.0]
    for column in before.columns:
        kept = before.weights[:, column] > 0
        squares = [float(np.mean(data.residual[kept, column] ** 2)) for data in (before, after)]
        row = diagnosis.channels[CHANNELS[column]]
        left = row.gap_before**2
        there = max(squares[0] - squares[1] + left, 0.0)
        total[0] += there / row.noise_floor**2
        total[1] += left / row.noise_floor**2
        channels[CHANNELS[column]] = {
            "noise_floor": row.noise_floor,
            "rms_ideal": math.sqrt(squares[0]),
            "gap_ideal": math.sqrt(there),
            "rms_fitted": math.sqrt(squares[1]),
            "gap_fitted": math.sqrt(left),
        }
    return {
        "name": rig.name,
        "effects": [[effect.name, effect.where] for effect in rig.effects],
        "better": ratio > BETTER and at_floor and not refused and not chose,
        "why": _why(ratio, at_floor, p_value if refused else None, chose, diagnosis),
        "log_likelihood_ratio": ratio,
        "remainder_p_value": p_value,
        "chosen_by_this_recording": chose,
        "left": total[1] / total[0] if total[0] > 0.0 else None,
        "channels": channels,
    }


def _why(ratio: float, at_floor: bool, refused: float | None, chose: bool, diagnosis: Diagnosis) -> str:
    if ratio <= BETTER:
        return "the recording is not clearly likelier under the fitted rig than under the ideal one"
    if not at_floor:
        chance = diagnosis.posterior["nothing"]
        return (
            f"the fitted rig leaves more than the noise floor (probability that it leaves nothing else: {chance:.2g})"
        )
    if refused is not None:
        return (
            f"what the fitted rig leaves looks like more than the noise floor ({p_words(refused)}; a rig that leaves"
            f" nothing is refused so in {100.0 * REFUSED:.0f} % of recordings)"
        )
    if chose:
        return "this recording chose the fitted rig: only another recording of the same arm can tell"
    hidden = diagnosis.remainder.could_hide_snr
    limit = (
        "" if hidden is None else f"; a gap with a signal-to-noise ratio of up to {two_digits(hidden)} could still hide"
    )
    return f"this recording, which chose nothing of it, is likelier under it, and what it leaves is the floor{limit}"
