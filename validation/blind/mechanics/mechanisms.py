"""The mechanisms: lash, spring, rocking base, sensor off its centre, magnet on a link, vibrating table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import mujoco
import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.sensor import Triple
from validation.blind.draws import scaled, unit
from validation.blind.mechanics.mechanism import Label, Mechanism
from validation.blind.settings import Setting

_LASH_RAD = 4e-3
_LASH_FRICTION_NM = 12.0  # more than the tilted base puts on the yaw joint
_LASH_SERVO = 0.1  # of the arm's own gain, which, with nothing but the motor to hold, rattles between the stops
_SPRING_NM = 200.0  # per radian, at strength one: 0.5 N m of the tool make 2.5 mrad
_SPRING_NMS = 0.3
_SPRING_ARMATURE = 1e-3
_ROCKING_NM = 2e4  # per radian, at strength one: the arm's 20 N m make 1 mrad
_ROCKING_NMS = 200.0
_LEVER_M = 0.03
#: Where it sits in its link's frame [m]: beside the tool's tube, or at the foot of the waist, half a metre away.
_MAGNETS = {"link5": (0.06, 0.05, 0.02), "link1": (0.0, -0.15, 0.12)}
_MAGNET_FIELD = 0.01  # of the stated magnitude, about, at the sensor
_TABLE_N_M = 6e5  # with the arm's 31 kg: 22 Hz
_TABLE_N_S_M = 2500.0
_IMBALANCE_N = 2.0


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
    def besides(self) -> tuple[Label, ...]:
        return (("outliers", "acquisition"),)  # a reading that falls into the impact on a stop

    @override
    def edit(self, spec: mujoco.MjSpec) -> None:
        motor = spec.joint("joint1")
        half = 0.5 * _LASH_RAD * self.strength
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
        servo.gainprm[0] *= _LASH_SERVO
        servo.biasprm[1:3] *= _LASH_SERVO
        arm = spec.add_tendon(
            name="arm_on_base",
            frictionloss=_LASH_FRICTION_NM,
            solref_friction=[0.002, 1.0],
            solimp_friction=[0.9999, 0.9999, 1e-3, 0.5, 2.0],
        )
        arm.wrap_joint("joint1", 1.0)
        arm.wrap_joint("lash", 1.0)


@dataclass(frozen=True)
class SpringJoint(Mechanism):
    """A torsion spring with damping and an inertia of its own, between the motor of joint 5 and the tool: it gives way
    under the tool's weight."""

    effect = "joint_compliance"
    place = "joint5"

    @property
    @override
    def families(self) -> tuple[Label, ...]:
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
            stiffness=np.array([_SPRING_NM / self.strength, 0.0, 0.0]),
            damping=np.array([_SPRING_NMS, 0.0, 0.0]),
        )
        flex.armature = _SPRING_ARMATURE


@dataclass(frozen=True)
class RockingBase(Mechanism):
    """The base stands on a spring hinge about one horizontal axis, on which the arm's weight tips it as the arm turns;
    the other directions are stiff."""

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
            stiffness=np.array([_ROCKING_NM / self.strength, 0.0, 0.0]),
            damping=np.array([_ROCKING_NMS, 0.0, 0.0]),
        )
        hinge.armature = 0.0


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


@dataclass(frozen=True)
class MagnetOnLink(Mechanism):
    """A point dipole that rides along: its field at the sensor is constant in the link only as far as the sensor keeps
    its place beside it."""

    effect = "link_hard_iron"

    link: str
    moment: Triple

    @classmethod
    @override
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        link = str(rng.choice(list(_MAGNETS)))
        distance = 0.09 if link == "link5" else 0.5
        return cls(1.0, link, scaled(unit(rng), _MAGNET_FIELD * distance**3))

    @property
    @override
    def where(self) -> str:
        return self.link

    @property
    @override
    def families(self) -> tuple[Label, ...]:
        # joints 2 to 4 are locked: links 1 to 4 are one body
        return () if self.link == "link5" else tuple(("link_hard_iron", f"link{number}") for number in (2, 3, 4))

    @override
    def stray_field(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        body, site = model.body(self.link).id, model.site("imu").id
        turned = data.xmat[body].reshape(3, 3)
        way = data.site_xpos[site] - (data.xpos[body] + turned @ np.asarray(_MAGNETS[self.link]))
        moment = self.strength * (turned @ np.asarray(self.moment))
        distance = float(np.linalg.norm(way))
        towards = way / distance
        return np.asarray((3.0 * towards * float(towards @ moment) - moment) / distance**3)


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
            stiffness=np.array([_TABLE_N_M, 0.0, 0.0]),
            damping=np.array([_TABLE_N_S_M, 0.0, 0.0]),
        )
        motor = spec.add_actuator(name="imbalance", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="table")
        motor.set_to_motor()

    @override
    def forces(self, t: Array) -> Array:
        return _IMBALANCE_N * self.strength * np.sin(2.0 * np.pi * self.frequency_Hz * t + self.phase_rad)[:, None]


#: By name.
MECHANISMS: Final[dict[str, type[Mechanism]]] = {
    "lash_joint": LashJoint,
    "spring_joint": SpringJoint,
    "rocking_base": RockingBase,
    "off_centre_sensor": OffCentreSensor,
    "magnet_on_link": MagnetOnLink,
    "vibrating_table": VibratingTable,
}
