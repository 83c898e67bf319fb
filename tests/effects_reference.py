"""An arm and a sensor in plain loops, against which the effects are checked; nothing of the rig is called."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from arm_files import A465, A465_OFFSET, IMU_M

from rig.arrays import Array

GRAVITY = 9.8 * np.array([0.02, -0.01, -1.0]) / np.sqrt(0.02**2 + 0.01**2 + 1.0)
FIELD = 1.3 * np.array([0.4, -0.1, -0.9]) / np.sqrt(0.16 + 0.01 + 0.81)  # a magnitude other than one
FULL = np.array([9.8] * 3 + [1.3] * 3)
SENSITIVITY = np.array([0.142, 0.149, 0.148, 1.31, 1.33, 1.29])
OFFSET = np.array([2.32, 2.47, 2.26, 2.65, 3.89, 2.67])
AXES = np.array(
    [
        [-0.06, 0.01, -1.0],
        [1.0, 0.03, -0.04],
        [0.0, -1.0, -0.02],
        [0.02, -1.0, -0.01],
        [0.06, 0.05, 1.0],
        [1.0, 0.0, 0.01],
    ]
)
AXES /= np.linalg.norm(AXES, axis=1)[:, None]


def rodrigues(axis: Array, angle: float) -> Array:
    """exp(angle [axis]x) by its power series."""
    x, y, z = np.asarray(axis, dtype=float)
    generator = angle * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    term = total = np.eye(3)
    for order in range(1, 25):
        term = term @ generator / order
        total = total + term
    return total


def joint_angles(t: Array) -> Array:
    """(n, 6) [rad]: all joints move, smoothly, at the pace of the sweep; joint 6 rolls on."""
    t = np.asarray(t, dtype=float)
    return np.stack(
        [
            0.3 + 1.7 * np.sin(0.031 * t + 0.2),
            1.5 + 0.2 * np.sin(0.023 * t),
            -1.5 + 0.3 * np.cos(0.019 * t),
            0.2 * np.sin(0.027 * t + 1.0),
            0.1 + 1.3 * np.sin(0.013 * t + 0.5),
            0.2426 * t + 0.4,
        ],
        axis=1,
    )


def joint_speeds(t: Array) -> Array:
    """(n, 6) [rad/s]: central differences of the angles at times t, one-sided at the ends."""
    q = joint_angles(t)
    speeds = np.empty_like(q)
    for row in range(len(t)):
        before, after = max(row - 1, 0), min(row + 1, len(t) - 1)
        speeds[row] = (q[after] - q[before]) / (t[after] - t[before])
    return speeds


def about_x(angle: float) -> Array:
    """Rx."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def about_z(angle: float) -> Array:
    """Rz."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def frames(q: Array, twist: tuple[int, float] = (0, 0.0)) -> list[Array]:
    """The transforms (4, 4) base<-frame j, j = 0 to 6, by Denavit-Hartenberg; ``twist`` adds to alpha of one joint."""
    poses = [np.eye(4)]
    for joint in range(6):
        a, d, alpha = A465[joint]
        turn, lean = np.eye(4), np.eye(4)
        turn[:3, :3], turn[2, 3] = about_z(q[joint] + A465_OFFSET[joint]), d
        lean[:3, :3], lean[0, 3] = about_x(alpha + (twist[1] if twist[0] == joint + 1 else 0.0)), a
        poses.append(poses[-1] @ turn @ lean)
    return poses


@dataclass
class Sample:
    """All that a formula can depend on at one sample."""

    row: int
    t: float
    q: Array
    speed: Array
    warmth: float
    elapsed: float
    frames: list[Array] = field(default_factory=list)
    R: Array = field(default_factory=lambda: np.eye(3))
    p: Array = field(default_factory=lambda: np.zeros(3))
    a: Array = field(default_factory=lambda: np.zeros(3))
    B: Array = field(default_factory=lambda: FIELD.copy())


Hook = Callable[..., Any]


def readings(
    t: Array,
    *,
    joints: Hook | None = None,
    pose: Hook | None = None,
    twist: tuple[int, float] = (0, 0.0),
    axis: Hook | None = None,
    volts: Hook | None = None,
) -> Array:
    """Voltages (n, 6) sample by sample, with hooks where an effect changes something.

    Args:
        joints: (sample) -> the true joint angles.
        pose: (sample) -> None, changes ``R``, ``p``, ``a`` or ``B`` of the sample.
        axis: (x, sample) -> what the six axes feel instead of x.
        volts: (V, sample) -> the readings instead of V.
    """
    result = []
    angles, speeds, warmth = joint_angles(t), joint_speeds(t), temperature(t) - 25.0
    for row, at in enumerate(t):
        sample = Sample(row, float(at), angles[row], speeds[row], float(warmth[row]), float(at - t[0]))
        q = sample.q if joints is None else joints(sample)
        sample.frames = frames(q, twist)
        sample.R = sample.frames[6][:3, :3]
        sample.p = sample.frames[6][:3, 3] + IMU_M * sample.R[:, 2]
        if pose is not None:
            pose(sample)
        felt = np.repeat([sample.R.T @ (GRAVITY - sample.a), sample.R.T @ sample.B], 3, axis=0)
        x = np.array([AXES[k] @ felt[k] for k in range(6)])
        if axis is not None:
            x = axis(x, sample)
        V = SENSITIVITY * x + OFFSET
        result.append(V if volts is None else volts(V, sample))
    return np.array(result)


def temperature(t: Array) -> Array:
    """(n,) [degC]."""
    return 24.0 + 3.0 * np.exp(-np.asarray(t, dtype=float) / 40.0) * np.cos(0.05 * np.asarray(t, dtype=float))
