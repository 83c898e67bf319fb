"""Recordings that are larger than memory, as means over blocks of successive samples."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.errors import RigError
from rig.memory import limit_bytes
from rig.recording.recording_files import RecordingScan, scan_recording
from rig.recording.samples import Recording, arrays_of

#: What a model of the rig makes of a recording's poses: sensor -> (n, 3) [recorded unit].
Model = Callable[[Recording], Mapping[str, Array]]

#: A line of a CSV file with two columns or more takes so much at least [bytes].
_SHORTEST_LINE: Final = 4
#: Of the memory that may be taken, the samples get so much at least.
_LEAST: Final = 0.2
#: The interpreter with what a command loads [bytes].
_PROGRAM: Final = 290e6


def whole_or_means(
    path: str | os.PathLike[str],
    joints: int | None = None,
    bytes_a_sample: float = 600.0,
    block: int | None = None,
    fitted: Callable[[RecordingScan], Model] | None = None,
    fixed: float = 0.0,
) -> tuple[Recording, int]:
    """A recording whole, or as means over blocks of samples where it would take more memory than there may be taken.

    Args:
        path: of the file.
        joints: how many joints the arm has; None: as of ``scan_recording``.
        bytes_a_sample: what is to be done with it takes so much memory.
        block: samples of a block, where that is known: a locked recording is averaged like the one it belongs to.
        fitted: makes the model of ``block_means``; called where means are needed.
        fixed: memory that is taken besides, however short the recording [bytes].

    Returns:
        The recording, and how many samples each of its own stands for.

    Raises:
        RigError: as of ``scan_recording`` and of reading.
    """
    scan = scan_recording(path, joints=joints)
    if block is None:
        block = block_length(scan, bytes_a_sample, fixed)
    if block == 1:
        return scan.read(), 1
    return block_means(scan, block, None if fitted is None else fitted(scan)), block


def block_length(scan: RecordingScan, bytes_a_sample: float, fixed: float = 0.0) -> int:
    """How many samples have to be averaged for a recording to fit into the memory that may be taken; 1: none."""
    rows = scan.rows
    if rows is None:
        rows = scan.path.stat().st_size // max(2 * len(scan.table.names), _SHORTEST_LINE)
    return max(1, int(np.ceil(rows * bytes_a_sample / _room(fixed))))


def _room(fixed: float) -> float:
    """What the samples may take of the memory, besides what is taken anyway [bytes]."""
    limit = limit_bytes()
    return max(limit - fixed, _LEAST * limit)


def whole_or_beginning(
    path: str | os.PathLike[str], bytes_a_sample: float = 450.0, fixed: float = _PROGRAM
) -> tuple[Recording, str]:
    """A recording whole, or so much of its beginning as may be taken of memory: noise has to be successive samples.

    Args:
        path, bytes_a_sample, fixed: as of ``whole_or_means``.

    Returns:
        The recording, and a word about what was left out; "" where nothing was.

    Raises:
        RigError: as of reading.
    """
    scan = scan_recording(path)
    most = max(int(_room(fixed) / bytes_a_sample), 1)
    if scan.rows is not None and scan.rows <= most:
        return scan.read(), ""
    parts: list[Recording] = []
    count = 0
    for batch in scan:
        parts.append(batch.select(slice(0, most - count)))
        count += len(parts[-1])
        if count == most:
            return joined(parts), f"{path}: its first {most:,} samples are used: memory allows no more"
    return joined(parts), ""


def block_means(scan: RecordingScan, block: int, model: Model | None = None) -> Recording:
    """Means over blocks of so many successive samples, in constant memory but for the result.

    Times, joint angles, readings and all else are averaged; of a tool's quaternion the mean is made a rotation again.
    What is left over at the end, less than a block, is dropped. The stated rate is divided by the block's length.

    Args:
        scan, block: of what, and how many samples.
        model: the readings of a moving sensor, averaged, are not those at its mean pose. With a model of them, what the
            single readings differ from it is averaged, and added to what it says of the pose and time in the middle.

    Raises:
        RigError: no whole block, or as of reading.
    """
    parts: list[Recording] = []
    rest: Recording | None = None
    for batch in scan:
        together = batch if rest is None else joined([rest, batch])
        whole = len(together) // block * block
        rest = together.select(slice(whole, None)) if whole < len(together) else None
        if whole:
            own = together.select(slice(0, whole))
            parts.append(_means(own, block) if model is None else _at_middle_poses(own, block, model))
    if not parts:
        raise RigError(f"{scan.path}: has fewer than {block} samples, expected a block of them")
    found = joined(parts)
    rate = found.metadata.rate_Hz
    return replace(found, metadata=replace(found.metadata, rate_Hz=None if rate is None else rate / block))


def joined(parts: list[Recording]) -> Recording:
    """One recording of several that follow one another in time and have the same columns."""
    return parts[0] if len(parts) == 1 else replace(parts[0], **arrays_of(parts, np.concatenate))


def _at_middle_poses(recording: Recording, block: int, model: Model) -> Recording:
    middle = recording.select(slice(block // 2, None, block))
    single, there = model(recording), model(middle)
    means = _means(recording, block)
    readings = {
        sensor: means.readings(sensor) - single[sensor].reshape(-1, block, 3).mean(axis=1) + there[sensor]
        for sensor in means.sensors
    }
    return replace(
        means,
        t=middle.t,
        q=middle.q,
        tool_quaternion=middle.tool_quaternion,
        tool_position=middle.tool_position,
        accelerometer=readings.get(ACCELEROMETER),
        magnetometer=readings.get(MAGNETOMETER),
    )


def _means(recording: Recording, block: int) -> Recording:
    def mean(arrays: list[Array]) -> Array:
        return np.asarray(arrays[0].reshape(-1, block, *arrays[0].shape[1:]).mean(axis=1))

    arrays = arrays_of([recording], mean)
    if recording.tool_quaternion is not None:
        turns = recording.tool_quaternion.reshape(-1, block, 4)
        # of the two that are the same rotation, the one nearer to the block's first
        side = np.where(np.einsum("bij,bj->bi", turns, turns[:, 0]) < 0.0, -1.0, 1.0)
        turns = (side[:, :, None] * turns).mean(axis=1)
        arrays["tool_quaternion"] = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    return replace(recording, **arrays)
