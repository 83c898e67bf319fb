"""Effects of the catalogue's families in another functional form than the catalogue's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import lfilter
from typing_extensions import override

from rig.arrays import Array
from rig.channels import CHANNELS, SENSORS
from rig.effects import EFFECTS, Effect, Kind, Stage
from rig.effects.base import SWEPT_JOINTS
from rig.effects.drift import with_volts
from rig.effects.field import with_field
from rig.effects.sensor import with_inputs
from rig.effects.transmission import turn_joint
from rig.sensor import Triple
from rig.signals import Signals
from validation.blind.draws import near, scaled, unit
from validation.blind.settings import Setting
from validation.blind.strength import Make


def play(x: Array, half_width: float) -> Array:
    """The play operator sample by sample, from the middle of the play."""
    y = np.empty_like(x)
    last = x[0]
    for row, value in enumerate(x):
        last = min(max(last, value - half_width), value + half_width)
        y[row] = last
    return y


@dataclass(frozen=True)
class SoftBacklash(Effect):
    """Backlash that friction takes up little by little: q - (w/2) tanh(v/v0), v0 half of the usual speed."""

    name = "soft_backlash"
    stage = Stage.TRANSMISSION
    places = SWEPT_JOINTS

    width: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        speed = signals.joint_velocity[:, self.joint]
        usual = float(np.median(np.abs(speed))) + 1e-9
        return turn_joint(signals, self.joint, -0.5 * self.width * np.tanh(2.0 * speed / usual))


@dataclass(frozen=True)
class TwoDipoles(Effect):
    """Two pieces of steel instead of one: the sum of two dipoles some centimetres apart."""

    name = "two_dipoles"
    stage = Stage.FIELD
    places = ("base",)

    positions: tuple[Triple, Triple]
    moments: tuple[Triple, Triple]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        total = np.zeros_like(signals.position)
        for position, moment in zip(self.positions, self.moments, strict=True):
            way = signals.position - np.asarray(position)
            distance = np.linalg.norm(way, axis=1, keepdims=True)
            towards = way / distance
            total += (3.0 * towards * (towards @ np.asarray(moment))[:, None] - np.asarray(moment)) / distance**3
        return with_field(signals, total)


@dataclass(frozen=True)
class StiffeningSpring(Effect):
    """A joint that droops less the more it is loaded: q5 - c L / sqrt(1 + (2 L)^2), L the relative load cos q5."""

    name = "stiffening_spring"
    stage = Stage.TRANSMISSION
    places = ("joint5",)

    droop: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        load = np.cos(signals.encoder_angles[:, 4])
        return turn_joint(signals, self.joint, -self.droop * load / np.sqrt(1.0 + 4.0 * load**2))


@dataclass(frozen=True)
class SecondOrderLag(Effect):
    """A Butterworth low-pass of second order instead of one of first order, by the bilinear transform."""

    name = "second_order_lag"
    stage = Stage.VOLTS
    places = SENSORS

    tau: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        step = float(signals.t[1] - signals.t[0])
        k = 2.0 * self.tau / step
        a0, a1, a2 = 1.0 + np.sqrt(2.0) * k + k * k, 2.0 - 2.0 * k * k, 1.0 - np.sqrt(2.0) * k + k * k
        volts = signals.volts.copy()
        values = volts[:, self.columns]
        first = values[0]
        volts[:, self.columns] = first + lfilter([1.0, 2.0, 1.0], [a0, a1, a2], values - first, axis=0)
        return replace(signals, volts=volts)


@dataclass(frozen=True)
class TwoHarmonics(Effect):
    """An eccentric disc that is oval too: A (sin(q + p) + 0.3 sin(2 q + r))."""

    name = "two_harmonics"
    stage = Stage.TRANSMISSION
    places = SWEPT_JOINTS

    amplitude: float
    phases: tuple[float, float]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        angle = signals.encoder_angles[:, self.joint]
        wave = np.sin(angle + self.phases[0]) + 0.3 * np.sin(2.0 * angle + self.phases[1])
        return turn_joint(signals, self.joint, self.amplitude * wave)


@dataclass(frozen=True)
class TwoStageWarmup(Effect):
    """A board that warms in two stages: c (0.7 exp(-t/tau) + 0.3 exp(-t/(6 tau)))."""

    name = "two_stage_warmup"
    stage = Stage.VOLTS
    places = SENSORS

    volt: Triple
    tau: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        decay = 0.7 * np.exp(-signals.t / self.tau) + 0.3 * np.exp(-signals.t / (6.0 * self.tau))
        return with_volts(signals, self.columns, np.outer(decay, self.volt))


@dataclass(frozen=True)
class CurvedTemperature(Effect):
    """An offset that follows the temperature with a curvature: c (d + 0.1 d^2), d = T - 25 degC."""

    name = "curved_temperature"
    stage = Stage.VOLTS
    places = SENSORS

    volt: Triple

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        warmth = signals.temperatures - 25.0
        return with_volts(signals, self.columns, np.outer(warmth + 0.1 * warmth**2, self.volt))


@dataclass(frozen=True)
class ManyPlays(Effect):
    """Hysteresis as real materials have it: the mean of plays of many widths (a Prandtl-Ishlinskii operator)."""

    name = "many_plays"
    stage = Stage.INPUT
    places = CHANNELS

    half_width: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        column = CHANNELS.index(self.where)
        width = self.half_width * signals.references[column]
        x = signals.inputs[:, column]
        held = np.mean([play(x, share * width) for share in (0.25, 0.75, 1.25, 1.75)], axis=0)
        return with_inputs(signals, self.columns, held[:, None])


@dataclass(frozen=True)
class SlowStep(Effect):
    """A step that takes its time: volts / (1 + exp(-(t - at)/tau))."""

    name = "slow_step"
    stage = Stage.VOLTS
    places = CHANNELS

    volt: float
    at: float
    tau: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        logistic = 0.5 * (1.0 + np.tanh(0.5 * (signals.t - self.at) / self.tau))
        return with_volts(signals, self.columns, self.volt * logistic[:, None])


@dataclass(frozen=True)
class ViscousMotor(Effect):
    """A motor's field that grows with the speed on top of the friction: h (sgn v + 0.5 v / max v)."""

    name = "viscous_motor"
    stage = Stage.FIELD
    places = ("joint1", "joint5")

    field: Triple

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        speed = signals.joint_velocity[:, self.joint]
        drive = np.sign(speed) * (np.abs(speed) > 1e-4) + 0.5 * speed / np.abs(speed).max()
        link = 0 if self.where == "joint1" else 3
        return with_field(signals, drive[:, None] * (signals.link_rotation(link) @ np.asarray(self.field)))


