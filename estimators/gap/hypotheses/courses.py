"""The courses along which an error source can be off: functions of time, of the arm's pose and motion, of a level."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array, Rows
from rig.effects._numerics import curvature, low_passed, play
from rig.effects.transmission import smooth_sign

#: A joint whose angle varies less [rad] is locked.
LOCKED: Final = 0.05
#: Cosines of time, and harmonics of a joint's angle.
COSINES: Final = 96
ORDERS: Final = 3
#: Harmonics of it where an error is one of a place: a track that is worn, a tooth, a bump. Alike to about this order.
_FINE, _ALIKE = 32, 8.0
#: Cosines over the range of a joint's speed; share of its highest below which it is at rest; share of the time that an
#: arm at least moves, and stands still, where that is a course.
_SPEEDS, _AT_REST, _SOME = 6, 0.02, 0.05
#: Half-widths of plays, as shares of the range of what they follow.
_WIDTHS: Final = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
#: Time constants of a memory that fades, as shares of the recording; two samples at least.
_FADES: Final = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
#: The course of an offset that follows such a memory of its own level.
FADING: Final = "the fading memory of its level"
#: Poses further apart [rad] than this are single ones, and so are fewer than this of them: they tell no speed.
_FAR_APART: Final = 0.5
_SERIES: Final = 8


@dataclass(frozen=True)
class Course:
    """A family of functions that a source can follow.

    Attributes:
        name: what it follows.
        values: (n, k) functions. weight: (k,) their prior standard deviations, up to a common factor.
    """

    name: str
    values: Array
    weight: Array


def in_time(course: str) -> bool:
    """Whether a course, by its name, is one in time alone."""
    repeats = course.startswith(("a sine of ", "every ")) and course.endswith((" Hz", " s"))
    return course.startswith("time") or repeats


def courses(data: WhitenedData) -> Iterator[tuple[Course, frozenset[str]]]:
    """What sources can follow besides time, and which kinds of source do.

    What may be simple has a course of its own beside the one that holds more: the evidence of a simple error is not to
    pay for functions that it does not need.
    """
    every = frozenset({"angle", "clock", "turn", "field", "offset", "gain"})
    base = data.base
    # a clock knows the time and how warm it is; where only poses are known, an error along their path is one of a clock
    posed = every if base.q_encoder is None else every - {"clock"}
    lasting = every - {"offset", "gain"}  # of these, the calibration takes what is constant
    yield Course("time, throughout", np.ones((len(base), 1)), np.ones(1)), lasting
    if (q := base.q_encoder) is not None:
        for joint in np.flatnonzero(np.std(np.unwrap(q, axis=0), axis=0) > LOCKED):
            angles = [order * q[:, joint] for order in range(1, ORDERS + 1)]
            waves = np.stack([wave(angle) for angle in angles for wave in (np.cos, np.sin)], axis=1)
            weight = np.repeat(falling(ORDERS), 2)
            yield Course(f"the angle of joint{joint + 1}, once a turn", waves[:, :2], np.ones(2)), posed
            yield Course(f"the angle of joint{joint + 1}", waves, weight), posed
            if (orders := _orders_seen(q[:, joint])) > ORDERS:
                yield Course(f"the angle of joint{joint + 1}, place by place", *_places(q[:, joint], orders)), posed
            direction = smooth_sign(base.joint_velocity[:, [joint]])
            if np.std(direction) > 0.1:
                both = direction * np.column_stack([np.ones(len(q)), waves[:, :2]])
                yield Course(f"the direction of joint{joint + 1}", direction, np.ones(1)), posed
                name = f"the direction and angle of joint{joint + 1}"
                yield Course(name, both, np.array([1.0, 0.5, 0.5])), posed
            speed = base.joint_velocity[:, joint]
            if np.std(speed) > 0.1 * np.sqrt(np.mean(speed**2)):  # a steady one is nothing to follow
                moved = [_of_size_one(each) for each in (speed, _slope(data, speed))]
                yield Course(f"speed and acceleration of joint{joint + 1}", np.column_stack(moved), np.ones(2)), posed
                square = _of_size_one(speed**2)[:, None]  # what shakes, or pulls outwards
                yield Course(f"the square of joint{joint + 1}'s speed", square, np.ones(1)), posed
                name = f"how fast joint{joint + 1} turns"
                yield Course(name, any_of(np.abs(speed)), falling(_SPEEDS)), posed
        turns = np.abs(base.joint_velocity)
        moving = np.any(turns > _AT_REST * turns.max(axis=0, initial=1e-300), axis=1)
        if _SOME < np.mean(moving) < 1.0 - _SOME:  # drives that are on, brakes that are open
            yield Course("whether the arm moves", moving[:, None].astype(float), np.ones(1)), posed
    elements = base.R_base_tool.reshape(-1, 9)
    both = np.column_stack([elements, _products(elements[:, [0, 1, 2, 6, 7, 8]])])
    yield Course("orientation, to first order", elements, np.ones(9)), posed
    yield Course("orientation", both, np.ones(both.shape[1])), posed
    if np.ptp(base.t) > 0.0:
        steady = ((base.t - base.t.mean()) / np.std(base.t))[:, None]
        yield Course("time, steadily", steady, np.ones(1)), every
        yield Course("time, steadily from a start", *_beside_constant(steady, np.ones(1))), lasting
    rate, bent = _turning(data)
    if rate.any():
        both = np.column_stack([_of_size_one(each) for each in (rate, bent)])
        yield Course("how fast the tool turns", both, np.ones(both.shape[1])), posed
    if len(data.parts) > 1:
        which = np.zeros((len(base), len(data.parts)))
        for number, own in enumerate(data.stretches[: len(data.parts)]):
            which[own, number] = 1.0
        yield Course("the recording", which, np.ones(len(data.parts))), every
    if base.position.size:
        centred = base.position - base.position.mean(axis=0)
        place = centred / np.maximum(np.sqrt(np.mean(centred**2, axis=0)), 1e-9)
        moved = place[:, np.ptp(base.position, axis=0) > 1e-3]
        if moved.shape[1]:
            both = np.column_stack([moved, _products(moved)])
            weight = np.concatenate([np.ones(moved.shape[1]), np.full(both.shape[1] - moved.shape[1], 0.5)])
            yield Course("position, to first order", moved, np.ones(moved.shape[1])), frozenset({"field"})
            yield Course("position", both, weight), frozenset({"field"})
    if base.temperature is not None and np.ptp(base.temperature) > 0:
        warm = (base.temperature - base.temperature.mean()) / np.std(base.temperature)
        both, weight = np.column_stack([warm, warm**2]), np.array([1.0, 0.3])
        yield Course("temperature", both, weight), every
        yield Course("temperature, from a reference", *_beside_constant(both, weight)), lasting


def _beside_constant(values: Array, weight: Array) -> tuple[Array, Array]:
    """Functions (n, k) beside a constant: what drifts is zero where it began, seldom on average."""
    return np.column_stack([np.ones(len(values)), values]), np.concatenate([[1.0], weight])


def any_of(size: Array) -> Array:
    """(n, k) cosines over the range of a size (n,): any smooth function of it, a step too."""
    return np.cos(np.pi * np.outer(size / max(float(size.max()), 1e-300), np.arange(1, _SPEEDS + 1)))


def falling(count: int) -> Array:
    """(k,) prior standard deviations of functions, each less than the one before."""
    return np.asarray(1.0 / np.arange(1.0, count + 1.0))


def _orders_seen(angle: Array) -> int:
    """Harmonics of a joint's angle (n,) that outlive the means, of which each is over what the joint turns till the
    next one."""
    step = float(np.quantile(np.abs(np.diff(np.unwrap(angle))), 0.9)) if len(angle) > 1 else np.inf
    return int(min(_FINE, 2.0 / max(step, 1e-9)))


def _places(angle: Array, most: int) -> tuple[Array, Array]:
    """(n, 2 most) harmonics of a joint's angle (n,), and their weights: a process of short memory along it."""
    orders = np.arange(1.0, most + 1.0)
    turned = np.outer(angle, orders)
    return np.column_stack([np.cos(turned), np.sin(turned)]), np.tile(1.0 / (1.0 + (orders / _ALIKE) ** 2), 2)


