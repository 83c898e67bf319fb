"""The bare kinematic chain inside a MuJoCo model: the hinges from the base to a site, and nothing else.

Geometry, contacts, actuators and other branches cost time and change nothing about where the site is, so poses and
accelerations are computed on a model that has only the chain. Its gravity is zero: accelerations are kinematic.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from rig.errors import RigError, nearest

Array = NDArray[np.float64]

_SITE = "site"
_BLOCK = 4096  # configurations at a time: constant memory, and as fast as all at once
_MANY = 2048  # below this number, starting threads costs more than it gains
_THREADS = 8  # a block is done in milliseconds: more would mostly wait for each other


@dataclass(frozen=True, eq=False)
class Chain:
    """The hinges that carry a site of a model.

    Attributes:
        bare: the chain alone; its world frame is the base frame, its one site the sensor, its one sensor the linear
            acceleration of that site in the base frame, its gravity zero.
        joints: (N,) ids of the hinges in the full model, base to site.
        links: (N,) ids in ``bare`` of the bodies that the hinges move.
        R_world_base: (3, 3) the base, which is the body that carries the first hinge, in the full model's world.
    """

    bare: mujoco.MjModel
    joints: NDArray[np.int64]
    links: NDArray[np.int64]
    R_world_base: Array

    def evaluated(self, q: Array, *fields: str) -> Iterator[tuple[slice, list[Array]]]:
        """Kinematics at joint angles q (n, N) [rad], in blocks: the rows, and for them the ``MjData`` fields asked for.

        The arrays are overwritten by the next block.
        """
        batch = Batch(self.bare, max(1, min(_BLOCK, len(q))), _threads(len(q)))
        qpos = batch.bind("qpos")
        outputs = [batch.bind(field) for field in fields]
        for start in range(0, len(q), _BLOCK):
            rows = slice(start, min(start + _BLOCK, len(q)))
            count = rows.stop - start
            qpos[:count] = q[rows]
            some = np.arange(count) if count < batch.nsim else None
            batch.forward(some, stage=mujoco.mjtStage.mjSTAGE_POS.value)
            yield rows, [output[:count] for output in outputs]

    def acceleration(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The site's acceleration (n, 3) [m/s^2], base frame, of the motion q, qd, qdd (n, N) [rad, s]."""
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
        RigError: no such site, no joint on the way to it, a joint that is no hinge, or two joints in one body.
    """
    names = site_names(model)
    if site not in names:
        raise RigError(
            f"{where}: no site {site!r}: expected one of {', '.join(names) or '(none)'}{nearest(site, names)}"
        )
    site_id = model.site(site).id
    bodies = _bodies_from_base(model, int(model.site_bodyid[site_id]), where)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = np.zeros(3)
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    parent = spec.worldbody
    joints: list[int] = []
    for body in bodies:
        parent = parent.add_body(
            pos=model.body_pos[body], quat=model.body_quat[body], mass=1.0, inertia=np.ones(3), explicitinertial=True
        )
        for joint in _joints_of(model, body):
            parent.name = f"link{len(joints) + 1}"
            parent.add_joint(
                type=mujoco.mjtJoint.mjJNT_HINGE,
                pos=model.jnt_pos[joint],
                axis=model.jnt_axis[joint],
                ref=float(model.qpos0[model.jnt_qposadr[joint]]),
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            )
            joints.append(joint)
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
    return Chain(
        bare=bare,
        joints=np.array(joints),
        links=np.array([bare.body(f"link{number}").id for number in range(1, len(joints) + 1)]),
        R_world_base=data.xmat[base].reshape(3, 3).copy(),
    )


def _joints_of(model: mujoco.MjModel, body: int) -> range:
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body]))


def _bodies_from_base(model: mujoco.MjModel, tip: int, where: str) -> list[int]:
    """The bodies from the first one with a joint up to ``tip``."""
    bodies = []
    body = tip
    while body != 0:
        bodies.append(body)
        body = int(model.body_parentid[body])
    bodies.reverse()
    while bodies and not len(_joints_of(model, bodies[0])):
        bodies.pop(0)
    if not bodies:
        raise RigError(f"{where}: the site is fixed to the base: expected at least one hinge joint on the way to it")
    for body in bodies:
        joints = _joints_of(model, body)
        if len(joints) > 1:
            raise RigError(f"{where}: body {model.body(body).name!r} has {len(joints)} joints: expected one a body")
        for joint in joints:
            kind = mujoco.mjtJoint(model.jnt_type[joint])
            if kind != mujoco.mjtJoint.mjJNT_HINGE:
                found = kind.name.removeprefix("mjJNT_").lower()
                raise RigError(f"{where}: joint {model.joint(joint).name!r} is of type {found}: expected hinge")
    return bodies
