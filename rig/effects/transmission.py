"""Effects between the encoder and the joint; qe is the encoder's reading, q the true angle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.effects._gravity import is_loaded, relative_gravity_torque
from rig.effects._numerics import play
from rig.effects.base import JOINTS, SWEPT_JOINTS, Effect, Stage, register
from rig.effects.parameters import parameter, phase
from rig.signals import Signals

#: Half-width [rad/s] of the smooth sign: below the sweep's slowest joint (0.013 rad/s), above an encoder's jitter
#: (31 urad in 0.25 s).
SIGN_WIDTH: Final = 1e-3

#: Ratio of each joint's harmonic drive (PyPI ctu_crs 1.0.6).
GEAR_RATIO: Final = {"joint1": 100, "joint2": 100, "joint3": 100, "joint4": 101, "joint5": 100, "joint6": 101}


#: A joint has moved [rad] when it is further than this from where it was: beyond an encoder's jitter.
_SETTLED: Final = 1e-4


def smooth_sign(velocity: Array) -> Array:
    """tanh(velocity / SIGN_WIDTH): the direction of travel, zero at rest, differentiable at a reversal."""
    return np.tanh(velocity / SIGN_WIDTH)


def is_a465(signals: Signals) -> bool:
    """Whether the arm is the rig's own, of which more is known than its model says."""
    return signals.arm is not None and signals.arm.is_a465


def turn_joint(signals: Signals, column: int, change: Array | float) -> Signals:
    """The signals with ``change`` (n,) or scalar [rad] added to one true joint angle."""
    q = signals.q.copy()
    q[:, column] += change
    return replace(signals, q=q)


@register
@dataclass(frozen=True)
class JointOffset(Effect):
    """The encoder's zero is off: q = qe + c, c the offset.

    Home repeatability, 0.1-1 deg; a guess.
    """

    name = "joint_offset"
    stage = Stage.TRANSMISSION
    places = JOINTS
    requires = ("joints",)

    offset_rad: float = parameter("rad", 5e-3, lower=-0.5, upper=0.5)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return turn_joint(signals, self.joint, self.offset_rad)


@register
@dataclass(frozen=True)
class JointScale(Effect):
    """The encoder's scale is off, by a wrong gear ratio or a belt: q = (1 + s) qe, s the error of scale.

    1e-3; a guess. On a joint that rolls on it grows with every turn: 1e-3 of 64 turns is 23 deg.
    """

    name = "joint_scale"
    stage = Stage.TRANSMISSION
    places = SWEPT_JOINTS
    needs_motion = True
    requires = ("joints",)

    scale: float = parameter("relative", 1e-3, lower=-0.1, upper=0.1)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return turn_joint(signals, self.joint, self.scale * signals.encoder_angles[:, self.joint])


@register
@dataclass(frozen=True)
class JointEccentricity(Effect):
    """The encoder's disc or the gear's wheel sits off its axis: q = qe + A sin(qe + p), once a turn of the
    joint, A the amplitude, p the phase.

    A is 0.01-0.3 deg; a guess.
    """

    name = "joint_eccentricity"
    stage = Stage.TRANSMISSION
    places = SWEPT_JOINTS
    needs_motion = True
    requires = ("joints",)

    amplitude_rad: float = parameter("rad", 1e-3, lower=-0.5, upper=0.5)
    phase_rad: float = phase()

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        angle = signals.encoder_angles[:, self.joint] + self.phase_rad
        return turn_joint(signals, self.joint, self.amplitude_rad * np.sin(angle))


