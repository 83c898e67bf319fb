"""Driving an arm that has a mechanism in it, by ``mj_step``: what its encoders read and what its sensor really does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import NDArray

from rig.arrays import Array
from rig.assets import model_path
from rig.errors import RigError
from rig.maneuver import TorusSweep
from rig.trajectory import JointTrajectory
from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.settings import RATE_HZ

_STEP_S: Final = 1e-3
_BLOCK_STEPS: Final = 10_000
_SETTLE_S: Final = 5.0
#: The accelerometer sees second differences over so many steps either way: a board of about 50 Hz bandwidth, which
#: feels the millisecond of an impact no more than a real one.
_SMOOTHED: Final = 10
_JOINTS: Final = tuple(f"joint{number}" for number in range(1, 7))


@dataclass(frozen=True)
class Driven:
    """What happened, at the n samples of the recording.

    Attributes:
        t: (n,) [s]. q: (n, 6) [rad] what the encoders read.
        R_base_tool: (n, 3, 3) and acceleration: (n, 3) [m/s^2] of the sensor itself, base frame, without gravity.
        field: (n, 3) stray field at the sensor, base frame, relative to the stated magnitude.
    """

    t: Array
    q: Array
    R_base_tool: Array
    acceleration: Array
    field: Array


def drive(mechanism: Mechanism, maneuver: TorusSweep, gravity: Array) -> Driven:
    """Let the servos follow a sweep with the mechanism in the arm.

    Args:
        gravity: (3,) [m/s^2], base frame, which is the model's world.

    Raises:
        RigError: the model cannot be built, or the simulation became unstable.
    """
    model = built(mechanism)
    model.opt.timestep = _STEP_S
    model.opt.gravity = gravity
    data = mujoco.MjData(model)
    joints = [model.joint(name).id for name in _JOINTS]
    positions, speeds = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    kept = round(1.0 / (RATE_HZ * _STEP_S))
    samples = round(maneuver.duration_s * RATE_HZ)
    before = round(_SETTLE_S / _STEP_S)
    _start(model, data, maneuver, positions, speeds)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    width = 1 + model.nq  # time comes first
    path = np.empty((samples, 3, model.nq))  # a little before, at, and a little after each sample
    total = before + (samples - 1) * kept + 1 + _SMOOTHED
    with Rollout(nthread=0) as rollout:
        for first in range(0, total, _BLOCK_STEPS):
            steps = np.arange(first, min(first + _BLOCK_STEPS, total))
            control = _control(mechanism, maneuver, np.multiply(steps - before, _STEP_S), model.nu)
            states, _ = rollout.rollout(model, data, state[None], control[None])
            if not np.isfinite(states).all() or any(warning.number for warning in data.warning):
                raise RigError(f"{mechanism.effect}: the simulation became unstable")
            _keep(path, states[0, :, 1:width], steps, before, kept)
            state = states[0, -1].copy()
    return _seen(mechanism, model, data, path, positions)


def built(mechanism: Mechanism) -> mujoco.MjModel:
    """The arm's model with the mechanism in it.

    Raises:
        RigError: MuJoCo refuses it.
    """
    spec = mujoco.MjSpec.from_file(str(model_path("a465/a465.xml")))
    mechanism.edit(spec)
    try:
        model = spec.compile()
    except ValueError as error:
        raise RigError(f"{mechanism.effect}: no valid model: {' '.join(str(error).split())}") from error
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    return model


def _start(model: mujoco.MjModel, data: mujoco.MjData, maneuver: TorusSweep, positions: Array, speeds: Array) -> None:
    command = _commanded(maneuver, np.array([-_SETTLE_S]))
    data.qpos[positions] = command.q[0]
    data.qvel[speeds] = command.qd[0]  # the roll is turning already; the others stand still before the start


def _control(mechanism: Mechanism, maneuver: TorusSweep, t: Array, count: int) -> Array:
    control = np.empty((len(t), count))
    control[:, :6] = _commanded(maneuver, t).q
    control[:, 6:] = mechanism.forces(t)
    return control


def _commanded(maneuver: TorusSweep, t: Array) -> JointTrajectory:
    trajectory = maneuver.trajectory(t)
    assert isinstance(trajectory, JointTrajectory)
    return trajectory


def _keep(path: Array, qpos: Array, steps: NDArray[np.int64], before: int, kept: int) -> None:
    """Store the positions after these steps that are next to a sample; after step k the time is k + 1 steps."""
    reached = steps + 1 - before
    for moment, offset in enumerate((-_SMOOTHED, 0, _SMOOTHED)):
        rows = np.flatnonzero((reached - offset) % kept == 0)
        numbers = (reached[rows] - offset) // kept
        inside = (numbers >= 0) & (numbers < len(path))
        path[numbers[inside], moment] = qpos[rows[inside]]


def _seen(mechanism: Mechanism, model: mujoco.MjModel, data: mujoco.MjData, path: Array, positions: Array) -> Driven:
    count, site = len(path), model.site("imu").id
    rotation, place, field = np.empty((count, 3, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    for row in range(count):
        for moment in (0, 2, 1):
            data.qpos[:] = path[row, moment]
            mujoco.mj_kinematics(model, data)
            place[row, moment] = data.site_xpos[site]
        rotation[row] = data.site_xmat[site].reshape(3, 3)
        field[row] = mechanism.stray_field(model, data)
    # Of the path itself: whatever forces, stops and friction made it, the integrator's acceleration, averaged.
    acceleration = (place[:, 0] - 2.0 * place[:, 1] + place[:, 2]) / (_SMOOTHED * _STEP_S) ** 2
    return Driven(np.arange(count) / RATE_HZ, path[:, 1][:, positions], rotation, acceleration, field)
