"""Effects that are in no catalogue: whatever names one of them with confidence is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from typing_extensions import override

from rig.channels import CHANNELS
from rig.effects import Effect, Stage
from rig.effects.field import with_field
from rig.effects.transmission import turn_joint
from rig.sensor import Triple
from rig.signals import Signals
from validation.blind.draws import scaled, unit
from validation.blind.outside_slow import SLOW
from validation.blind.settings import Setting
from validation.blind.strength import Make


@dataclass(frozen=True)
class CablePull(Effect):
    """A stiff cable along the arm pulls at the pitch joint as the yaw joint winds it: third and fifth harmonic of
    q1."""

    name = "cable_pull"
    stage = Stage.TRANSMISSION
    places = ("joint5",)

    pull_rad: float
    phases: tuple[float, float]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        yaw = signals.encoder_angles[:, 0]
        pull = np.sin(3.0 * yaw + self.phases[0]) + 0.5 * np.sin(5.0 * yaw + self.phases[1])
        return turn_joint(signals, self.joint, self.pull_rad * pull)


@dataclass(frozen=True)
class ThermalBending(Effect):
    """The forearm warms from one side and bends: a turn about an axis fixed in link 3, in proportion to T - 22 degC."""

    name = "thermal_bending"
    stage = Stage.POSE
    places = ("link3",)

    bend_rad_per_degC: float
    axis: Triple

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        in_base = signals.link_rotation(2) @ np.asarray(self.axis)
        angle = self.bend_rad_per_degC * (signals.temperatures - 22.0)
        turn = Rotation.from_rotvec(angle[:, None] * in_base).as_matrix()
        return replace(signals, R_base_tool=turn @ signals.R_base_tool)


@dataclass(frozen=True)
class MovingMagnet(Effect):
    """Somebody parks a trolley, and takes it away again: a field fixed in the base, there in some intervals."""

    name = "moving_magnet"
    stage = Stage.FIELD
    places = ("base",)

    field: Triple
    switched_s: tuple[float, ...]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        there = np.searchsorted(self.switched_s, signals.t) % 2
        return with_field(signals, there[:, None] * np.asarray(self.field))


@dataclass(frozen=True)
class DailyField(Effect):
    """The surrounding field swings, as beside an electric railway: b sin(2 pi t/P + p), fixed in the base."""

    name = "daily_field"
    stage = Stage.FIELD
    places = ("base",)

    field: Triple
    period_s: float
    phase: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        wave = np.sin(2.0 * np.pi * signals.t / self.period_s + self.phase)
        return with_field(signals, wave[:, None] * np.asarray(self.field))


@dataclass(frozen=True)
class PassingLift(Effect):
    """A lift goes by several times: Gaussian pulses of field, fixed in the base."""

    name = "passing_lift"
    stage = Stage.FIELD
    places = ("base",)

    field: Triple
    at_s: tuple[float, ...]
    width_s: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        since = (signals.t[:, None] - np.asarray(self.at_s)) / self.width_s
        return with_field(signals, np.exp(-0.5 * since**2).sum(axis=1)[:, None] * np.asarray(self.field))


@dataclass(frozen=True)
class ReversalRinging(Effect):
    """A soft stand rings after every reversal of the yaw joint: a second-order resonance, as an error of joint 1."""

    name = "reversal_ringing"
    stage = Stage.TRANSMISSION
    places = ("joint1",)

    amplitude_rad: float
    frequency_Hz: float
    decay_s: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        direction = np.sign(signals.joint_velocity[:, 0])
        turned = np.flatnonzero(np.diff(direction) != 0)
        last = np.searchsorted(turned, np.arange(len(signals)), side="left") - 1
        since = signals.t - np.where(last >= 0, signals.t[turned[np.maximum(last, 0)]], np.inf)
        ringing = np.zeros(len(signals))
        rung = last >= 0
        phase = 2.0 * np.pi * self.frequency_Hz * since[rung]
        ringing[rung] = np.exp(-since[rung] / self.decay_s) * np.sin(phase) * direction[rung]
        return turn_joint(signals, self.joint, self.amplitude_rad * ringing)


@dataclass(frozen=True)
class GainSwitching(Effect):
    """An amplifier changes its range now and then: V (1 + e) in some intervals."""

    name = "gain_switching"
    stage = Stage.VOLTS
    places = CHANNELS

    change: float
    switched_s: tuple[float, ...]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        volts = signals.volts.copy()
        volts[:, self.columns] *= 1.0 + self.change * (np.searchsorted(self.switched_s, signals.t) % 2)[:, None]
        return replace(signals, volts=volts)


@dataclass(frozen=True)
class CrossAxisProduct(Effect):
    """One axis feels the product of the two others: x_k + a x_i x_j / X."""

    name = "cross_axis_product"
    stage = Stage.INPUT
    places = CHANNELS

    fraction: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        own = CHANNELS.index(self.where)
        first = own - own % 3
        i, j = (column for column in range(first, first + 3) if column != own)
        inputs = signals.inputs.copy()
        inputs[:, own] += self.fraction * inputs[:, i] * inputs[:, j] / signals.references[own]
        return replace(signals, inputs=inputs)


@dataclass(frozen=True)
class BearingWobble(Effect):
    """An oval roll bearing nods the tool twice a turn: an error of joint 5 with 2 q6."""

    name = "bearing_wobble"
    stage = Stage.TRANSMISSION
    places = ("joint5",)

    amplitude_rad: float
    phase: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        roll = signals.encoder_angles[:, 5]
        return turn_joint(signals, self.joint, self.amplitude_rad * np.sin(2.0 * roll + self.phase))


@dataclass(frozen=True)
class ClockDrift(Effect):
    """The board's clock runs slow beside the arm's: the reading at t belongs to t - e (t - t_middle)."""

    name = "clock_drift"
    stage = Stage.INPUT
    places = ("acquisition",)

    drift: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        middle = 0.5 * (signals.t[0] + signals.t[-1])
        at = np.clip(signals.t - self.drift * (signals.t - middle), signals.t[0], signals.t[-1])
        return replace(signals, inputs=CubicSpline(signals.t, signals.inputs, axis=0)(at))


def _switches(rng: np.random.Generator, setting: Setting) -> tuple[float, ...]:
    count = 2 * int(rng.integers(2, 5))
    return tuple(sorted(float(at) for at in rng.uniform(0.05, 0.95, count) * setting.maneuver.duration_s))


def _cable(rng: np.random.Generator, setting: Setting) -> Make:
    phases = (float(rng.uniform(0.0, 6.28)), float(rng.uniform(0.0, 6.28)))
    return lambda strength: CablePull("joint5", 1e-3 * strength, phases)


def _bending(rng: np.random.Generator, setting: Setting) -> Make:
    axis = scaled(unit(rng), 1.0)
    return lambda strength: ThermalBending("link3", 1e-3 * strength, axis)


def _magnet(rng: np.random.Generator, setting: Setting) -> Make:
    direction, switched = unit(rng), _switches(rng, setting)
    return lambda strength: MovingMagnet("base", scaled(direction, 0.01 * strength), switched)


def _daily(rng: np.random.Generator, setting: Setting) -> Make:
    direction, phase = unit(rng), float(rng.uniform(0.0, 6.28))
    period = float(setting.maneuver.duration_s * rng.uniform(0.15, 0.5))
    return lambda strength: DailyField("base", scaled(direction, 0.01 * strength), period, phase)


def _lift(rng: np.random.Generator, setting: Setting) -> Make:
    direction, width = unit(rng), float(rng.uniform(4.0, 12.0))
    at = tuple(float(each) for each in rng.uniform(0.05, 0.95, int(rng.integers(4, 9))) * setting.maneuver.duration_s)
    return lambda strength: PassingLift("base", scaled(direction, 0.02 * strength), at, width)


def _ringing(rng: np.random.Generator, setting: Setting) -> Make:
    frequency, decay = float(rng.uniform(0.1, 0.4)), float(rng.uniform(6.0, 15.0))
    return lambda strength: ReversalRinging("joint1", 3e-3 * strength, frequency, decay)


def _gain(rng: np.random.Generator, setting: Setting) -> Make:
    where, switched = str(rng.choice(CHANNELS)), _switches(rng, setting)
    sign = float(rng.choice([-1.0, 1.0]))
    return lambda strength: GainSwitching(where, 3e-3 * sign * strength, switched)


def _product(rng: np.random.Generator, setting: Setting) -> Make:
    where, sign = str(rng.choice(CHANNELS)), float(rng.choice([-1.0, 1.0]))
    return lambda strength: CrossAxisProduct(where, 3e-3 * sign * strength)


def _wobble(rng: np.random.Generator, setting: Setting) -> Make:
    phase = float(rng.uniform(0.0, 6.28))
    return lambda strength: BearingWobble("joint5", 1e-3 * strength, phase)


def _clock(rng: np.random.Generator, setting: Setting) -> Make:
    sign = float(rng.choice([-1.0, 1.0]))
    return lambda strength: ClockDrift("acquisition", 3e-5 * sign * strength)


#: By name: everything drawn but the strength, which is typical at one.
OUTSIDE: Final[dict[str, Callable[[np.random.Generator, Setting], Make]]] = {
    "cable_pull": _cable,
    "thermal_bending": _bending,
    "moving_magnet": _magnet,
    "daily_field": _daily,
    "passing_lift": _lift,
    "reversal_ringing": _ringing,
    "gain_switching": _gain,
    "cross_axis_product": _product,
    "bearing_wobble": _wobble,
    "clock_drift": _clock,
    **SLOW,
}

#: Of these, those that need the joints, or that a tracker of the tool would see.
JOINTED: Final = (
    "cable_pull",
    "thermal_bending",
    "reversal_ringing",
    "bearing_wobble",
    "slip_ring",
    "loaded_supply",
    "cable_drag",
    "settling_floor",
)
