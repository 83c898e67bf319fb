"""A lash joint: the motor turns a second, coaxial joint between two stops; friction holds the arm in between."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from typing_extensions import override

from validation.blind.mechanics.mechanism import Mechanism

_WIDTH_RAD = 4e-3
_FRICTION_NM = 12.0  # more than the tilted base puts on the yaw joint
_SERVO = 0.1  # of the arm's own gain, which, with nothing but the motor to hold, rattles between the stops


@dataclass(frozen=True)
class LashJoint(Mechanism):
    """Lash behind the motor of joint 1.

    Encoder and servo hold the motor's side. The arm's side turns freely within the lash but for its friction on the
    base, so it stays where it is until a stop pushes it: a play operator, with whatever the stops' softness adds.
    """

    effect = "backlash"
    place = "joint1"

    @property
    @override
    def besides(self) -> tuple[tuple[str, str], ...]:
        return (("outliers", "acquisition"),)  # a reading that falls into the impact on a stop

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        motor = spec.joint("joint1")
        half = 0.5 * _WIDTH_RAD * self.strength
        lash = spec.body("link1").add_joint(
            name="lash",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=motor.axis,
            pos=motor.pos,
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=np.degrees([-half, half]),  # the model counts in degrees
            solref_limit=[0.004, 1.0],
            solimp_limit=[0.99, 0.9999, 1e-4, 0.5, 2.0],
        )
        lash.armature = 0.0
        lash.damping = np.zeros(3)
        servo = spec.actuator("joint1")
        servo.gainprm[0] *= _SERVO
        servo.biasprm[1:3] *= _SERVO
        arm = spec.add_tendon(
            name="arm_on_base",
            frictionloss=_FRICTION_NM,
            solref_friction=[0.002, 1.0],
            solimp_friction=[0.9999, 0.9999, 1e-3, 0.5, 2.0],
        )
        arm.wrap_joint("joint1", 1.0)
        arm.wrap_joint("lash", 1.0)
