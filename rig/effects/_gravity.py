"""The torque that gravity puts on a joint, from the arm's MuJoCo model at rest."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import Final

import mujoco
import numpy as np
from mujoco.batch import Batch

from rig.arm import Arm
from rig.arm.rotation_map import moving_joints
from rig.arrays import Array
from rig.errors import RigError
from rig.signals import Signals

#: The torque is affine in the cosine and sine of each joint: three angles a joint determine it.
_NODES: Final = 2.0 * np.pi / 3.0 * np.arange(3)
#: Values that one sample's waves become weights of those at the nodes by: 1, cosine and sine.
_WEIGHTS: Final = np.stack([np.ones(3), 2.0 * np.cos(_NODES), 2.0 * np.sin(_NODES)]) / 3.0
_MOST_JOINTS = 7  # 2187 poses; of more joints the torque is evaluated sample by sample
_ROWS = 4096
_STARTS = 32


def relative_gravity_torque(signals: Signals, joint: int) -> Array:
    """tau_g / max |tau_g| (n,) of one joint (a column) at the true joint angles; positive where it holds a load up.

    Raises:
        RigError: the arm has no such joint, or weighs nothing.
    """
    if signals.arm is None or signals.q.size == 0:
        raise RigError(
            "the effect needs the arm's weight: found a recording without joint angles, expected q1_rad..qN_rad"
        )
    if joint >= signals.arm.dof:
        raise RigError(f"arm {signals.arm.name}: found {signals.arm.dof} joints, the effect acts on joint {joint + 1}")
    return gravity_torque(signals.arm, signals.q, joint) / largest_gravity_torque(signals.arm, joint)


def gravity_torque(arm: Arm, q: Array, joint: int) -> Array:
    """The torque (n,) [N m] on one joint (a column) that keeps the arm at rest at q (n, N) [rad]."""
    bent = arm.chain.coupling is not None or any(arm.slides)  # not affine in cosines and sines of the joints' values
    if bent or arm.dof > _MOST_JOINTS:
        return _evaluated(arm, q, joint)
    moving = moving_joints(q)
    still = [column for column in range(arm.dof) if column not in moving]
    table = _interpolated(np.transpose(_table(arm, joint), [*still, *moving]), q[:1, still])[0]
    blocks = [q[start : start + _ROWS, moving] for start in range(0, len(q), _ROWS)]
    return np.concatenate([np.broadcast_to(_interpolated(table, block), len(block)) for block in blocks])


@lru_cache(maxsize=64)
def _table(arm: Arm, joint: int) -> Array:
    """(3, 3, ...) the torque on a joint with each joint of the arm at each of the three nodes."""
    poses = np.array(list(product(_NODES, repeat=arm.dof)))
    return _evaluated(arm, poses, joint).reshape((3,) * arm.dof)


def _interpolated(table: Array, q: Array) -> Array:
    """(n, ...) a table's first axes, one for each column of q (n, m), contracted at these angles."""
    values = table[None]
    for angle in q.T:  # the first of the remaining axes is this joint's
        weights = np.stack([np.ones(len(q)), np.cos(angle), np.sin(angle)], axis=1) @ _WEIGHTS
        rest = values.reshape(len(values), 3, -1)
        found = weights @ rest[0] if len(rest) == 1 else np.einsum("nk,nkr->nr", weights, rest)
        values = found.reshape(len(q), *values.shape[2:])
    return values


def is_loaded(arm: Arm, joint: int) -> bool:
    """Whether gravity loads a joint (a column) in any pose."""
    try:
        return largest_gravity_torque(arm, joint) > 0.0
    except RigError:
        return False


@lru_cache(maxsize=64)
def largest_gravity_torque(arm: Arm, joint: int) -> float:
    """The largest torque [N m] on one joint (a column) of any pose, limits aside.

    Joint by joint the best angle is known in closed form; from several starts this climbs to the top.

    Raises:
        RigError: gravity does not load the joint.
    """
    rng = np.random.default_rng(0)  # starts only
    q = rng.uniform(-np.pi, np.pi, (_STARTS, arm.dof))
    table = _table(arm, joint)
    best = 0.0
    while True:
        for column in range(arm.dof):
            others = np.delete(q, column, axis=1)
            values = _interpolated(np.moveaxis(table, column, -1), others)
            mean, turning = values.mean(axis=1), values @ np.exp(1j * _NODES) * (2.0 / 3.0)
            q[:, column] = np.angle(np.where(mean < 0.0, -turning, turning))
        top = float(np.abs(_interpolated(table, q)).max())
        if top <= best * (1.0 + 1e-12):
            break
        best = top
    weight = float(arm.model.body_mass.sum() * np.linalg.norm(arm.model.opt.gravity))
    if not top > 1e-9 * max(weight, 1e-9):
        raise RigError(f"arm {arm.name}: gravity does not load {arm.joint_names[joint]}: expected masses in its model")
    return top


def _evaluated(arm: Arm, q: Array, joint: int) -> Array:
    """The torque (n,) [N m] sample by sample: MuJoCo's bias force at zero velocity."""
    model, chain = arm.model, arm.chain
    batch = Batch(model, min(_ROWS, len(q)), 1)
    qpos, bias = batch.bind("qpos"), batch.bind("qfrc_bias")
    addresses, degree = model.jnt_qposadr[chain.members], int(model.jnt_dofadr[chain.joints[joint]])
    torque = np.empty(len(q))
    for start in range(0, len(q), _ROWS):
        block = q[start : start + _ROWS]
        qpos[: len(block), addresses] = chain.spread(block)
        batch.forward(np.arange(len(block)), stage=mujoco.mjtStage.mjSTAGE_VEL.value)
        torque[start : start + len(block)] = bias[: len(block), degree]
    return torque
