"""What the calibration's parameters do to the readings of each channel, and an orthonormal basis of it.

A channel has a sensitivity, an offset and an axis of its own; the field's direction is that of a sensor. So most of the
tangent is zero, and is not kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimators.gap.data.projection import Basis, orthonormal, project
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF, MAGNETOMETER
from rig.directions import tangent_basis
from rig.effects import Effect, Stage
from rig.effects.parameters import choices_of
from rig.pipeline import Pipeline
from rig.sensor import TriaxialSensor
from rig.signals import Signals

#: Share of its size, or radians, by which a parameter is moved for a derivative.
_STEP: Final = 1e-6
#: No step makes a sensitivity smaller than this share of what it was.
_SMALLER: Final = 1e-3


@dataclass(frozen=True, eq=False)
class ChannelTangent:
    """What some of the calibration's parameters do to one channel.

    Attributes:
        numbers: which parameters. values: (n, k) of its readings, each column contiguous.
    """

    numbers: list[int]
    values: Array


def of_readings(
    base: Signals,
    pipeline: Pipeline,
    effects: Sequence[Effect] = (),
    means: Callable[[int, Array], Array] = lambda _, values: values,
) -> dict[int, ChannelTangent]:
    """For each channel, in recorded units, those of six parameters.

    Its sensitivity, its offset, two tangent coordinates of its axis, and the two of the field that the channels of
    a sensor share.

    Args:
        base: after all stages, without effects. effects: mean effects that are in place, but for what one channel does
            to another.
        means: of a channel's values (..., n): what is kept of them.
    """
    numbers = _numbers(pipeline)
    beside = _beside_which(effects)
    known = _beside(base, pipeline, beside, numbers, means) if beside else _alone(base, pipeline, means)
    return {column: ChannelTangent(own, known[column]) for column, own in numbers.items()}


def along(base: Signals, pipeline: Pipeline, effects: Sequence[Effect], step: Array) -> Array:
    """(n, 6) [recorded unit] what the tangent of ``of_readings`` makes of a step (p,) of the parameters."""
    if not np.any(step):
        return np.zeros_like(base.volts)
    volts = _of_steps(base, pipeline, _beside_which(effects))
    share = 1.0 / float(np.max(np.abs(step) / _steps(pipeline, _numbers(pipeline))))
    return (volts(share * step) - volts(np.zeros_like(step))) / share


def _beside_which(effects: Sequence[Effect]) -> list[Effect]:
    """Those of some effects beside which the calibration is differentiated."""
    return [each for each in effects if each.stage is not Stage.VOLTS or not choices_of(type(each))]


def _numbers(pipeline: Pipeline) -> dict[int, list[int]]:
    """Of each channel its six parameters' numbers."""
    found, total = {}, 0
    for name in pipeline.sensors:
        columns = range(*COLUMNS_OF[name].indices(len(CHANNELS)))
        shared = [total + 4 * len(columns), total + 4 * len(columns) + 1]
        for column in columns:
            found[column] = [*range(total, total + 4), *shared]
            total += 4
        total += 2
    return found


def _alone(base: Signals, pipeline: Pipeline, means: Callable[[int, Array], Array]) -> dict[int, Array]:
    """(m, 6) of each channel without effects: its readings are linear in sensitivity, axis and field."""
    found = {}
    for name, sensor in pipeline.sensors.items():
        field = pipeline.environment.field(name)
        there = base.gravity - base.acceleration if name == ACCELEROMETER else base.magnetic
        rotation = base.R_base_tool
        in_tool = np.matmul(there, rotation) if there.ndim == 1 else np.einsum("ni,nij->nj", there, rotation)
        turned = [np.matmul(turn, rotation) for turn in tangent_basis(field / np.linalg.norm(field))]
        columns = range(*COLUMNS_OF[name].indices(len(CHANNELS)))
        for column, axis, sensitivity in zip(columns, sensor.axes, sensor.sensitivity, strict=True):
            own = np.empty((6, len(base))).T
            own[:, 0] = base.inputs[:, column]
            own[:, 1] = 1.0
            own[:, 2:4] = sensitivity * in_tool @ tangent_basis(axis).T
            for index, turn in enumerate(turned):
                own[:, 4 + index] = sensitivity * np.linalg.norm(field) * (turn @ axis)
            found[column] = means(column, own.T).T
    return found


def _beside(
    base: Signals,
    pipeline: Pipeline,
    effects: Sequence[Effect],
    numbers: Mapping[int, Sequence[int]],
    means: Callable[[int, Array], Array],
) -> dict[int, Array]:
    """(m, 6) of each channel beside effects: by forward differences, the same parameter of all channels at once."""
    volts, steps = _of_steps(base, pipeline, effects), _steps(pipeline, numbers)
    here = volts(np.zeros_like(steps))
    found: dict[int, list[Array]] = {column: [] for column in numbers}
    for place in range(6):
        chosen = [own[place] for own in numbers.values()]
        moved = np.zeros_like(steps)
        moved[chosen] = steps[chosen]
        ahead = volts(moved)
        for column, own in numbers.items():
            found[column].append(means(column, (ahead[:, column] - here[:, column]) / steps[own[place]]))
    return {column: np.array(own).T for column, own in found.items()}


