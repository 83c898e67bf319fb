"""A sensor off its centre on a fast sweep: nothing gives way, but the quasi-static assumption."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from typing_extensions import override

from rig.sensor import Triple
from validation.blind.draws import scaled, unit
from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.settings import Setting

_LEVER_M = 0.03


@dataclass(frozen=True)
class OffCentreSensor(Mechanism):
    """The accelerometer sits a lever arm away from where the model has it, on an arm that moves fast."""

    effect = "motion_acceleration"
    place = "accelerometer"
    fast = True

    lever_m: Triple

    @classmethod
    @override
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(1.0, scaled(unit(rng), _LEVER_M))

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        site = spec.site("imu")
        site.pos = site.pos + self.strength * np.asarray(self.lever_m)
