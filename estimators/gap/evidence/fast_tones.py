"""Tones that means over blocks of a long recording would hide, found in its single samples.

The calibration and the other mean effects follow the arm. Where that turns far in a block, harmonics of its motion are
as fast as a tone: there tones are looked for beside the effects that were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from estimators.gap.data.defects import Defect
from estimators.gap.data.projection import Basis
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.refine import Fitted, started
from estimators.gap.hypotheses.candidates import Candidate, all_candidates
from estimators.gap.hypotheses.scan import ScoreTest
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.tones import best_tone, envelopes
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import Effect
from rig.pipeline import Pipeline

#: Logarithm of the largest p-value and the least evidence (twice a log Bayes factor) of a tone.
SIGNIFICANT: Final = float(np.log(5e-4))
STRONG: Final = 10.0
#: So many tones at most.
_MOST: Final = 2
#: A tone is fast from this share of the rate of the means on.
_FAST: Final = 0.4


def fast_tones(
    data: WhitenedData,
    block: int,
    without: Sequence[str],
    beside: Sequence[Effect] = (),
    pipeline: Pipeline | None = None,
) -> tuple[list[Defect], WhitenedData]:
    """The tones of a recording that is to become means over blocks, and the data with them taken out of the readings.

    Args:
        data: of single samples.
        block: samples a mean. Nothing is hidden where it is one.
        without: effects to leave out of the catalogue.
        beside: mean effects that are there. pipeline: the calibration beside them; None: that of the data.
    """
    found: list[Defect] = []
    if block == 1:
        return found, data
    look = data if pipeline is None else data.around(pipeline)
    look = replace(look, readings=look.readings - look.change(beside))
    tones = [each for each in all_candidates(look, without) if each.effect.tone]
    raw = {each.label: envelopes(each, look) for each in tones}
    lowest_Hz = _FAST / (block * data.interval_s)
    while len(found) < _MOST and tones:
        explained = Explained(Basis((), look.size), look.whiten(look.residual))
        tests = [_tested(each, look, explained, raw[each.label], lowest_Hz) for each in tones]
        best = max(tests, key=lambda tested: tested.evidence)
        if best.evidence < STRONG or best.log_p + np.log(len(tones)) > SIGNIFICANT:
            break
        fit = started(best, look, explained)
        change = look.change([fit.effect])
        found.append(_described(fit, best, look, change))
        look, data = (replace(each, readings=each.readings - change) for each in (look, data))
    return found, data


def _tested(candidate: Candidate, data: WhitenedData, explained: Explained, raw: Array, lowest_Hz: float) -> ScoreTest:
    score, frequency, tried = best_tone(candidate, data, explained, raw, STRONG, lowest_Hz)
    return ScoreTest(candidate, {"freq_Hz": frequency}, score, tried)


def _described(fit: Fitted, tested: ScoreTest, data: WhitenedData, change: Array) -> Defect:
    tangent = fit.tangent(data)
    std = np.sqrt(np.diag(np.linalg.pinv(tangent.T @ tangent, hermitian=True))) * fit.scale
    effect = fit.effect
    parameters: dict[str, tuple[Any, Any, str]] = {
        name: (getattr(effect, name), None, "name") for name in effect.choices()
    }
    first = 0
    for item in fit.free:
        part = tuple(float(each) for each in std[first : first + item.size])
        first += item.size
        parameters[item.name] = getattr(effect, item.name), part[0] if item.size == 1 else part, item.unit
    gap = np.zeros(len(CHANNELS))
    gap[data.columns] = np.sqrt(np.mean(change[:, data.columns] ** 2, axis=0))
    nothing = np.zeros_like(data.readings, dtype=bool)
    return Defect(effect.name, effect.where, parameters, nothing, tested.log_p, gap)
