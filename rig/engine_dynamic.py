"""The dynamic engine: position servos drive the arm along a maneuver, the encoders say where it really is.

MuJoCo steps at about 1 kHz. The arm follows with the tracking error of its servos, so what the encoders read is not
what was commanded, and the accelerations are real.
"""

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import ArrayLike

from rig.arm import Arm
from rig.arm.servos import Driven, driven
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver import Maneuver
from rig.progress import Progress
from rig.trajectory import JointTrajectory, sample_times

_STEP_RATE_HZ: Final = 1000.0
_BLOCK_S: Final = 10.0  # simulated at a time: memory stays constant, progress is smooth
_SETTLE_S: Final = 2.0  # run before the start, so that the servos' transients are over when it begins
_JUMP_RAD: Final = 0.01  # a command this far from where its velocity leads in one step is no motion


def follow(
    arm: Arm, maneuver: Maneuver, gravity: ArrayLike = (0.0, 0.0, -9.8), progress: Progress | None = None
) -> JointTrajectory:
    """Let the arm's servos follow a maneuver from its start, where it has settled.

    Args:
        arm: driven by the servos of its model, or by ideal ones (``rig.arm.servos``).
        maneuver: of joints, without jumps.
        gravity: (3,) [m/s^2], base frame.
        progress: called with the share done, 0 to 1.

    Returns:
        The way that the arm took, at the maneuver's samples: true angles, which the encoders read.

    Raises:
        RigError: the arm has no masses, the maneuver has no joints, jumps or leaves a limit, or the simulation
            became unstable.
    """
    servos = driven(arm)
    step_s = min(1.0 / _STEP_RATE_HZ, servos.most_step_s)
    substeps = max(1, math.ceil(1.0 / (step_s * maneuver.rate_Hz) - 1e-9))
    simulation = _Simulation(arm, servos, np.asarray(gravity, dtype=float), 1.0 / (maneuver.rate_Hz * substeps))
    times = sample_times(maneuver.duration_s, maneuver.rate_Hz)
    q, qd, qdd = (np.empty((len(times), arm.dof)) for _ in range(3))
    block = max(1, round(_BLOCK_S * maneuver.rate_Hz))
    for start in range(0, len(times), block):
        rows = slice(start, min(start + block, len(times)))
        steps = np.arange(rows.start * substeps, rows.stop * substeps)
        command = _commanded(arm, maneuver, np.multiply(steps, simulation.timestep))
        if start == 0:
            simulation.settle(command)
        path = simulation.run(command)
        for samples, values in zip((q, qd, qdd), path, strict=True):
            samples[rows] = values[::substeps]
        if progress is not None:
            progress(rows.stop / len(times))
    return JointTrajectory(times, q, qd, qdd)


def _commanded(arm: Arm, maneuver: Maneuver, t: Array) -> JointTrajectory:
    trajectory = maneuver.trajectory(t)
    if not isinstance(trajectory, JointTrajectory):
        raise RigError(
            "the dynamic engine drives joints: found a maneuver of the sensor alone, expected engine kinematic"
        )
    arm.check_limits(trajectory.q, f"the maneuver from t = {t[0]:g} s on")
    return trajectory


class _Simulation:
    """The arm's model under way: its state goes from one block of steps to the next."""

    def __init__(self, arm: Arm, servos: Driven, gravity: Array, timestep: float) -> None:
        self.timestep = timestep
        self._arm = arm
        self._model = servos.model
        self._model.opt.timestep = timestep
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
        self._model.opt.gravity = arm.chain.R_world_base @ gravity
        self._data = mujoco.MjData(self._model)
        self._actuators = servos.actuators
        self._qpos = self._model.jnt_qposadr[arm.chain.joints]
        self._qvel = self._model.jnt_dofadr[arm.chain.joints]
        self._physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._state = np.empty(mujoco.mj_stateSize(self._model, self._physics))
        self._last_command: Array | None = None

    def settle(self, command: JointTrajectory) -> None:
        """Begin at rest with the servos' errors where they will be: joints without limits already turning."""
        free = np.isinf(self._arm.lower) & np.isinf(self._arm.upper)
        speed = np.where(free, command.qd[0], 0.0)
        before = -self.timestep * np.arange(round(_SETTLE_S / self.timestep), 0, -1, dtype=float)
        q = command.q[0] + before[:, None] * speed
        self._data.qpos[self._model.jnt_qposadr[self._arm.chain.members]] = self._arm.chain.spread(q[:1])[0]
        self._data.qvel[self._qvel] = speed
        mujoco.mj_getState(self._model, self._data, self._state, self._physics)
        self.run(JointTrajectory(before, q, np.broadcast_to(speed, q.shape), np.zeros_like(q)))

    def run(self, command: JointTrajectory) -> tuple[Array, Array, Array]:
        """One step for each row of the command.

        Returns:
            The path (n, N) at the beginning of each step, when that row's command takes effect: angles [rad],
            velocities [rad/s] and accelerations [rad/s^2].
        """
        self._refuse_jumps(command)
        control = np.zeros((1, len(command), self._model.nu))
        control[0, :, self._actuators] = command.q.T
        with Rollout(nthread=0) as rollout:
            states, _ = rollout.rollout(self._model, self._data, self._state[None], control)
        after = states[0]
        if not np.isfinite(after).all() or any(warning.number for warning in self._data.warning):
            raise RigError(f"arm {self._arm.name}: the simulation became unstable before t = {command.t[-1]:g} s")
        # A rollout returns the state after each step. The integrator moves q(k) to q(k+1) with v(k+1), so the path
        # through q has these central differences at k, without error in h. MuJoCo's accelerometer is not used: it
        # reads the acceleration before the servos' damping is made implicit, here up to three times that of the path.
        before = np.concatenate([self._state[None], after[:-1]])
        self._state = after[-1].copy()
        qpos, qvel = 1 + self._qpos, 1 + self._model.nq + self._qvel  # time comes first
        v, v_next = before[:, qvel], after[:, qvel]
        return before[:, qpos], (v + v_next) / 2, (v_next - v) / self.timestep

    def _refuse_jumps(self, command: JointTrajectory) -> None:
        q, qd, t = command.q, command.qd, command.t
        if self._last_command is not None:
            q = np.vstack([self._last_command[0], q])
            qd = np.vstack([self._last_command[1], qd])
            t = np.concatenate([t[:1] - self.timestep, t])
        off = np.abs(np.diff(q, axis=0) - (qd[1:] + qd[:-1]) * (self.timestep / 2)) > _JUMP_RAD
        if off.any():
            row, joint = np.argwhere(off)[0]
            raise RigError(
                f"the maneuver: {self._arm.joint_names[joint]} jumps at t = {t[row + 1]:g} s, "
                "expected a motion without jumps (or engine kinematic)"
            )
        self._last_command = np.stack([q[-1], qd[-1]])
