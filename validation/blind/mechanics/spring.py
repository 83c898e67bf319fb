"""A spring joint: the gear of the pitch joint gives way under the tool's weight."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from typing_extensions import override

from validation.blind.mechanics.mechanism import Mechanism

_STIFFNESS_NM = 200.0  # per radian, at strength one: 0.5 N m of the tool make 2.5 mrad
_DAMPING_NMS = 0.3
_ARMATURE = 1e-3


@dataclass(frozen=True)
class SpringJoint(Mechanism):
    """A torsion spring with damping and an inertia of its own, between the motor of joint 5 and the tool."""

    effect = "joint_compliance"
    place = "joint5"

    @property
    @override
    def families(self) -> tuple[tuple[str, str], ...]:
        return (("joint_eccentricity", "joint5"),)  # the droop is a cosine of the angle: one of its phases

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        motor = spec.joint("joint5")
        flex = spec.body("link5").add_joint(
            name="flex",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=motor.axis,
            pos=motor.pos,
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            stiffness=np.array([_STIFFNESS_NM / self.strength, 0.0, 0.0]),
            damping=np.array([_DAMPING_NMS, 0.0, 0.0]),
        )
        flex.armature = _ARMATURE
