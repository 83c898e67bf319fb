"""Effects on where the sensor is: the arm's geometry, its base, its mount."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation
from typing_extensions import override

from rig.arrays import Array
from rig.effects._numerics import times
from rig.effects.base import Effect, Stage, register
from rig.effects.parameters import Value, parameter
from rig.signals import Signals

_PARALLEL = 1e-6  # sine of the angle between axes that count as parallel

#: Instants that are tried for a jump, evenly over the recording.
INSTANTS = 60


def instants(signals: Signals) -> list[dict[str, Value]]:
    """The instants of a jump to try on a recording."""
    return [{"at_s": float(at)} for at in np.linspace(signals.t[0], signals.t[-1], INSTANTS + 2)[1:-1]]


def turned_about(signals: Signals, turns: Array, pivot: Array) -> Signals:
    """The signals with the tool turned about a point.

    Args:
        turns: (n, 3) rotation vectors [rad], base frame.
        pivot: (3,) or (n, 3) the point [m], base frame.
    """
    turn = np.asarray(Rotation.from_rotvec(turns).as_matrix())
    lever = signals.position - pivot
    moved = np.einsum("nij,nj->ni", turn, lever) - lever
    return replace(signals, R_base_tool=turn @ signals.R_base_tool, position=signals.position + moved)


def twist_axis(signals: Signals, joint: int) -> Array:
    """(3,) in the frame of the link of a joint (a column): the x axis of Denavit and Hartenberg."""
    arm = signals.arm
    x = np.array([1.0, 0.0, 0.0])
    if arm is None or joint + 1 >= arm.dof:
        return x
    own, following = arm.joint_axes[joint], arm.joint_axes[joint + 1]  # base frame, all joints at zero
    R_link_base = arm.link_maps[joint].R_zero.T
    normal = R_link_base @ np.cross(own, following)
    size = float(np.linalg.norm(normal))
    if size < _PARALLEL:
        along = R_link_base @ following
        if abs(x @ along) > 1.0 - _PARALLEL:
            return np.array([0.0, 1.0, 0.0])
        across = x - (x @ along) * along
        return np.asarray(across / np.linalg.norm(across))
    normal /= size
    return x if abs(normal[0]) > 1.0 - _PARALLEL else normal


@register
@dataclass(frozen=True)
class AxisMisalignment(Effect):
    """The next joint's axis is not quite where it should be: the Denavit-Hartenberg angle is alpha_j + c, c the twist.

    R_0j' = R_0j Rx(c): everything beyond link j turns by c about the link's x axis, the sensor's position too. Where a
    model's links have other axes, x is the common normal of the joint's axis and the next one's, or, where these are
    parallel, at right angles to them.

    1 mrad; a guess.
    """

    name = "axis_misalignment"
    stage = Stage.POSE
    places = ("joint1", "joint2", "joint3", "joint4", "joint5")
    requires = ("joints",)

    twist_rad: float = parameter("rad", 1e-3, lower=-0.5, upper=0.5)

    @classmethod
    def places_on(cls, signals: Signals) -> tuple[str, ...]:
        """The joints with another one after them."""
        return super().places_on(signals)[:-1]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        R_base_link, position = signals.link_pose(self.joint)
        return turned_about(signals, times(R_base_link, self.twist_rad * twist_axis(signals, self.joint)), position)


@register
@dataclass(frozen=True)
class BaseRocking(Effect):
    """The base tilts with the arm's azimuth: by the angle a cos(q1 - p) about (-sin p, cos p, 0), a the tilt, p
    the phase: the soft direction.

    An arm that reaches along p tips down along p. 0.1-5 mrad; a guess.
    """

    name = "base_rocking"
    stage = Stage.POSE
    places = ("base",)
    requires = ("joints",)

    tilt_rad: float = parameter("rad", 1e-3, lower=-0.5, upper=0.5)
    # cos(q1 - p) (-sin p, cos p) is quadratic in (cos p, sin p): three directions span all.
    phase_rad: float = parameter(
        "rad", np.pi, strength=False, default=0.0, spanned=(0.0, np.pi / 3.0, 2.0 * np.pi / 3.0)
    )

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        axis = (-np.sin(self.phase_rad), np.cos(self.phase_rad), 0.0)
        angle = self.tilt_rad * np.cos(signals.q[:, 0] - self.phase_rad)
        return turned_about(signals, np.outer(angle, axis), np.zeros(3))


@lru_cache(maxsize=64)
def _turn(rotation_rad: tuple[float, ...]) -> Array:
    """(3, 3) of a rotation vector; a slip is applied again and again beside what else is fitted."""
    return np.asarray(Rotation.from_rotvec(rotation_rad).as_matrix())


@register
@dataclass(frozen=True)
class MountingSlip(Effect):
    """The sensor slips on its mount at one instant: R_base_tool exp([r]x) from at_s on, r the rotation in frame 6.

    1 mrad; a guess. The sensor's place on the tool stays as it was.
    """

    name = "mounting_slip"
    stage = Stage.POSE
    places = ("mount",)
    on_mount = True

    rotation_rad: tuple[float, ...] = parameter("rad", 1e-3, lower=-0.5, upper=0.5, size=3)
    at_s: float = parameter("s", 600.0, strength=False)

    @classmethod
    @override
    def searched(cls, signals: Signals) -> list[dict[str, Value]]:
        return instants(signals)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if not any(self.rotation_rad):
            return signals
        rotation = signals.R_base_tool.copy()
        slipped = slice(int(np.searchsorted(signals.t, self.at_s)), None)
        rotation[slipped] = times(rotation[slipped], _turn(self.rotation_rad))
        return replace(signals, R_base_tool=rotation)