@dataclass(frozen=True)
class Flicker(Effect):
    """Nearly 1/f noise: Ornstein-Uhlenbeck processes a decade apart in time, of one variance."""

    name = "flicker"
    stage = Stage.ELECTRONIC
    kind = Kind.NOISE
    places = SENSORS

    sigma: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        for tau in (0.5, 5.0, 50.0):
            part = EFFECTS["noise_coloured"].from_mapping(
                {"where": self.where, "sigma_V": (self.sigma,) * 3, "tau_s": tau}
            )
            signals = part.apply(signals, rng)
        return signals

    @override
    def added_spectrum(self, frequency: Array, interval_s: float) -> Array:
        total = np.zeros_like(frequency)
        for tau in (0.5, 5.0, 50.0):
            decay = np.exp(-interval_s / tau)
            total += (1.0 - decay**2) / (1.0 - 2.0 * decay * np.cos(2.0 * np.pi * frequency) + decay**2)
        return self.sigma**2 * total


def _dipoles(rng: np.random.Generator, setting: Setting) -> Make:
    first = np.asarray(near(rng, setting)["position_m"])
    places = (scaled(first, 1.0), scaled(first + 0.1 * unit(rng), 1.0))
    one, other = 2e-4 * unit(rng), 2e-4 * unit(rng)
    return lambda strength: TwoDipoles("base", places, (scaled(one, strength), scaled(other, strength)))