@register
@dataclass(frozen=True)
class HarmonicDriveError(Effect):
    """The harmonic drive's kinematic error, twice a turn of its wave generator: q = qe + A sin(2 N qe + p), A the
    amplitude, p the phase, 2 N the order.

    N is the gear ratio, 100 for joints 1 and 5, 101 for joint 6 (PyPI ctu_crs 1.0.6), and the default of ``order`` is
    2 N; as another source has other ratios, and those of other arms are not known, 196 to 206 are tried. 1-1.5 arcmin
    peak to peak (CSF/CSG catalogue, table 40): A is 0.15-0.22 mrad; the catalogue of effects has 1-2 arcmin.
    """

    name = "harmonic_drive_error"
    stage = Stage.TRANSMISSION
    places = SWEPT_JOINTS
    needs_motion = True
    requires = ("joints",)
    rapid = True

    amplitude_rad: float = parameter("rad", 3e-4, lower=-0.1, upper=0.1)
    phase_rad: float = phase()
    order: float = parameter(
        "cycles/turn",
        200.0,
        lower=1.0,
        upper=1000.0,
        strength=False,
        default=np.nan,
        grid=tuple(float(order) for order in range(196, 207)),
    )

    def __post_init__(self) -> None:
        if isinstance(self.order, float) and np.isnan(self.order):
            object.__setattr__(self, "order", 2.0 * GEAR_RATIO.get(self.where, 100))
        super().__post_init__()

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        angle = self.order * signals.encoder_angles[:, self.joint] + self.phase_rad
        return turn_joint(signals, self.joint, self.amplitude_rad * np.sin(angle))


@register
@dataclass(frozen=True)
class Backlash(Effect):
    """The joint trails the encoder by half the lash: q = qe - (w/2) s, w the width, s the side of the play.

    That is the sign of the motion, and at rest of the last one: there a play operator of a narrow width on the
    encoder's angle, so that neither its jitter nor a stop turns it over. A recording starts on the side of its first
    motion.
    w is 0.01-0.5 deg; a guess.
    """

    name = "backlash"
    stage = Stage.TRANSMISSION
    places = SWEPT_JOINTS
    needs_motion = True
    requires = ("joints",)
    jumps = True

    width_rad: float = parameter("rad", 3e-3, lower=-0.5, upper=0.5)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.width_rad == 0.0:
            return signals
        angle = signals.encoder_angles[:, self.joint]
        moved = np.flatnonzero(np.abs(angle - angle[0]) > _SETTLED)
        first = np.sign(angle[moved[0]] - angle[0]) if len(moved) else 0.0
        kept = (angle - play(angle, _SETTLED, float(angle[0] - _SETTLED * first))) / _SETTLED
        travel = signals.joint_velocity[:, self.joint] * np.gradient(signals.t) * 2.0
        # in motion the velocity knows of a reversal between two samples, which their angles do not show
        side = np.where(np.abs(travel) > 2.0 * _SETTLED, np.sign(travel), kept)
        return turn_joint(signals, self.joint, -0.5 * self.width_rad * side)


@register
@dataclass(frozen=True)
class JointCompliance(Effect):
    """The joint droops under the arm's weight: q = qe - c tau_g(q) / max tau_g, c the droop.

    tau_g is the torque that holds the joint against gravity, from the arm's MuJoCo model at rest, and max tau_g the
    largest that any pose asks for, limits aside: c is the droop there, a property of the arm and not of the maneuver.
    For the A465's joint 5, which carries the tool alone, q = qe - c cos qe.

    1 mrad: the 42 N m that this model's stretched arm puts on joint 2, over 2.5-5e4 N m/rad of a size 25-32 drive
    (CSF/CSG catalogue, table 42); the model's masses are a guess.
    """

    name = "joint_compliance"
    stage = Stage.TRANSMISSION
    places = ("joint2", "joint3", "joint5")
    requires = ("joints",)

    droop_rad: float = parameter("rad", 1e-3, lower=-0.5, upper=0.5)

    @classmethod
    def places_on(cls, signals: Signals) -> tuple[str, ...]:
        """Of the A465 those of the catalogue, of another arm the joints that gravity loads."""
        if signals.arm is None or is_a465(signals):
            return cls.places if signals.q_encoder is not None else ()
        return tuple(place for place in super().places_on(signals) if is_loaded(signals.arm, int(place[5:]) - 1))

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.where == "joint5" and is_a465(signals):
            load = np.cos(signals.encoder_angles[:, self.joint])
        else:
            load = relative_gravity_torque(signals, self.joint)
        return turn_joint(signals, self.joint, -self.droop_rad * load)