def _slope(data: WhitenedData, values: Array) -> Array:
    """(n,) derivative of values (n,) with time, of each recording by itself."""
    found = np.zeros(data.count)
    for own in data.stretches[: len(data.parts)]:
        found[own] = np.gradient(values[own], data.base.t[own])
    return found


def _turning(data: WhitenedData) -> tuple[Array, Array]:
    """(n, 3) [rad/s] the tool's angular velocity in its own frame, and (n, 9) [rad/s^2] R' d^2R/dt^2 there, which is
    what any lever feels: angular acceleration, and products of rates. Zero where poses are too far apart to tell."""
    base, rate, bent = data.base, np.zeros((data.count, 3)), np.zeros((data.count, 9))
    for own in data.stretches[: len(data.parts)]:
        rotation, t = Rotation.from_matrix(base.R_base_tool[own]), base.t[own]
        if len(t) < _SERIES:
            continue
        turns = (rotation[:-1].inv() * rotation[1:]).as_rotvec()
        if np.quantile(np.linalg.norm(turns, axis=1), 0.95) > _FAR_APART:
            continue
        speed = turns / np.diff(t)[:, None]
        rate[own] = 0.5 * (np.concatenate([speed[:1], speed]) + np.concatenate([speed, speed[-1:]]))
        elements = base.R_base_tool[own]
        second = curvature(t, elements.reshape(-1, 9)).reshape(-1, 3, 3)
        bent[own] = np.matmul(elements.transpose(0, 2, 1), second).reshape(-1, 9)
    return rate, bent


