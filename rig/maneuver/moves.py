"""How long an arm needs from pose to pose, at its own speeds and accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver.profile import PEAK_ACCELERATION, PEAK_SPEED

_ACCELERATIONS: Final = "joint_acceleration_limit_deg_s2"
#: Where nothing is stated: speed [rad/s, m/s], and the time to reach it [s].
_SPEED: Final = (1.0, 0.1)
_TIME_S: Final = 0.25
#: Least time of a move [s], and how much slower than the limits a move is.
_LEAST_S: Final = 0.3
_EASE: Final = 1.05


@dataclass(frozen=True, eq=False)
class Dynamics:
    """What the joints of an arm may do.

    Attributes:
        speed: (N,) [rad/s, m/s]. acceleration: (N,) [rad/s^2, m/s^2].
        assumed: what the arm's file does not state, in words; empty where it states all.
    """

    speed: Array
    acceleration: Array
    assumed: str

    @classmethod
    def of(cls, arm: Arm, speed: float | None = None, acceleration: float | None = None) -> Dynamics:
        """An arm's stated limits, or lower ones.

        Args:
            speed, acceleration: at most so much in every joint [rad/s, rad/s^2; of joints that slide with m].

        Raises:
            RigError: one of these is not positive.
        """
        for name, value in (("speed", speed), ("acceleration", acceleration)):
            if value is not None and not 0.0 < value < np.inf:
                raise RigError(f"{name}: found {value:g}, expected a positive number")
        slides = np.array(arm.slides)
        usual = np.where(slides, _SPEED[1], _SPEED[0])
        fastest = np.where(np.isfinite(arm.speed), arm.speed, usual)
        assumed = []
        if not np.isfinite(arm.speed).all() and speed is None:
            assumed.append(f"speeds of {np.degrees(_SPEED[0]):.0f} deg/s")
        stated = {arm.model.numeric(index).name for index in range(arm.model.nnumeric)}
        if _ACCELERATIONS in stated:
            most = np.radians(np.array(arm.model.numeric(_ACCELERATIONS).data, dtype=float))[: arm.dof]
        else:
            most = fastest / _TIME_S
            if acceleration is None:
                assumed.append(f"accelerations that reach full speed in {_TIME_S:g} s")
        if speed is not None:
            fastest = np.minimum(fastest, speed) if np.isfinite(arm.speed).all() else np.full(arm.dof, speed)
        if acceleration is not None:
            most = np.minimum(most, acceleration) if _ACCELERATIONS in stated else np.full(arm.dof, acceleration)
        return cls(fastest, most, " and ".join(assumed))

    def seconds(self, first: ArrayLike, last: ArrayLike) -> Array:
        """(...,) time of quintic moves between joint values (..., N), all joints at once [s]."""
        way = np.abs(np.asarray(last, dtype=float) - np.asarray(first, dtype=float))
        by_speed = (PEAK_SPEED * way / self.speed).max(axis=-1)
        by_acceleration = np.sqrt(PEAK_ACCELERATION * way / self.acceleration).max(axis=-1)
        return np.asarray(np.maximum(_EASE * np.maximum(by_speed, by_acceleration), _LEAST_S))
