"""Error sources: what of the arm or the sensor can be off.

A mechanism that is not in the catalogue still acts through the arm and the sensor: what it does to the channels is an
error of an angle, a clock, a turn, a field, an offset or a gain, times an unknown course
(``estimators.gap.hypotheses.courses``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final

import numpy as np

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.courses import LOCKED, faded, level_courses
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS, CHANNELS_OF, COLUMNS_OF
from rig.effects import EFFECTS, make_effect

#: How the name of an error begins that is in the form of a cause: in the catalogue it has one strength throughout.
STRENGTH: Final = "the strength of "
#: The name of the magnetic field's error in the base's frame.
MAGNETIC: Final = "the magnetic field"
_TOOL: Final = "the tool"
#: Angle [rad] and delay [s] at which derivatives are taken.
_STEP: Final = 1e-5
_DELAY: Final = 1e-4
#: Readings of a source along a course beyond which it is not whitened as that.
_LARGE: Final = 1 << 23

#: Whitens changes (m, c, n) of the means.
Whitening = Callable[[Array], Array]


@dataclass(frozen=True)
class Source:
    """Something of the arm or of a sensor that can be off.

    Attributes:
        name: what is off, in words.
        series: (f, c, n) whitened change of each channel that is there for a unit of each of its f freedoms.
        kind: "angle", "clock", "turn", "field", "offset" or "gain".
        column: the channel of an offset or a gain of one axis; -1 for the others.
        felt: (f, c, n) the same before it was whitened, and what whitens changes (m, c, n); None where whitening only
            scales, so that what follows a course is the product of ``series`` with that.
        alone: the source that this one is along a course.
    """

    name: str
    series: Array
    kind: str
    column: int = -1
    felt: tuple[Array, Whitening] | None = None
    alone: Source | None = None

    def along(self, values: Array, weight: Array) -> Source | None:
        """The source along functions (n, k) of prior standard deviations (k,), whitened as that: a freedom of it for
        each of the functions in turn. None where that is the product, or would be too large to make."""
        if self.felt is None:
            return None
        own, whitened = self.felt
        if len(own) * np.count_nonzero(own.any(axis=(0, 2))) * own.shape[2] * len(weight) > _LARGE:
            return None
        series = whitened((own[:, None] * (values * weight).T[:, None]).reshape(-1, *own.shape[1:]))
        each = np.sum(series.reshape(len(own), -1) ** 2, axis=1)
        scale = np.repeat(np.where(each > 1e-24, 1.0 / np.sqrt(np.maximum(each, 1e-24)), 0.0), len(weight))
        return Source(self.name, series * scale[:, None, None], self.kind, self.column, alone=self)

    @cached_property
    def root(self) -> Array:
        """(f, r) makes its freedoms alike and independent over the whole recording: their products with white noise
        have a variance of one a sample."""
        values, vectors = np.linalg.eigh(np.einsum("icn,jcn->ij", self.series, self.series) / self.series.shape[2])
        there = values > 1e-9 * values[-1]
        return np.asarray(vectors[:, there] / np.sqrt(values[there]))

    @property
    def of_one_offset(self) -> bool:
        """Whether it is the offset of one axis."""
        return self.kind == "offset" and self.column >= 0

    @property
    def of_tool(self) -> bool:
        """Whether it turns all sensors at once: so does any error of an angle."""
        return self.kind == "turn" and self.name == f"a turn of {_TOOL}"

    @property
    def single_step(self) -> str:
        """The effect of the catalogue that is one step of it; empty: none."""
        return "bias_step" if self.of_one_offset else "mounting_slip" if self.of_tool else ""


def sources(data: WhitenedData) -> list[Source]:
    """Every error source of a recording."""
    fields = {name: data.pipeline.environment.field(name) for name in data.pipeline.sensors}
    found = [*_of_joints(data), *_of_clocks(data), *_of_frames(data, fields), *_of_sensors(data, fields)]
    if len(fields) > 1:  # a converter's reference, a supply, a ground
        readings = np.nan_to_num(data.modelled)
        found.append(source_of(data, "the gain of all channels", "gain", [readings]))
        found.append(source_of(data, "the offset of all channels", "offset", [np.ones_like(readings)]))
        # what every channel has in its own measure, as a hum that all lines pick up: not several such things at once
        own = [_only(data, column, 1.0) for column in data.columns]
        found.append(source_of(data, "the offsets of every channel", "offset", own))
        own = [_only(data, column, data.base.inputs[:, column]) for column in data.columns]
        found.append(source_of(data, "the gains of every channel", "gain", own))
    return [each for each in found if each.series.any()]


def _of_joints(data: WhitenedData) -> Iterator[Source]:
    if data.base.q_encoder is not None:
        for name in EFFECTS["joint_offset"].places_on(data.base):
            change = data.change([make_effect("joint_offset", {"where": name, "offset_rad": _STEP})]) / _STEP
            yield source_of(data, f"the angle of {name}", "angle", [change])


def _of_clocks(data: WhitenedData) -> Iterator[Source]:
    """Of all, and, of several sensors, of each."""
    several = len(data.pipeline.sensors) > 1
    for where, name in (("acquisition", "the clock"), *((each, f"the clock of the {each}") for each in CHANNELS_OF)):
        if where == "acquisition" or (several and where in data.pipeline.sensors):
            late = make_effect("latency", {"where": where, "delay_s": _DELAY})
            yield source_of(data, name, "clock", [data.change([late]) / _DELAY])


def _of_frames(data: WhitenedData, fields: Mapping[str, Array]) -> Iterator[Source]:
    """Turns, and fields, whose direction is fixed in the base, in a link that turns under it, or in the tool."""
    rotation = data.base.R_base_tool
    frames = {"the base": np.broadcast_to(np.eye(3), rotation.shape)}
    if (q := data.base.q_encoder) is not None:
        moving = np.flatnonzero(np.std(np.unwrap(q, axis=0), axis=0) > LOCKED)
        frames |= {f"link{joint + 1}": data.base.link_rotation(int(joint)) for joint in moving[:-1]}
    if len(fields) > 1:  # of one sensor that is its own turn
        frames[_TOOL] = rotation
    for place, frame in frames.items():
        axes = np.moveaxis(frame, 2, 0)
        turned = [
            np.sum([_felt(data, name, _in_tool(np.cross(field, axis), rotation)) for name, field in fields.items()], 0)
            for axis in axes
        ]
        yield source_of(data, f"a turn of {place}", "turn", turned)
        for name, field in fields.items():
            what = "the acceleration" if name == ACCELEROMETER else "the magnetic field"
            if place != _TOOL:  # there it is an offset
                size = float(np.linalg.norm(field))
                felt = [_felt(data, name, size * _in_tool(axis, rotation)) for axis in axes]
                yield source_of(data, what if place == "the base" else f"{what} along {place}", "field", felt)


def _of_sensors(data: WhitenedData, fields: Mapping[str, Array]) -> Iterator[Source]:
    rotation, inputs, readings = data.base.R_base_tool, data.base.inputs, np.nan_to_num(data.modelled)
    for name, field in fields.items():
        in_tool = np.matmul(field, rotation)
        turned = [_felt(data, name, np.cross(in_tool, axis)) for axis in np.eye(3)]
        yield source_of(data, f"a turn of the {name}", "turn", turned)
        own = range(len(CHANNELS))[COLUMNS_OF[name]]
        yield source_of(data, f"the offsets of the {name}", "offset", [_only(data, column, 1.0) for column in own])
        yield source_of(data, f"the gains of the {name}", "gain", [_only(data, each, inputs[:, each]) for each in own])
        for column, label in zip(own, CHANNELS_OF[name], strict=True):
            yield source_of(data, f"the offset of {label}", "offset", [_only(data, column, 1.0)], column)
            yield source_of(data, f"the gain of {label}", "gain", [_only(data, column, inputs[:, column])], column)
            # behind the sensor an amplifier has its offset too
            yield source_of(
                data, f"the whole reading of {label}", "gain", [_only(data, column, readings[:, column])], column
            )


def alike(data: WhitenedData) -> Iterator[tuple[Source, str]]:
    """Of each sensor, its axes' offsets that follow their levels by one law, as those of one chip do: the levels, these
    and their direction, or a memory of them that fades; a freedom for each function. And what they follow."""
    for name, sensor in data.pipeline.sensors.items():
        here = [each for each in range(len(CHANNELS))[COLUMNS_OF[name]] if each in data.columns]
        laws: dict[str, dict[int, Array]] = {"the fading memory of their levels": {c: faded(data, c) for c in here}}
        for column in here:
            full = sensor.sensitivity[column - COLUMNS_OF[name].start] * data.base.references[column]
            for course in level_courses(data, column):
                followed = laws.setdefault(f"their {course.name.replace('level', 'levels')}", {})
                followed[column] = data.means(column, full * course.values.T)
        for law, levels in laws.items():
            white = {column: data.whiten_means(column, values) for column, values in levels.items()}
            nothing = np.zeros_like(next(iter(white.values())))
            series = np.stack([white.get(column, nothing) for column in data.columns], axis=1)
            yield _of(data, f"the offsets of the {name}", "memory", series), law


def _in_tool(vectors: Array, rotation: Array) -> Array:
    """(n, 3) vectors of the base's frame in the tool's."""
    return np.asarray(np.einsum("ni,nij->nj", vectors, rotation))


def source_of(data: WhitenedData, name: str, kind: str, changes: Sequence[Array], column: int = -1) -> Source:
    """A source of the changes (n, 6) [recorded unit] of the readings that its freedoms make."""
    means = np.zeros((len(changes), len(data.columns), data.count))
    for index, each in enumerate(data.columns):
        own = np.stack([change[:, each] for change in changes], axis=1)
        if own.any():
            means[:, index] = data.means(each, own.T)
    found = _of(data, name, kind, _each_whitened(data, means), column)
    return found if data.only_scaled else replace(found, felt=(means, partial(_whitened, data)))


def _of(data: WhitenedData, name: str, kind: str, series: Array, column: int = -1) -> Source:
    """A source of what it does to each channel by itself, whitened (f, c, n)."""
    return Source(name, _beside(data, series), kind, column)


def _whitened(data: WhitenedData, means: Array) -> Array:
    """Changes (m, c, n) of the means, whitened."""
    return _beside(data, _each_whitened(data, means))


def _each_whitened(data: WhitenedData, means: Array) -> Array:
    """(m, c, n) each channel by itself."""
    white = np.zeros_like(means)
    for index, column in enumerate(data.columns):
        if means[:, index].any():
            white[:, index] = data.whiten_means(column, means[:, index])
    return white


def _beside(data: WhitenedData, series: Array) -> Array:
    """(m, c, n) channels that were whitened by themselves, beside each other."""
    series = data.beside_each_other(series)
    series[:, :, data.stretches[len(data.parts) - 1].stop :] = 0.0  # a calibration from before has no errors
    return series


def _felt(data: WhitenedData, name: str, in_tool: Array) -> Array:
    """(n, 6) readings of a field (n, 3) in the tool's frame."""
    sensor = data.pipeline.sensors[name]
    found = np.zeros((len(in_tool), len(CHANNELS)))
    found[:, COLUMNS_OF[name]] = in_tool @ sensor.axes.T * np.asarray(sensor.sensitivity)
    return found


def _only(data: WhitenedData, column: int, values: Array | float) -> Array:
    found = np.zeros((len(data.base), len(CHANNELS)))
    found[:, column] = values
    return found
