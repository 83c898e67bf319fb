"""The position servos that drive an arm: those of its model, or ideal ones where the model has none.

A URDF states no servos, and many MJCF files have motors that a controller would drive. Ideal servos stand for both:
the stiffness of joint j is I_j (2 pi f)^2 and its damping 2 D I_j 2 pi f, with I_j the largest inertia that the joint
has to move in any pose, so that every joint has the bandwidth f or more and the damping D or more.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from rig.arm.clearance import finite_limits
from rig.arm.serial import Arm
from rig.arrays import Array
from rig.errors import RigError

_BANDWIDTH_HZ: Final = 50.0
_DAMPING: Final = 0.7
#: Poses at which inertias are looked at.
_POSES: Final = 100
#: Less [kg m^2, kg] is that of no link: what is left of one whose mass the file does not state.
_WEIGHTLESS: Final = 1e-7
#: A step is at most this, as a share of the time in which the stiffest motion turns by one radian.
_STEP: Final = 0.5


@dataclass(frozen=True, eq=False)
class Driven:
    """An arm with servos.

    Attributes:
        model: its own to change. actuators: (N,) the number of each joint's servo.
        most_step_s: the longest step that its servos bear [s].
    """

    model: mujoco.MjModel
    actuators: NDArray[np.int64]
    most_step_s: float


def driven(arm: Arm) -> Driven:
    """The model of an arm with a position servo on every joint.

    Raises:
        RigError: a joint without a servo moves no mass.
    """
    own = _position_actuators(arm.model, arm.chain.joints)
    if (own >= 0).all():
        return Driven(copy.copy(arm.model), own, math.inf)
    inertia, stiffest = _inertias(arm)
    if missing := [name for name, value in zip(arm.joint_names, inertia, strict=True) if value < _WEIGHTLESS]:
        raise RigError(
            f"arm {arm.name}: {missing[0]} moves no mass: expected mass and inertia of every link"
            f"{' (<inertial>)' if arm.urdf is not None else ''}, or engine kinematic"
        )
    omega = 2.0 * np.pi * _BANDWIDTH_HZ
    spec = arm.spec()
    spec.compile()  # which numbers its joints
    numbered = {joint.id: joint for joint in spec.joints}
    chosen = [numbered[int(joint)] for joint in arm.chain.joints]
    for number, joint in enumerate(chosen, start=1):
        joint.name = joint.name or f"joint{number} of the arm"
    names = {joint.name for joint in chosen}
    for actuator in [each for each in spec.actuators if each.target in names]:
        spec.delete(actuator)
    for joint, value in zip(chosen, inertia, strict=True):
        spec.add_actuator(
            name=f"servo of {joint.name}",
            target=joint.name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gainprm=[omega**2 * value] + [0.0] * 9,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[0.0, -(omega**2) * value, -2.0 * _DAMPING * omega * value] + [0.0] * 7,
        )
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()
    return Driven(model, _position_actuators(model, arm.chain.joints), _STEP / (omega * stiffest))


def _inertias(arm: Arm) -> tuple[Array, float]:
    """(N,) the largest inertia of each joint [kg m^2, kg] in any pose, and how many times faster than a servo alone
    the stiffest motion of all of them together is."""
    model, chain = arm.model, arm.chain
    data = mujoco.MjData(model)
    low, high = finite_limits(arm)
    q = np.random.default_rng(0).uniform(low, high, (_POSES, arm.dof))
    members, rows = model.jnt_qposadr[chain.members], model.jnt_dofadr[chain.joints]
    matrices, full = np.empty((_POSES, arm.dof, arm.dof)), np.empty((model.nv, model.nv))
    for number, values in enumerate(chain.spread(q)):
        data.qpos[members] = values
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        matrices[number] = full[np.ix_(rows, rows)]
    inertia = np.asarray(matrices.diagonal(axis1=1, axis2=2).max(axis=0))
    if inertia.min() < _WEIGHTLESS:
        return inertia, 1.0
    root = 1.0 / np.sqrt(inertia)
    softest = np.linalg.eigvalsh(root[:, None] * matrices * root).min()
    return inertia, float(1.0 / np.sqrt(max(softest, 1e-6)))


def _position_actuators(model: mujoco.MjModel, joints: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) the number of each joint's position actuator, -1 where it has none."""
    servo = (
        (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
        & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE)
        & (model.actuator_gainprm[:, 0] > 0)
        & (model.actuator_biasprm[:, 1] == -model.actuator_gainprm[:, 0])
    )
    found = [np.flatnonzero(servo & (model.actuator_trnid[:, 0] == joint)) for joint in joints]
    return np.array([index[0] if len(index) else -1 for index in found])
