"""What an arm can be asked to do: within limits, speeds and accelerations, clear of itself and of what is around."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from rig.arm import Arm
from rig.arm.clearance import Clearance, finite_limits
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver.fourier_sweep import FourierSweep
from rig.maneuver.moves import Dynamics
from rig.maneuver.static_poses import StaticPoses
from rig.maneuver.torus_sweep import TorusSweep

#: Samples of a recording at which contacts are looked for.
_SEEN: Final = 300
_SLACK: Final = 1.0 + 1e-6
#: A joint whose file states no speed may go so much faster than it was seen to go, or so fast [rad/s, m/s].
_FASTER: Final = 2.0
_LEAST_SPEED: Final = (0.17, 0.02)


@dataclass(frozen=True, eq=False)
class Reach:
    """An arm and what it may do.

    Attributes:
        arm: with its joints' limits. clearance: what it may not touch. dynamics: how fast it may go.
    """

    arm: Arm
    clearance: Clearance
    dynamics: Dynamics

    @classmethod
    def of(cls, arm: Arm, clearance: Clearance | None = None, dynamics: Dynamics | None = None) -> Self:
        """An arm by its file: on a table at the height of its base, where it has no scene of its own.

        Raises:
            RigError: as ``Clearance.of``.
        """
        own = Clearance.of(arm, None if arm.is_a465 else 0.0) if clearance is None else clearance
        return cls(arm, own, Dynamics.of(arm) if dynamics is None else dynamics)

    @classmethod
    def recorded(cls, arm: Arm, t: Array, q: Array) -> Self:
        """Of an arm that was recorded at times (n,) [s] with joint values (n, N) [rad, m].

        What touches there is no collision, as the arm has done it; a speed that is not stated is twice what was seen.
        """
        seen = q[:: max(1, len(q) // _SEEN)]
        fastest = np.abs(np.diff(q, axis=0) / np.diff(t)[:, None]).max(axis=0, initial=0.0)
        faster = np.maximum(_FASTER * fastest, np.where(arm.slides, _LEAST_SPEED[1], _LEAST_SPEED[0]))
        stated = replace(arm, speed=np.where(np.isfinite(arm.speed), arm.speed, faster))
        reach = cls.of(arm, dynamics=Dynamics.of(stated))
        return replace(reach, clearance=reach.clearance.without(seen))

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper (N,) [rad, m]; of a joint without any, one turn."""
        return finite_limits(self.arm)

    def allows(self, maneuver: TorusSweep | FourierSweep | StaticPoses) -> bool:
        """Whether the arm can make a maneuver."""
        speed, acceleration = maneuver.peaks()
        if (speed > _SLACK * self.dynamics.speed).any() or (acceleration > _SLACK * self.dynamics.acceleration).any():
            return False
        way = maneuver.way()
        try:
            self.arm.check_limits(way, "the maneuver")
        except RigError:
            return False
        return self.clear(way)

    def clear(self, q: Array) -> bool:
        """Whether the arm touches nothing at joint values (n, N) [rad, m]."""
        return self.clearance.first_contact(q) is None
