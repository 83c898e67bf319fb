"""The bare kinematic chain inside a MuJoCo model: the joints from the base to a site, and nothing else.

Geometry, contacts, actuators and other branches cost time and change nothing about where the site is, so poses and
accelerations are computed on a model that has only the chain. Its gravity is zero: accelerations are kinematic.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from rig.arrays import Array, Mask
from rig.errors import RigError, nearest

# By default MuJoCo prints warnings, and leaves a MUJOCO_LOG.TXT in the user's folder. What matters of them, a motion
# that is no number, is found in its results.
mujoco.set_mju_user_warning(lambda text: None)

_SITE = "site"
_BLOCK = 4096  # configurations at a time: constant memory, and as fast as all at once
_MANY = 2048  # below this number, starting threads costs more than it gains
_THREADS = 8  # a block is done in milliseconds: more would mostly wait for each other


@dataclass(frozen=True, eq=False)
class Chain:
    """The joints, hinges and slides, that carry a site of a model.

    A joint that follows another one of the chain (a mimic joint, an equality of joints) is in the chain but has no
    value of its own: the chain has M joints and N values.

    Attributes:
        bare: the chain alone; its world frame is the base frame, its one site the sensor, its one sensor the linear
            acceleration of that site in the base frame, its gravity zero.
        joints: (N,) ids in the full model of the joints that move by themselves, base to site.
        links: (N,) ids in ``bare`` of the bodies that they move.
        R_world_base: (3, 3) the base, which is the body that carries the first joint, in the full model's world.
        members: (M,) ids in the full model of all joints.
        slides: (M,) which of them slide.
        coupling, offset: (M, N), (M,): values of all joints = coupling q + offset; None where M = N and they are q.
    """

    bare: mujoco.MjModel
    joints: NDArray[np.int64]
    links: NDArray[np.int64]
    R_world_base: Array
    members: NDArray[np.int64]
    slides: Mask
    coupling: Array | None = None
    offset: Array | None = None

    @property
    def places(self) -> list[int]:
        """Of each of the N joints its number among the M members, from 0."""
        return [int(np.argmax(self.members == joint)) for joint in self.joints]

    def spread(self, q: Array) -> Array:
        """The values (n, M) of all joints at q (n, N) [rad, m]."""
        if self.coupling is None or self.offset is None:
            return q
        return q @ self.coupling.T + self.offset

    def _spread_rate(self, rate: Array) -> Array:
        return rate if self.coupling is None else rate @ self.coupling.T

    def evaluated(self, q: Array, **fields: Sequence[int] | NDArray[np.int64]) -> list[Array]:
        """Kinematics at joint values q (n, N) [rad, m]: (n, k, ..) of each ``MjData`` field named, of k of its rows."""
        batch = Batch(self.bare, max(1, min(_BLOCK, len(q))), _threads(len(q)))
        qpos = batch.bind("qpos")
        outputs = [(batch.bind(field), own) for field, own in fields.items()]
        found = [np.empty((len(q), len(own), *output.shape[2:])) for output, own in outputs]
        for start in range(0, len(q), _BLOCK):
            rows = slice(start, min(start + _BLOCK, len(q)))
            count = rows.stop - start
            qpos[:count] = self.spread(q[rows])
            some = np.arange(count) if count < batch.nsim else None
            batch.forward(some, stage=mujoco.mjtStage.mjSTAGE_POS.value)
            for array, (output, own) in zip(found, outputs, strict=True):
                array[rows] = output[:count, own]
        return found

    def acceleration(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The site's acceleration (n, 3) [m/s^2], base frame, of the motion q, qd, qdd (n, N) [rad, m, s]."""
        q, qd, qdd = self.spread(q), self._spread_rate(qd), self._spread_rate(qdd)
        result = np.empty((len(q), 3))

        def run(start: int, stop: int) -> None:
            data = mujoco.MjData(self.bare)
            qpos, qvel, qacc, reading = data.qpos, data.qvel, data.qacc, data.sensordata
            for row in range(start, stop):
                qpos[:] = q[row]
                qvel[:] = qd[row]
                qacc[:] = qdd[row]
                mujoco.mj_inverse(self.bare, data)  # it lets go of the interpreter lock, so threads help
                result[row] = reading

        workers = _threads(len(q))
        edges = np.linspace(0, len(q), workers + 1).astype(int)
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run, edges[:-1], edges[1:]))
        return result


def _threads(count: int) -> int:
    return min(_THREADS, os.cpu_count() or 1) if count >= _MANY else 1


def site_names(model: mujoco.MjModel) -> list[str]:
    """The names of all named sites."""
    return [name for name in (model.site(index).name for index in range(model.nsite)) if name]


