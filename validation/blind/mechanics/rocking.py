"""A base on springs: the arm's weight tips it as the arm turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from typing_extensions import override

from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.settings import Setting

_STIFFNESS_NM = 2e4  # per radian, at strength one: the arm's 20 N m make 1 mrad
_DAMPING_NMS = 200.0


@dataclass(frozen=True)
class RockingBase(Mechanism):
    """The base stands on a spring hinge about one horizontal axis; the other directions are stiff."""

    effect = "base_rocking"
    place = "base"

    towards_rad: float

    @classmethod
    @override
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(1.0, float(rng.uniform(0.0, 2.0 * np.pi)))

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        hinge = spec.body("base").add_joint(
            name="rocking",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[-np.sin(self.towards_rad), np.cos(self.towards_rad), 0.0],
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            stiffness=np.array([_STIFFNESS_NM / self.strength, 0.0, 0.0]),
            damping=np.array([_DAMPING_NMS, 0.0, 0.0]),
        )
        hinge.armature = 0.0
