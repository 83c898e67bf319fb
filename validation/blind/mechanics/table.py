"""A vibrating table: the base stands on a spring and an unbalanced motor shakes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.sensor import Triple
from validation.blind.draws import scaled, unit
from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.settings import Setting

_STIFFNESS_N_M = 6e5  # with the arm's 31 kg: 22 Hz
_DAMPING = 2500.0
_FORCE_N = 2.0


@dataclass(frozen=True)
class VibratingTable(Mechanism):
    """The base can slide along one line, on a spring; a motor's imbalance pushes along it."""

    effect = "vibration"
    place = "accelerometer"

    line: Triple
    frequency_Hz: float
    phase_rad: float

    @classmethod
    @override
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(1.0, scaled(unit(rng), 1.0), float(rng.uniform(8.0, 30.0)), float(rng.uniform(0.0, 6.28)))

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        spec.body("base").add_joint(
            name="table",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=list(self.line),
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            stiffness=np.array([_STIFFNESS_N_M, 0.0, 0.0]),
            damping=np.array([_DAMPING, 0.0, 0.0]),
        )
        motor = spec.add_actuator(name="imbalance", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="table")
        motor.set_to_motor()

    @override
    def forces(self, t: Array) -> Array:
        return _FORCE_N * self.strength * np.sin(2.0 * np.pi * self.frequency_Hz * t + self.phase_rad)[:, None]
