"""What each of several recordings says for a cause, and in which of them it acts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.gap.data.stack import Stack, part_of
from estimators.gap.diagnosis import Cause
from estimators.gap.search.hypothesis import Hypothesis


def of_several(cause: Cause, label: str, index: int, holder: Hypothesis, data: Stack) -> Cause:
    """With the recording in which it acts or begins, on its own clock, and what each recording says for it.

    Args:
        label: its effect and place. holder: a hypothesis that holds it. index: its number there, of a mean effect.
    """
    fitted = next((each for each in holder.state.fitted if each.label == label), None)
    if fitted is not None:
        said = {data.names[each.part]: 0.5 * each.gain for each in fitted.every if each.part >= 0}
        return replace(cause, evidence=said)
    explanation = holder.explanation
    fit = explanation.fits[index]
    whole = explanation.data
    own = explanation.changes[index]
    gains = own * explanation.linear.left + 0.5 * own**2
    evidence = {name: float(gains[whole.rows(number)].sum()) for number, name in enumerate(data.names)}
    number = part_of(fit.candidate.effect)
    parameters = dict(cause.parameters)
    if isinstance(at_s := getattr(fit.effect, "at_s", None), float):
        number = max(index for index, part in enumerate(data.parts) if index == 0 or part.t[0] <= at_s)
        parameters["at_s"] = replace(parameters["at_s"], value=at_s - data.began[number])
    if number is not None and isinstance(frequency := getattr(fit.effect, "freq_Hz", None), float):
        phase = np.asarray(vars(fit.effect)["phase_rad"], dtype=float)
        turned = np.mod(phase + 2.0 * np.pi * frequency * data.began[number], 2.0 * np.pi)
        value = float(turned) if turned.ndim == 0 else tuple(float(each) for each in turned)
        parameters["phase_rad"] = replace(parameters["phase_rad"], value=value)
    name = None if number is None else data.names[number]
    return replace(cause, parameters=parameters, recording=name, evidence=evidence)
