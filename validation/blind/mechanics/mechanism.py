"""What a mechanism is: an edit of the arm's model, perhaps with a motor or a magnet of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np

from rig.arrays import Array
from validation.blind.settings import Setting

Label = tuple[str, str]


@dataclass(frozen=True)
class Mechanism:
    """A mechanism in the arm, at a strength.

    Attributes:
        strength: one is typical; what it multiplies is the mechanism's own affair.
    """

    #: What the catalogue calls it, and where, unless that is drawn.
    effect: ClassVar[str]
    place: ClassVar[str] = ""
    #: Whether the sweep is to be a fast one.
    fast: ClassVar[bool] = False

    strength: float

    @classmethod
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        """At strength one, with everything else drawn."""
        return cls(1.0)

    @property
    def where(self) -> str:
        """Its place in the catalogue."""
        return self.place

    @property
    def families(self) -> tuple[Label, ...]:
        """Further names in the catalogue that are as right."""
        return ()

    @property
    def besides(self) -> tuple[Label, ...]:
        """Names for what it does on the side: not right, but not wrong either."""
        return ()

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Build it into the arm's model. The arm's own joints keep their names: their angles are what encoders read."""

    def forces(self, t: Array) -> Array:
        """(n, m) controls, at times (n,) [s], of the m actuators that ``edit`` has added."""
        return np.empty((len(t), 0))

    def stray_field(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """(3,) field at the sensor in this state, base frame, relative to the stated magnitude."""
        return np.zeros(3)

    def scaled(self, factor: float) -> Self:
        """The same mechanism, so many times as strong."""
        return replace(self, strength=self.strength * factor)
