"""Single readings that are off: what a cause at an uncertain instant does is no outlier."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from whitened_examples import recorded

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.defects import Defect, explained_away
from rig.arm import Arm
from rig.effects import Effect, make_effect


def step(at_s: float) -> Effect:
    return make_effect("bias_step", {"where": "accel2", "volts": 1.0, "at_s": at_s})


def test_readings_about_an_uncertain_instant_are_no_outliers() -> None:
    """A step of 70 standard deviations is taken to be two samples early: two readings are that far off."""
    arm, quiet = Arm.a465(), recorded(1)
    base = set_up(quiet, estimated_floor(quiet, arm), arm)
    data = set_up(recorded(1, ("bias_step", {"where": "accel2", "volts": 1.0, "at_s": 700.1})), base.floor, arm)
    seen = Defect("outliers", "acquisition", {}, np.zeros(data.readings.shape, dtype=bool), -50.0, np.zeros(6))
    early = 700.1 - 2.0 * data.interval_s

    def outliers(unsure: Sequence[Sequence[Effect]]) -> int:
        left = explained_away(data, [seen], base.pipeline, [step(early)], unsure=unsure)
        return int(sum(defect.affected.sum() for defect in left))

    assert outliers([]) == 2
    assert outliers([[step(early + by * data.interval_s)] for by in (-4.0, 4.0)]) == 0
