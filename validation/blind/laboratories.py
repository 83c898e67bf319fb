"""Laboratories of the blind check: arm, maneuver, what is logged, how long, with or without a recording at rest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.trajectory import JointTrajectory

_ARMS: Final = Path(__file__).parent / "arms"
#: Turns of a wandering joint [Hz], and how much of its limits it uses.
_SLOWEST, _FASTEST, _SHARE = 0.003, 0.011, 0.85
#: A joint without limits, or with wide ones, wanders this far to either side [rad].
_REACH: Final = 2.8


@dataclass(frozen=True)
class Laboratory:
    """Where a case is recorded.

    Attributes:
        name: of the laboratory.
        words: what it is.
        arm: "" for the scenario's own, else a file of ``arms``; its sensor sits on the link ``sensor``.
        wanders: all joints move at once, instead of the torus sweep.
        pose: what is logged of the pose.
        samples: of the recording; None: as ordered.
        locked: whether there is a recording at rest.
    """

    name: str
    words: str
    arm: str = ""
    wanders: bool = False
    pose: Literal["joints", "tool"] = "joints"
    samples: int | None = None
    locked: bool = True

    @property
    def model(self) -> Path | None:
        """The file of its arm; None where that is the scenario's."""
        return _ARMS / self.arm if self.arm else None

    def arm_in(self, own: Arm) -> Arm:
        """Its arm, the scenario's ``own`` unless it has another."""
        return own if self.model is None else Arm.from_file(self.model, TIP)


TIP: Final = "sensor"

LABORATORIES: Final = {
    each.name: each
    for each in (
        Laboratory("sweep", "the paper's sweep of joints 1, 5 and 6"),
        Laboratory("all joints", "all six joints of the same arm at once", wanders=True),
        Laboratory("elbow", "another arm of six joints, all at once", arm="elbow.urdf", wanders=True),
        Laboratory("seven", "an arm of seven joints, all at once", arm="seven.urdf", wanders=True),
        Laboratory("tool poses", "the tool's poses are logged, not the joints", wanders=True, pose="tool"),
        Laboratory("short", "1,200 samples", wanders=True, samples=1200),
        Laboratory("long", "60,000 samples", samples=60_000),
        Laboratory("no rest", "no recording at rest", locked=False),
    )
}


@dataclass(frozen=True)
class Wander:
    """All joints at once, each on two sines of its own within its limits.

    Attributes:
        duration_s, rate_Hz: of the samples.
        centre, size: (N,) [rad] of each joint's way.
        turns_Hz, phases: (N, 2) of its sines; the second has half the first's size.
    """

    duration_s: float
    rate_Hz: float
    centre: tuple[float, ...]
    size: tuple[float, ...]
    turns_Hz: tuple[tuple[float, float], ...]
    phases: tuple[tuple[float, float], ...]

    @classmethod
    def drawn(cls, arm: Arm, duration_s: float, rate_Hz: float, rng: np.random.Generator) -> Wander:
        """A way for an arm."""
        low, high = np.clip(arm.lower, -_REACH, _REACH), np.clip(arm.upper, -_REACH, _REACH)
        turns = rng.uniform(_SLOWEST, _FASTEST, (arm.dof, 2))
        phases = rng.uniform(0.0, 2.0 * np.pi, (arm.dof, 2))
        centre, size = 0.5 * (low + high), 0.5 * _SHARE * (high - low)
        return cls(
            duration_s,
            rate_Hz,
            tuple(map(float, centre)),
            tuple(map(float, size)),
            tuple((float(a), float(b)) for a, b in turns),
            tuple((float(a), float(b)) for a, b in phases),
        )

    def trajectory(self, t: Array | None = None) -> JointTrajectory:
        """The motion at times (n,) [s], by default at its own samples."""
        at = (
            np.arange(round(self.duration_s * self.rate_Hz)) / self.rate_Hz if t is None else np.asarray(t, dtype=float)
        )
        turning = 2.0 * np.pi * np.asarray(self.turns_Hz)
        angle = at[:, None, None] * turning + np.asarray(self.phases)
        parts = np.asarray(self.size)[:, None] * np.array([2.0, 1.0]) / 3.0
        q = np.asarray(self.centre) + np.sum(parts * np.sin(angle), axis=2)
        qd = np.sum(parts * turning * np.cos(angle), axis=2)
        return JointTrajectory(at, q, qd, -np.sum(parts * turning**2 * np.sin(angle), axis=2))
