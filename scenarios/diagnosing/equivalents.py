"""How large what does the same as a cause would be: fitted to the recording in the cause's place."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from estimators.gap.diagnosis import Cause, Closed, Diagnosis, Estimate
from estimators.gap.parameter_words import sizes_words
from estimators.gap.report.recorded_units import in_recorded_units
from estimators.gap.report.separation import Explanation, contest
from rig.arrays import Array
from rig.effects import EFFECTS, Kind
from rig.recording import Recording
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.plan.undecided import fewer_rows

Name = tuple[str, str]


def equivalents_of(diagnosis: Diagnosis, residuals: GapResiduals) -> list[dict[str, Any]]:
    """For a diagnosis' ``next``: each effect and place that does the same as a cause, with its own parameters.

    Another place may take another size, or the other sign, to do the same. What was not among the explanations that
    were held against each other is left out.

    Args:
        residuals: of the recording.
    """
    if not any(cause.equivalent for cause in diagnosis.leading):
        return []
    group = contest(fewer_rows(residuals), diagnosis)
    means = [(cause.effect, cause.where) for cause in diagnosis.leading if EFFECTS[cause.effect].kind is Kind.MEAN]
    found = []
    for cause in diagnosis.leading:
        own = (cause.effect, cause.where)
        for each in cause.equivalent:
            name = (str(each["effect"]), str(each["where"]))
            wanted = sorted(name if other == own else other for other in means)
            held = next((one for one in group if _names(one) == wanted), None)
            if held is None or own not in means:
                continue
            made = _as_cause(held, name, float(each["probability"]), residuals.recording)
            parameters = {key: asdict(estimate) for key, estimate in made.parameters.items()}
            told = {key: {part: value[part] for part in ("value", "std", "unit")} for key, value in parameters.items()}
            found.append(
                {
                    "effect": name[0],
                    "where": name[1],
                    "instead_of": list(own),
                    "parameters": told,
                    "size": sizes_words(made),
                }
            )
    return found


def _names(explanation: Explanation) -> list[Name]:
    return sorted((effect.name, effect.where) for effect in explanation.effects)


def _as_cause(explanation: Explanation, name: Name, probability: float, recording: Recording) -> Cause:
    """One of an explanation's effects with what was fitted of it, in the recorded units."""
    std = np.sqrt(np.maximum(np.diag(explanation.covariance), 0.0))
    first = 0
    estimates: dict[str, Estimate] = {}
    for fit in explanation.fits:
        count = len(fit.values)
        if (fit.effect.name, fit.effect.where) == name:
            widths = std[first : first + count] * fit.scale
            place = 0
            for item in fit.free:
                part = slice(place, place + item.size)
                place += item.size
                estimates[item.name] = Estimate(_number(fit.values[part]), _number(widths[part]), item.unit)
        first += count
    made = Cause(*name, probability, (), estimates, Closed(None, None, None))
    return in_recorded_units([made], recording.units)[0]


def _number(values: Array) -> float | tuple[float, ...]:
    return float(values[0]) if len(values) == 1 else tuple(map(float, values))
