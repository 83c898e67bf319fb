"""Further effects that are in no catalogue: of the building, the cables and the ageing of things."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from typing_extensions import override

from rig.channels import CHANNELS
from rig.effects import Effect, Stage
from rig.effects.drift import with_volts
from rig.effects.field import with_field
from rig.effects.sensor import with_inputs
from rig.effects.transmission import turn_joint
from rig.sensor import Triple
from rig.signals import Signals
from validation.blind.draws import scaled, unit
from validation.blind.settings import Setting
from validation.blind.strength import Make


@dataclass(frozen=True)
class SettlingFloor(Effect):
    """The floor gives way under the arm: the base turns about an axis of its own with log(1 + t/tau)."""

    name = "settling_floor"
    stage = Stage.POSE
    places = ("base",)

    turn_rad: Triple
    tau_s: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        way = np.log1p((signals.t - signals.t[0]) / self.tau_s)
        turn = Rotation.from_rotvec(way[:, None] * np.asarray(self.turn_rad)).as_matrix()
        return replace(signals, R_base_tool=turn @ signals.R_base_tool)


@dataclass(frozen=True)
class CreepingMount(Effect):
    """Tape that holds the sensor creeps to and fro: a turn of the tool that wanders smoothly, on six slow sines."""

    name = "creeping_mount"
    stage = Stage.POSE
    places = ("mount",)
    on_mount = True

    turns_rad: tuple[Triple, ...]
    phases: tuple[float, ...]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        share = (signals.t - signals.t[0]) / (signals.t[-1] - signals.t[0])
        waves = [np.sin(np.pi * (k + 1.5) * share + phase) / (k + 1.5) for k, phase in enumerate(self.phases)]
        turn = Rotation.from_rotvec(np.stack(waves, axis=1) @ np.asarray(self.turns_rad)).as_matrix()
        return replace(signals, R_base_tool=signals.R_base_tool @ turn)


@dataclass(frozen=True)
class TelegraphOffset(Effect):
    """A bad contact: one channel's offset jumps between two values again and again."""

    name = "telegraph_offset"
    stage = Stage.VOLTS
    places = CHANNELS

    size: float
    switched_s: tuple[float, ...]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        jumped = np.asarray(np.searchsorted(self.switched_s, signals.t) % 2, dtype=float)
        return with_volts(signals, self.columns, self.size * jumped[:, None])


@dataclass(frozen=True)
class WarmingMagnet(Effect):
    """A magnet near the arm weakens as the room warms: a field fixed in the base, in proportion to T - 22 degC."""

    name = "warming_magnet"
    stage = Stage.FIELD
    places = ("base",)

    field_per_degC: Triple

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        warmth = (signals.temperatures - 22.0)[:, None]
        return with_field(signals, warmth * np.asarray(self.field_per_degC))


@dataclass(frozen=True)
class Turntable(Effect):
    """A turntable with a magnet on it: a field that turns about the vertical, at its own slow pace."""

    name = "turntable"
    stage = Stage.FIELD
    places = ("base",)

    size: float
    period_s: float
    phase: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        angle = 2.0 * np.pi * signals.t / self.period_s + self.phase
        return with_field(signals, self.size * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))


@dataclass(frozen=True)
class SlipRing(Effect):
    """A worn slip ring adds a voltage that repeats with the yaw joint: A sin(2 q1 + p) + A/2 sin(7 q1)."""

    name = "slip_ring"
    stage = Stage.VOLTS
    places = CHANNELS

    size: float
    phase: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        yaw = signals.encoder_angles[:, 0]
        worn = np.sin(2.0 * yaw + self.phase) + 0.5 * np.sin(7.0 * yaw)
        return with_volts(signals, self.columns, self.size * worn[:, None])


@dataclass(frozen=True)
class AgeingGain(Effect):
    """One axis loses sensitivity with the root of time, as a magnetised part relaxes."""

    name = "ageing_gain"
    stage = Stage.INPUT
    places = CHANNELS

    loss: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        share = (signals.t - signals.t[0]) / (signals.t[-1] - signals.t[0])
        kept = 1.0 - self.loss * np.sqrt(share)[:, None]
        return with_inputs(signals, self.columns, kept * signals.inputs[:, self.columns])