def _joint(rng: np.random.Generator) -> str:
    return str(rng.choice(["joint1", "joint5"]))


def _play(rng: np.random.Generator, setting: Setting) -> Make:
    where = _joint(rng)
    return lambda strength: SoftBacklash(where, 3e-3 * strength)


def _spring(rng: np.random.Generator, setting: Setting) -> Make:
    return lambda strength: StiffeningSpring("joint5", 2e-3 * strength)


def _lag(rng: np.random.Generator, setting: Setting) -> Make:
    where = str(rng.choice(SENSORS))
    return lambda strength: SecondOrderLag(where, 0.05 * strength)


def _harmonics(rng: np.random.Generator, setting: Setting) -> Make:
    where = str(rng.choice(SWEPT_JOINTS))
    phases = (float(rng.uniform(0.0, 6.28)), float(rng.uniform(0.0, 6.28)))
    return lambda strength: TwoHarmonics(where, 1e-3 * strength, phases)


def _warmup(rng: np.random.Generator, setting: Setting) -> Make:
    where, drawn = str(rng.choice(SENSORS)), rng.standard_normal(3)
    tau = float(np.exp(rng.uniform(np.log(40.0), np.log(200.0))))
    return lambda strength: TwoStageWarmup(where, scaled(drawn, 5e-3 * strength), tau)


def _temperature(rng: np.random.Generator, setting: Setting) -> Make:
    where, drawn = str(rng.choice(SENSORS)), rng.standard_normal(3)
    return lambda strength: CurvedTemperature(where, scaled(drawn, 1e-3 * strength))


def _hysteresis(rng: np.random.Generator, setting: Setting) -> Make:
    where = str(rng.choice(CHANNELS))
    return lambda strength: ManyPlays(where, 2e-3 * strength)


def _step(rng: np.random.Generator, setting: Setting) -> Make:
    where, sign = str(rng.choice(CHANNELS)), float(rng.choice([-1.0, 1.0]))
    at, tau = float(rng.uniform(0.15, 0.85) * setting.maneuver.duration_s), float(rng.uniform(3.0, 15.0))
    return lambda strength: SlowStep(where, 5e-3 * sign * strength, at, tau)


def _motor(rng: np.random.Generator, setting: Setting) -> Make:
    where, direction = _joint(rng), unit(rng)
    return lambda strength: ViscousMotor(where, scaled(direction, 5e-3 * strength))


def _flicker(rng: np.random.Generator, setting: Setting) -> Make:
    where = str(rng.choice(SENSORS))
    return lambda strength: Flicker(where, 3e-3 * strength)


Form = tuple[tuple[str, ...], Callable[[np.random.Generator, Setting], Make]]

#: By name: the effects of the catalogue that are its family, at the same place, and everything drawn but the strength.
FORMS: Final[dict[str, Form]] = {
    "soft_backlash": (("backlash",), _play),
    "two_dipoles": (("base_dipole",), _dipoles),
    "stiffening_spring": (("joint_compliance",), _spring),
    "second_order_lag": (("sensor_lag",), _lag),
    "two_harmonics": (("joint_eccentricity",), _harmonics),
    "two_stage_warmup": (("bias_warmup",), _warmup),
    "curved_temperature": (("bias_temperature",), _temperature),
    "many_plays": (("hysteresis",), _hysteresis),
    "slow_step": (("bias_step",), _step),
    "viscous_motor": (("motor_current_field",), _motor),
    "flicker": (("noise_coloured", "bias_random_walk"), _flicker),
}