def _steps(pipeline: Pipeline, numbers: Mapping[int, Sequence[int]]) -> Array:
    """(p,) of each parameter, for a derivative."""
    steps = np.full(1 + max(max(own) for own in numbers.values()), _STEP)
    for name, sensor in pipeline.sensors.items():
        field = pipeline.environment.field(name)
        columns = range(*COLUMNS_OF[name].indices(len(CHANNELS)))
        for column, sensitivity in zip(columns, sensor.sensitivity, strict=True):
            steps[numbers[column][:2]] *= sensitivity * np.array([1.0, np.linalg.norm(field)])
    return steps


def _of_steps(base: Signals, pipeline: Pipeline, effects: Sequence[Effect]) -> Callable[[Array], Array]:
    """The readings (n, 6) that a step (p,) of the parameters makes, beside effects."""
    rng, own = np.random.default_rng(0), tuple(effects)  # mean effects draw nothing
    posed = replace(pipeline, effects=own).begun(base, rng, Stage.FIELD)
    return lambda step: replace(stepped(pipeline, step), effects=own).expected(posed, rng, first=Stage.FIELD).volts


def stepped(pipeline: Pipeline, step: Array) -> Pipeline:
    """The pipeline with its parameters moved by ``step`` (p,), in the order of ``WhitenedData.tangent``."""
    environment = pipeline.environment
    sensors: dict[str, TriaxialSensor] = {}
    first = 0
    for name, sensor in pipeline.sensors.items():
        count = len(range(6)[COLUMNS_OF[name]])
        own = step[first : first + 4 * count].reshape(count, 4)
        field = environment.field(name)
        direction = field / np.linalg.norm(field)
        direction = direction + step[first + 4 * count : first + 4 * count + 2] @ tangent_basis(direction)
        x, y, z = (float(each) for each in direction / np.linalg.norm(direction))
        axes = np.stack([axis + move @ tangent_basis(axis) for axis, move in zip(sensor.axes, own[:, 2:], strict=True)])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        before = np.asarray(sensor.sensitivity)
        sensitivity = np.maximum(before + own[:, 0], _SMALLER * before)
        sensors[name] = TriaxialSensor.from_axes(sensitivity, np.asarray(sensor.offset) + own[:, 1], axes)
        if name == ACCELEROMETER:
            environment = replace(environment, gravity_direction=(x, y, z))
        else:
            environment = replace(environment, magnetic_direction=(x, y, z))
        first += 4 * count + 2
    return Pipeline(environment, sensors.get(ACCELEROMETER), sensors.get(MAGNETOMETER))


def size(parts: Sequence[ChannelTangent]) -> int:
    """How many parameters there are."""
    return 1 + max(max(part.numbers) for part in parts)


def dense(parts: Sequence[ChannelTangent]) -> Array:
    """(c n, p) of channels one after another, each column contiguous."""
    count = len(parts[0].values)
    found = np.zeros((size(parts), len(parts) * count))
    for index, part in enumerate(parts):
        found[part.numbers, index * count : (index + 1) * count] = part.values.T
    return found.T


def moments(parts: Sequence[ChannelTangent], target: Array) -> tuple[Array, Array]:
    """(p, p) and (p,) products of the tangent with itself and with readings (c n,)."""
    gram, moment = np.zeros((size(parts), size(parts))), np.zeros(size(parts))
    for part, own in zip(parts, target.reshape(len(parts), -1), strict=True):
        gram[np.ix_(part.numbers, part.numbers)] += part.values.T @ part.values
        moment[part.numbers] += part.values.T @ own
    return gram, moment


def basis(parts: Sequence[ChannelTangent]) -> Basis:
    """Orthonormal, of the tangent: of each channel's own parameters, then of those that several share."""
    count = len(parts[0].values)
    channels: dict[int, list[int]] = {}
    for index, part in enumerate(parts):
        for number in part.numbers:
            channels.setdefault(number, []).append(index)
    found: list[tuple[slice, Array]] = []
    for among in sorted(set(map(tuple, channels.values())), key=len):
        numbers = [number for number in channels if tuple(channels[number]) == among]
        rows = slice(among[0] * count, (among[-1] + 1) * count)
        own = np.zeros((len(numbers), among[-1] + 1 - among[0], count))
        for index in among:
            places = [parts[index].numbers.index(number) for number in numbers]
            own[:, index - among[0]] = parts[index].values.T[places]
        columns = own.reshape(len(numbers), -1).T
        length = np.linalg.norm(columns, axis=0)
        columns = columns[:, length > 0.0] / length[length > 0.0]
        before = [block for block in found if rows.start <= block[0].start < rows.stop]
        inside = tuple((slice(own.start - rows.start, own.stop - rows.start), each) for own, each in before)
        inner = Basis(inside, len(columns))
        for _ in range(2 if before else 0):  # twice is enough (Parlett 1980, section 6.9)
            columns = project(inner, columns)
        found.append((rows, orthonormal(columns, scaled=True)))
    return Basis(tuple(found), len(parts) * count)