@dataclass(frozen=True)
class LoadedSupply(Effect):
    """The supply gives way when a joint holds a load: all volts times 1 - c max(0, cos q5)^2."""

    name = "loaded_supply"
    stage = Stage.VOLTS
    places = ("supply",)

    drop: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        load = np.maximum(np.cos(signals.encoder_angles[:, 4]), 0.0) ** 2
        return replace(signals, volts=signals.volts * (1.0 - self.drop * load)[:, None])


@dataclass(frozen=True)
class CableDrag(Effect):
    """A cable that sticks drags the pitch joint: it follows the yaw joint only beyond half a radian of play."""

    name = "cable_drag"
    stage = Stage.TRANSMISSION
    places = ("joint5",)

    share: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        yaw, last = signals.encoder_angles[:, 0], 0.0
        stuck = np.empty_like(yaw)
        for row, angle in enumerate(yaw):
            last = min(max(last, angle - 0.5), angle + 0.5)
            stuck[row] = angle - last
        return turn_joint(signals, self.joint, self.share * stuck)


def _settling(rng: np.random.Generator, setting: Setting) -> Make:
    axis, tau = unit(rng) * (1.0, 1.0, 0.1), float(setting.maneuver.duration_s * rng.uniform(0.01, 0.1))
    return lambda strength: SettlingFloor("base", scaled(axis, 1e-3 * strength), tau)


def _creeping(rng: np.random.Generator, setting: Setting) -> Make:
    axes, phases = rng.standard_normal((6, 3)), tuple(float(each) for each in rng.uniform(0.0, 6.28, 6))
    return lambda strength: CreepingMount("mount", tuple(scaled(axis, 1e-3 * strength) for axis in axes), phases)


def _telegraph(rng: np.random.Generator, setting: Setting) -> Make:
    where, count = str(rng.choice(CHANNELS)), 2 * int(rng.integers(4, 20))
    at = tuple(sorted(float(each) for each in rng.uniform(0.02, 0.98, count) * setting.maneuver.duration_s))
    return lambda strength: TelegraphOffset(where, 3e-3 * strength, at)


def _warming(rng: np.random.Generator, setting: Setting) -> Make:
    direction = unit(rng)
    return lambda strength: WarmingMagnet("base", scaled(direction, 2e-3 * strength))


def _turntable(rng: np.random.Generator, setting: Setting) -> Make:
    period, phase = float(setting.maneuver.duration_s * rng.uniform(0.1, 0.6)), float(rng.uniform(0.0, 6.28))
    return lambda strength: Turntable("base", 5e-3 * strength, period, phase)


def _ring(rng: np.random.Generator, setting: Setting) -> Make:
    where, phase = str(rng.choice(CHANNELS)), float(rng.uniform(0.0, 6.28))
    return lambda strength: SlipRing(where, 3e-3 * strength, phase)


def _ageing(rng: np.random.Generator, setting: Setting) -> Make:
    where = str(rng.choice(CHANNELS))
    return lambda strength: AgeingGain(where, 3e-3 * strength)


def _loaded(rng: np.random.Generator, setting: Setting) -> Make:
    return lambda strength: LoadedSupply("supply", 2e-3 * strength)


def _drag(rng: np.random.Generator, setting: Setting) -> Make:
    sign = float(rng.choice([-1.0, 1.0]))
    return lambda strength: CableDrag("joint5", 2e-3 * sign * strength)


#: By name: everything drawn but the strength, which is typical at one.
SLOW: Final[dict[str, Callable[[np.random.Generator, Setting], Make]]] = {
    "settling_floor": _settling,
    "creeping_mount": _creeping,
    "telegraph_offset": _telegraph,
    "warming_magnet": _warming,
    "turntable": _turntable,
    "slip_ring": _ring,
    "ageing_gain": _ageing,
    "loaded_supply": _loaded,
    "cable_drag": _drag,
}
