"""A sensor off its centre on a fast sweep: nothing gives way, but the quasi-static assumption."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from typing_extensions import override

from validation.blind.draws import unit
from validation.blind.mechanics.mechanism import Mechanism, Vector
from validation.blind.settings import Setting

_LEVER_M = 0.03


@dataclass(frozen=True)
class OffCentreSensor(Mechanism):
    """The accelerometer sits a lever arm away from where the model has it, on an arm that moves fast."""

    effect = "motion_acceleration"
    fast = True

    lever_m: Vector

    @classmethod
    @override
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        x, y, z = (float(value) for value in _LEVER_M * unit(rng))
        return cls(1.0, (x, y, z))

    @property
    @override
    def where(self) -> str:
        return "accelerometer"

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        site = spec.site("imu")
        site.pos = site.pos + self.strength * np.asarray(self.lever_m)