def _of_size_one(values: Array) -> Array:
    """Divided by their root mean square."""
    return values / max(float(np.sqrt(np.mean(values**2))), 1e-300)


def history_courses(data: WhitenedData, column: int) -> list[Course]:
    """What an axis' offset can follow of the history of its input: as hysteresis of any form does to first order, plays
    of several widths (Prandtl and Ishlinskii's model; Visintin, Differential Models of Hysteresis, 1994); and a memory
    that fades."""
    own = data.base.inputs[:, column]
    size = float(np.ptp(own))
    plays = [own - play(own, share * size) for share in _WIDTHS]
    found = []
    for name, every in (("the history of its level", plays), (FADING, faded(data, column))):
        moved = [_of_size_one(each) for each in every if np.std(each) > 1e-9 * size]
        if moved:
            found.append(Course(name, np.column_stack(moved), np.ones(len(moved))))
    return found


def faded(data: WhitenedData, column: int) -> Array:
    """(k, n) the readings of a channel as memories of several lengths have them, less their means: a sum of
    exponentials, as materials creep and relax (Prony's series; Ferry, Viscoelastic Properties of Polymers, 1980)."""
    own = data.means(column, np.nan_to_num(data.modelled[:, column]))[:, None]
    clock = np.arange(len(own), dtype=float)
    lengths = sorted({max(share * len(own), 2.0) for share in _FADES})
    every = np.hstack([low_passed(clock, own, length) for length in lengths])
    return np.asarray((every - every.mean(axis=0)).T)


def level_courses(data: WhitenedData, column: int) -> list[Course]:
    """What an axis' offset can follow of its own input: its level, and its level by direction of change."""
    own = data.base.inputs[:, column] / data.base.references[column]
    powers = np.stack(
        [np.polynomial.legendre.legval(np.clip(own, -1.2, 1.2), np.eye(8)[order]) for order in range(2, 8)], axis=1
    )
    rate = np.gradient(own, data.base.t)
    direction = np.tanh(rate / max(0.2 * float(np.sqrt(np.mean(rate**2))), 1e-12))[:, None]
    return [
        Course("level", powers, falling(6)),
        Course(
            "level and direction",
            direction * np.column_stack([np.ones(len(own)), own, own**2]),
            np.array([1.0, 0.7, 0.7]),
        ),
    ]


@lru_cache(maxsize=4)
def cosines(count: int) -> Array:
    """(n, k) the slowest cosines over a recording, the constant first, each of mean square one."""
    waves = half_waves(count, np.arange(COSINES))
    waves.setflags(write=False)  # every caller has the same
    return waves


def half_waves(count: int, orders: Rows) -> Array:
    """(n, k) cosines over a recording, of so many half waves (k,) each, of mean square one."""
    clock = (np.arange(count) + 0.5) / count
    return np.asarray(np.cos(np.pi * np.outer(clock, orders)) * np.where(orders > 0, np.sqrt(2.0), 1.0))


def matern(length: float, most: int = COSINES) -> Array:
    """(most,) prior standard deviations of the cosines' coefficients: a Matern 3/2 process of so long a memory, as a
    share of the recording (Solin and Sarkka, Statistics and Computing 30, 2020)."""
    return np.asarray(1.0 / (3.0 / length**2 + (np.pi * np.arange(most)) ** 2))


def _products(columns: Array) -> Array:
    count = columns.shape[1]
    return np.stack([columns[:, i] * columns[:, j] for i in range(count) for j in range(i, count)], axis=1)
