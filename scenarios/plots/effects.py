"""What an unmodelled effect of typical size does to a sweep: each channel's change over time and over a joint angle."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arm import Arm
from rig.arrays import Array, Rows
from rig.channels import CHANNELS
from rig.effects import Effect, Kind, Parameter, Stage, apply_stage
from rig.errors import RigError, unknown_name
from rig.signals import Signals
from rig.trajectory import JointTrajectory
from scenarios.colours import BLACK, BLUE, GREY, ORANGE, SKY_BLUE
from scenarios.loader import load
from scenarios.plots.style import new_figure, style

#: The sweep that the effect is shown on, and how often it is sampled [Hz].
_SCENARIO: Final = "ann-arbor"
_SAMPLING_HZ: Final = 4.0
#: A tone at exactly half the sampling rate might show nothing: it is shown beside it.
_ASIDE_HZ: Final = 0.03
_ZOOM_S: Final = 60.0
#: A parameter of more numbers than this is a series.
_SERIES: Final = 6
_BINS: Final = 36
_STILL_RAD: Final = 1e-3
_NOTHING_MV: Final = 1e-6


@dataclass(frozen=True, eq=False)
class EffectChange:
    """An effect's change of the readings on a sweep.

    Attributes:
        effect: with its typical size.
        t: (n,) [s]. q: (n, N) [rad].
        change: (n, 6) [mV] reading with the effect minus reading without, at the same noise.
        left: (n, 6) [mV] what a calibration that does not know of the effect leaves of it; None for noise and defects.
        floor: (6,) [mV] the noise floor.
    """

    effect: Effect
    t: Array
    q: Array
    change: Array
    left: Array | None
    floor: Array

    @property
    def shown(self) -> Array:
        """(n, 6) [mV] what is there to be seen."""
        return self.change if self.left is None else self.left

    @property
    def columns(self) -> list[int]:
        """The channels that change."""
        return [column for column in range(len(CHANNELS)) if np.any(np.abs(self.change[:, column]) > _NOTHING_MV)]


def effect_change(effect: type[Effect], where: str | None = None) -> EffectChange:
    """The change of an effect of typical size at a place, or at the one where most of it stays after calibration.

    Raises:
        RigError: the effect has no such place.
    """
    if effect.of_log:
        raise RigError(
            f"effect {effect.name} errs in the log of tool poses: a sweep with joint angles does not show it"
        )
    if where is not None and where not in effect.places:
        raise unknown_name(f"place of effect {effect.name}", where, effect.places)
    scenario = load(_SCENARIO)
    arm = scenario.rig.arm
    times = np.arange(int(scenario.maneuver.duration_s * _SAMPLING_HZ)) / _SAMPLING_HZ
    motion = scenario.maneuver.trajectory(times)
    if not isinstance(motion, JointTrajectory) or arm is None:
        raise RigError(f"scenario {_SCENARIO}: found no joint motion, expected a sweep")
    data = _data(arm, motion.t, motion.q)
    changes = [_change(made, data) for made in typical(effect, (where,) if where else effect.places)]
    return max(changes, key=lambda each: float(np.sum(np.square(each.shown / each.floor))))


def typical(effect: type[Effect], places: tuple[str, ...]) -> Iterator[Effect]:
    """The effect at every one of some places, and with every name it can have, strengths typical."""
    sizes = {item.name: _typical_value(item) for item in effect.parameters() if item.strength}
    if effect.tone:
        sizes["freq_Hz"] = next(item.typical for item in effect.parameters() if item.name == "freq_Hz") + _ASIDE_HZ
    choices = effect.choices()
    for place, *names in itertools.product(places, *choices.values()):
        if place not in names:
            yield effect.from_mapping({"where": place, **sizes, **dict(zip(choices, names, strict=True))})


def _typical_value(item: Parameter) -> float | tuple[float, ...]:
    """All numbers typical; of a series of many its first alone, as all together would add up to more."""
    if item.size == 1:
        return item.typical
    return (item.typical,) * item.size if item.size <= _SERIES else (item.typical, *(0.0,) * (item.size - 1))


def _data(arm: Arm, t: Array, q: Array) -> WhitenedData:
    """The sweep beside its ideal readings."""
    rig = load(_SCENARIO).rig
    start = Signals(t=t, arm=arm, q_encoder=q, temperature=rig.environment.temperature(t))
    base = rig.pipeline.expected(start, np.random.default_rng(0))
    floor = tuple(ChannelNoise(sigma**2) for sigma in rig.acquisition.noise_V)
    noisy = base.volts + np.asarray(rig.acquisition.noise_V) * np.random.default_rng(0).standard_normal(
        base.volts.shape
    )
    return WhitenedData(base, rig.pipeline, noisy, floor, np.ones_like(noisy), floor)


def _change(effect: Effect, data: WhitenedData) -> EffectChange:
    rng = np.random.default_rng(1)
    moved = replace(data.pipeline, effects=(effect,)).expected(data.base, rng)
    noise = data.readings - data.base.volts
    sampled = apply_stage((effect,), Stage.ELECTRONIC, replace(moved, volts=moved.volts + noise), rng)
    change = sampled.volts - data.readings
    left = data.left_over(change) if effect.kind is Kind.MEAN else None
    assert data.base.q_encoder is not None
    return EffectChange(
        effect=effect,
        t=data.base.t,
        q=data.base.q_encoder,
        change=1e3 * change,
        left=None if left is None else 1e3 * left,
        floor=1e3 * np.array([whitener.sigma for whitener in data.whiteners]),
    )


def telling_joint(shown: EffectChange) -> int:
    """The moving joint whose angle and direction of travel explain most of what is to be seen."""
    moving = [joint for joint in range(shown.q.shape[1]) if np.ptp(shown.q[:, joint]) > _STILL_RAD]
    values = shown.shown / shown.floor

    def explained(joint: int) -> float:
        cell, direction = _cells(shown.q[:, joint])
        index = 2 * cell + direction
        count = np.bincount(index, minlength=2 * _BINS)
        total = np.stack([np.bincount(index, column, minlength=2 * _BINS) for column in values.T])
        return float(np.sum(np.square(total)[:, count > 0] / count[count > 0]))

    return max(moving, key=explained)


def _cells(angle: Array) -> tuple[Rows, Rows]:
    """Bin of each angle, and 1 where it falls."""
    degrees = _within_a_turn(angle)
    low, high = float(degrees.min()), float(degrees.max())
    cell = np.minimum(((degrees - low) / (high - low) * _BINS).astype(np.intp), _BINS - 1)
    return cell, (np.gradient(angle) < 0).astype(np.intp)


def _within_a_turn(angle: Array) -> Array:
    degrees = np.degrees(angle)
    return np.asarray((degrees + 180.0) % 360.0 - 180.0 if np.ptp(degrees) > 540.0 else degrees)


def effect_figure(shown: EffectChange) -> Figure:
    """A row for each channel that changes: over time on the left, over the most telling joint angle on the right.

    Raises:
        RigError: nothing changes.
    """
    columns = shown.columns
    if not columns:
        raise RigError(f"effect {shown.effect.name} at {shown.effect.where}: changes nothing on the sweep")
    joint = telling_joint(shown)
    with style():
        figure = new_figure(11.0, 1.6 + 1.3 * len(columns), _title(shown))
        axes = figure.subplots(len(columns), 2, width_ratios=(2.1, 1.0), sharex="col", squeeze=False)
        for (left, right), column in zip(axes, columns, strict=True):
            _over_time(left, shown, column)
            _over_angle(right, shown, column, joint)
        axes[-1, 0].set_xlabel("time [s]")
        axes[-1, 1].set_xlabel(f"joint{joint + 1} [deg]")
        figure.align_ylabels(axes[:, 0])
        axes[0, 0].set_title("Over time" + (", from its beginning" if shown.effect.tone else ""))
        axes[0, 1].set_title("What a calibration leaves" if shown.left is not None else "Over a joint angle")
        figure.legend(handles=_legend(shown, joint), loc="outside lower center", ncols=5)
    return figure


def _over_time(axis: Axes, shown: EffectChange, column: int) -> None:
    """All of the sweep; of a tone, which would fill it, the beginning."""
    floor = float(shown.floor[column])
    end = int(_ZOOM_S * _SAMPLING_HZ) if shown.effect.tone else len(shown.t)
    rows, marker = slice(end), "." if shown.effect.tone else "None"
    axis.axhspan(-floor, floor, color=GREY, alpha=0.15, linewidth=0)
    axis.plot(shown.t[rows], shown.change[rows, column], color=SKY_BLUE, marker=marker, rasterized=True)
    if shown.left is not None:
        axis.plot(shown.t[rows], shown.left[rows, column], color=BLACK, linewidth=0.7, rasterized=True)
    axis.set_ylabel(f"{CHANNELS[column]} [mV]")
    axis.set_xlim(float(shown.t[0]), float(shown.t[rows][-1]))
    reach = 1.12 * max(float(np.abs(values[:, column]).max()) for values in (shown.change, shown.shown))
    axis.set_ylim(-reach, reach)


def _over_angle(axis: Axes, shown: EffectChange, column: int, joint: int) -> None:
    angle, values = shown.q[:, joint], shown.shown[:, column]
    _, direction = _cells(angle)
    degrees = _within_a_turn(angle)
    rare = shown.effect.kind is Kind.DISTRIBUTION
    for way, colour in ((0, BLUE), (1, ORANGE)):
        rows = (direction == way) & ((np.abs(values) > _NOTHING_MV) | (not rare))
        size = 4.0 if rare else 1.8
        axis.plot(degrees[rows], values[rows], ".", color=colour, markersize=size, markeredgewidth=0, rasterized=True)
    reach = 1.12 * max(float(np.abs(values).max()), 1e-6)
    axis.set_ylim(-reach, reach)


def _title(shown: EffectChange) -> str:
    effect = shown.effect
    units = {item.name: "" if item.unit == "relative" else f" {item.unit}" for item in effect.parameters()}
    sizes = []
    for name in (item.name for item in fields(effect) if item.name != "where"):
        value = getattr(effect, name)
        if isinstance(value, tuple):
            numbers = f"{value[0]:g} each" if len(set(value)) == 1 else ", ".join(f"{number:g}" for number in value[:3])
            text = f"({numbers}{', ..' if len(value) > 3 and len(set(value)) > 1 else ''}){units[name]}"
        else:
            text = f"{value:g}{units[name]}" if isinstance(value, float) else str(value)
        sizes.append(f"{name} {text}")
    return f"{effect.name} at {effect.where}: {', '.join(sizes)}"


def _legend(shown: EffectChange, joint: int) -> list[Line2D]:
    handles = [Line2D([], [], color=SKY_BLUE, linewidth=2, label="change of the reading")]
    if shown.left is not None:
        handles.append(Line2D([], [], color=BLACK, label="what a calibration leaves of it"))
    handles.append(Line2D([], [], color=GREY, alpha=0.3, linewidth=7, label="noise floor, ±σ"))
    ways = {0: ("rising", BLUE), 1: ("falling", ORANGE)}
    _, direction = _cells(shown.q[:, joint])
    for way in sorted(set(direction.tolist())):
        words, colour = ways[way]
        handles.append(Line2D([], [], color=colour, linewidth=2, label=f"joint{joint + 1} {words}"))
    return handles
