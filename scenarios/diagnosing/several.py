"""What is left of recordings diagnosed together, or of one beside a calibration from before, each by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.gap.data.stack import acting
from estimators.gap.diagnose import Examined
from estimators.gap.report.fitted_rig import delayed
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.signals import Signals
from scenarios.gap_report.gap_residuals import GapResiduals, diagnosed_effects, whitened, with_noise


def residuals_of_each(found: Examined) -> list[GapResiduals]:
    """Each recording's residuals, before and after the causes are modelled, beside the one calibration."""
    laid, data = found.laid, found.data
    effects = list(found.effects)
    after: Array | None = None
    if effects:
        settled = data.around(found.settled)
        after = settled.left_over(settled.residual - settled.change(effects))
    others = {cause.effect: cause for cause in found.diagnosis.leading if EFFECTS[cause.effect].kind is not Kind.MEAN}
    every = [effect for effect in diagnosed_effects(found.diagnosis) if effect.name in others]
    result = []
    for number, (recording, part, rows) in enumerate(zip(laid.recordings, laid.data, data.single, strict=False)):
        named = [each for each in every if others[each.name].recording in (None, recording.name)]
        began = laid.began[number] if laid.began else 0.0
        own = [_own(effect, began, float(recording.t[0])) for effect in acting(effects, number)]
        causes = (*own, *named)
        left = part.residual if after is None else after[rows]
        explained = after is not None or bool(named)
        result.append(
            GapResiduals(
                recording=recording,
                floor=laid.floors[number],
                before=part.residual,
                after=left if explained else None,
                left_out=np.zeros(part.readings.shape, dtype=bool),
                white_before=whitened(part, part.residual),
                white_after=whitened(with_noise(part, named, left), left) if explained else None,
                causes=causes,
                data=replace(part, base=_earlier(part.base, began)) if began else part,
                calibrated=found.settled.restricted(recording.sensors),
            )
        )
    return result


def _earlier(base: Signals, by: float) -> Signals:
    """Signals on a clock that tells so much less [s]."""
    nodes = base.pose_nodes
    return replace(base, t=base.t - by, known_nodes=(None if nodes is None else nodes.later(-by),))


def _own(effect: Effect, began: float, start: float) -> Effect:
    """The catalogue's effect on a recording's own clock, from its first sample on where it begins before that."""
    own = delayed(EFFECTS[effect.name].from_mapping(vars(effect)), -began)
    values = vars(own)
    return own.from_mapping({**values, "at_s": max(values["at_s"], start)}) if "at_s" in values else own
