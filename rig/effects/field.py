"""Effects on the magnetic field at the sensor; their fields are relative to the stated magnitude."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.channels import COLUMNS_OF, MAGNETOMETER
from rig.effects._numerics import times
from rig.effects.base import LINKS, SWEPT_JOINTS, Effect, Stage, register
from rig.effects.parameters import Value, parameter
from rig.effects.transmission import smooth_sign
from rig.signals import Signals

#: A dipole is searched on a grid of this step, so far around the sensor's path, and no nearer to it than this [m].
DIPOLE_STEP, DIPOLE_REACH, DIPOLE_CLEARANCE = 0.25, 0.4, 0.1

_NEAREST = 1e-3  # [m]: a dipole is never nearer


def with_field(signals: Signals, change: Array) -> Signals:
    """The signals with a field (n, 3), base frame, relative to the stated magnitude, added."""
    stated = float(signals.references[COLUMNS_OF[MAGNETOMETER]][0])
    return replace(signals, magnetic=signals.magnetic + stated * change)


@register
@dataclass(frozen=True)
class FieldGradient(Effect):
    """The field changes along the path: B(p) = B0 + G p, G the gradient, symmetric and traceless: without curl and
    divergence.

    The five numbers are G_xx, G_yy, G_xy, G_xz, G_yz, relative to the stated magnitude; G_zz = -G_xx - G_yy.
    1-10 %/m in a laboratory; a guess.
    """

    name = "field_gradient"
    stage = Stage.FIELD
    of_sensor = MAGNETOMETER
    places = ("base",)
    requires = ("position",)

    gradient_per_m: tuple[float, ...] = parameter("1/m", 0.03, size=5)

    @property
    def matrix(self) -> Array:
        """G (3, 3) [1/m]."""
        xx, yy, xy, xz, yz = self.gradient_per_m
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]])

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return with_field(signals, signals.position @ self.matrix)


@register
@dataclass(frozen=True)
class BaseDipole(Effect):
    """A piece of steel or a motor near the arm, seen from afar: a dipole of moment m at position r0, in the base frame.

    B + (3 u (u . m) - m) / d^3, with d u the way from r0 to the sensor; m [m^3] is the moment over the stated
    magnitude: 1e-3 makes 1.6-3.1 % of the field at 0.4 m, and is a magnet of 0.5 A m^2 in the Earth's field
    (mu0/4 pi M/B). A steel bolt has 1e-5, a motor 1e-4 to 1e-3; a guess.
    """

    name = "base_dipole"
    stage = Stage.FIELD
    of_sensor = MAGNETOMETER
    places = ("base",)
    requires = ("position",)

    position_m: tuple[float, ...] = parameter(
        "m", 0.5, lower=-10.0, upper=10.0, size=3, strength=False, default=(0.5, 0.0, 0.3)
    )
    moment: tuple[float, ...] = parameter("m^3", 2e-4, size=3)

    @classmethod
    @override
    def searched(cls, signals: Signals) -> list[dict[str, Value]]:
        path = _thinned(signals)
        points = np.array(list(itertools.product(*cls.ranges(signals)["position_m"])))
        nearest = np.sum((path - points[:, None]) ** 2, axis=2).min(axis=1)
        kept = points[nearest > DIPOLE_CLEARANCE**2]
        return [{"position_m": tuple(float(x) for x in point)} for point in kept]

    @classmethod
    @override
    def ranges(cls, signals: Signals) -> dict[str, tuple[Array, ...]]:
        path = _thinned(signals)
        low, high = path.min(axis=0) - DIPOLE_REACH, path.max(axis=0) + DIPOLE_REACH
        counts = np.ceil((high - low) / DIPOLE_STEP).astype(int) + 1
        return {"position_m": tuple(np.linspace(low[axis], high[axis], counts[axis]) for axis in range(3))}

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        moment = np.asarray(self.moment)
        way = signals.position - np.asarray(self.position_m)
        squared = np.maximum(np.einsum("ni,ni->n", way, way), _NEAREST**2)[:, None]
        along = (way @ moment)[:, None]
        return with_field(signals, (way * (3.0 * along / squared) - moment) / (squared * np.sqrt(squared)))


def _thinned(signals: Signals) -> Array:
    """(m, 3) [m] places on the sensor's path."""
    return signals.position[:: max(1, len(signals) // 256)]


@register
@dataclass(frozen=True)
class LinkHardIron(Effect):
    """A constant field fixed in link j: B + R_base_link h, h the field relative to the stated magnitude, in the
    link's frame.

    0.1-5 % of the field; a guess. With joints 2 to 4 locked, links 1 to 4 are one body.
    """

    name = "link_hard_iron"
    stage = Stage.FIELD
    of_sensor = MAGNETOMETER
    places = LINKS
    requires = ("joints",)

    field: tuple[float, ...] = parameter("relative", 0.01, size=3)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return with_field(signals, times(signals.link_rotation(self.joint), self.field))


@register
@dataclass(frozen=True)
class LinkSoftIron(Effect):
    """Iron in link j that the field itself magnetises: B + R_base_link X R_base_link^T B, X the susceptibility,
    symmetric.

    The six numbers are X_xx, X_yy, X_zz, X_xy, X_xz, X_yz, in the link's frame. 0.1-5 %; a guess.
    """

    name = "link_soft_iron"
    stage = Stage.FIELD
    of_sensor = MAGNETOMETER
    places = LINKS
    requires = ("joints",)

    chi: tuple[float, ...] = parameter("relative", 0.01, lower=-1.0, upper=1.0, size=6)

    @property
    def matrix(self) -> Array:
        """X (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.chi
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        rotation = signals.link_rotation(self.joint)
        in_link = np.einsum("nij,ni->nj", rotation, np.broadcast_to(signals.magnetic, (len(signals), 3)))
        change = np.einsum("nij,nj->ni", rotation, in_link @ self.matrix)
        return replace(signals, magnetic=signals.magnetic + change)


@register
@dataclass(frozen=True)
class MotorCurrentField(Effect):
    """A joint's motor makes a field as it pulls: B + R_base_link h s, h the field, fixed in the link of the motor.

    That is the link before the joint (4, 5 for joints 5, 6), and link 1 for joint 1. s is the logged current [A] where
    there is one, h then per ampere; else the smooth sign of the joint's velocity, as friction makes most of a slow
    joint's current. h is relative to the stated magnitude; 0.1-2 %; a guess.
    """

    name = "motor_current_field"
    stage = Stage.FIELD
    of_sensor = MAGNETOMETER
    places = SWEPT_JOINTS
    needs_motion = True
    requires = ("joints",)

    field: tuple[float, ...] = parameter("relative", 5e-3, size=3)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        current = signals.currents.get(self.joint + 1)
        drive = smooth_sign(signals.joint_velocity[:, self.joint]) if current is None else current
        # the motor sits on the link before its joint, or the first
        in_base = times(signals.link_rotation(max(self.joint - 1, 0)), self.field)
        return with_field(signals, drive[:, None] * in_base)
