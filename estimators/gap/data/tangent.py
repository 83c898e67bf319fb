"""What the calibration's parameters do to the readings of each channel, and an orthonormal basis of it.

A channel has a sensitivity, an offset and an axis of its own; the field's direction is that of a sensor. So most of the
tangent is zero, and is not kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.gap.data.projection import Basis, orthonormal, project
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF
from rig.directions import tangent_basis
from rig.pipeline import Pipeline
from rig.signals import Signals


@dataclass(frozen=True, eq=False)
class ChannelTangent:
    """What some of the calibration's parameters do to one channel.

    Attributes:
        numbers: which parameters. values: (n, k) of its readings, each column contiguous.
    """

    numbers: list[int]
    values: Array


def of_readings(felt: Signals, pipeline: Pipeline) -> dict[int, ChannelTangent]:
    """For each channel, in recorded units, those of six parameters.

    Its sensitivity, its offset, two tangent coordinates of its axis, and the two of the field that the channels of
    a sensor share.

    Args:
        felt: what the sensors feel, after all stages but the last.
    """
    found: dict[int, ChannelTangent] = {}
    total = 0
    for name, sensor in pipeline.sensors.items():
        field = pipeline.environment.gravity if name == ACCELEROMETER else pipeline.environment.magnetic
        there = felt.gravity - felt.acceleration if name == ACCELEROMETER else felt.magnetic
        rotation = felt.R_base_tool
        in_tool = np.matmul(there, rotation) if there.ndim == 1 else np.einsum("ni,nij->nj", there, rotation)
        turned = [np.matmul(along, rotation) for along in tangent_basis(field / np.linalg.norm(field))]
        columns = range(*COLUMNS_OF[name].indices(len(CHANNELS)))
        shared = [total + 4 * len(columns), total + 4 * len(columns) + 1]
        for column, axis, sensitivity in zip(columns, sensor.axes, sensor.sensitivity, strict=True):
            own = np.empty((6, len(felt))).T
            own[:, 0] = felt.inputs[:, column]
            own[:, 1] = 1.0
            own[:, 2:4] = sensitivity * in_tool @ tangent_basis(axis).T
            for index, along in enumerate(turned):
                own[:, 4 + index] = sensitivity * np.linalg.norm(field) * (along @ axis)
            found[column] = ChannelTangent([total, total + 1, total + 2, total + 3, *shared], own)
            total += 4
        total += 2
    return found


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