def extract_chain(model: mujoco.MjModel, site: str, where: str) -> Chain:
    """Find the chain from the base to ``site``.

    Args:
        model: any compiled model.
        site: name of the site that stands for the sensor.
        where: the model's file or name, for messages.

    Raises:
        RigError: no such site, no joint on the way to it, a joint that is neither hinge nor slide, or one that follows
            another in a way that is not linear.
    """
    names = site_names(model)
    if site not in names:
        raise RigError(
            f"{where}: no site {site!r}: expected one of {', '.join(names) or '(none)'}{nearest(site, names)}"
        )
    site_id = model.site(site).id
    bodies = _bodies_from_base(model, int(model.site_bodyid[site_id]), where)
    members = np.array([joint for body in bodies for joint in joints_of(model, body)])
    coupling, offset, own = _coupled(model, members, where)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = np.zeros(3)
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    parent = spec.worldbody
    weight = {"mass": 1.0, "inertia": np.ones(3), "explicitinertial": True}
    count = 0
    for body in bodies:
        parent = parent.add_body(pos=model.body_pos[body], quat=model.body_quat[body], **weight)
        for number, joint in enumerate(joints_of(model, body)):
            if number:  # joints of one body act one after the other: as bodies in the same place
                parent = parent.add_body(**weight)
            parent.name = f"body{count}"
            parent.add_joint(
                type=model.jnt_type[joint],
                pos=model.jnt_pos[joint],
                axis=model.jnt_axis[joint],
                ref=float(model.qpos0[model.jnt_qposadr[joint]]),
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            )
            count += 1
    parent.add_site(name=_SITE, pos=model.site_pos[site_id], quat=model.site_quat[site_id])
    spec.add_sensor(
        type=mujoco.mjtSensor.mjSENS_FRAMELINACC,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=_SITE,
    )
    bare = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base = int(model.body_parentid[bodies[0]])
    plain = len(own) == len(members)
    return Chain(
        bare=bare,
        joints=members[own],
        links=np.array([bare.body(f"body{index}").id for index in own]),
        R_world_base=data.xmat[base].reshape(3, 3).copy(),
        members=members,
        slides=model.jnt_type[members] == mujoco.mjtJoint.mjJNT_SLIDE,
        coupling=None if plain else coupling,
        offset=None if plain else offset,
    )


def joints_of(model: mujoco.MjModel, body: int) -> range:
    """The ids of a body's joints."""
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body]))


def _coupled(model: mujoco.MjModel, members: NDArray[np.int64], where: str) -> tuple[Array, Array, list[int]]:
    """How the chain's M joints follow those N that move by themselves: (M, N), (M,), and which these are.

    A joint that follows one outside the chain moves by itself as far as the chain is concerned.
    """
    place = {int(joint): index for index, joint in enumerate(members)}
    follows: dict[int, tuple[int, float, float]] = {}
    for row in range(model.neq):
        joint, leader = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
        is_joint = model.eq_type[row] == mujoco.mjtEq.mjEQ_JOINT and model.eq_active0[row]
        if not is_joint or joint not in place or leader not in place:
            continue
        constant, slope, *higher = (float(value) for value in model.eq_data[row][:5])
        if any(higher):
            raise RigError(
                f"{where}: joint {model.joint(joint).name!r} follows {model.joint(leader).name!r} by a polynomial of"
                " higher order: expected a linear one"
            )
        zero = model.qpos0[model.jnt_qposadr[[joint, leader]]]
        follows[place[joint]] = (place[leader], slope, float(zero[0] + constant - slope * zero[1]))
    own = [index for index in range(len(members)) if index not in follows]
    coupling, offset = np.zeros((len(members), len(own))), np.zeros(len(members))
    for column, index in enumerate(own):
        coupling[index, column] = 1.0
    for start in follows:
        index, slope, constant, seen = start, 1.0, 0.0, set()
        while index in follows:
            if index in seen:
                raise RigError(f"{where}: joint {model.joint(int(members[start])).name!r} follows itself")
            seen.add(index)
            index, own_slope, own_constant = follows[index]
            constant += slope * own_constant
            slope *= own_slope
        coupling[start, own.index(index)] = slope
        offset[start] = constant
    return coupling, offset, own


def _bodies_from_base(model: mujoco.MjModel, tip: int, where: str) -> list[int]:
    """The bodies from the first one with a joint up to ``tip``."""
    bodies = []
    body = tip
    while body != 0:
        bodies.append(body)
        body = int(model.body_parentid[body])
    bodies.reverse()
    while bodies and not len(joints_of(model, bodies[0])):
        bodies.pop(0)
    if not bodies:
        raise RigError(f"{where}: the site is fixed to the base: expected at least one hinge joint on the way to it")
    for body in bodies:
        for joint in joints_of(model, body):
            kind = mujoco.mjtJoint(model.jnt_type[joint])
            if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                found = kind.name.removeprefix("mjJNT_").lower()
                raise RigError(
                    f"{where}: joint {model.joint(joint).name!r} is of type {found}: expected hinge or slide"
                )
    return bodies
