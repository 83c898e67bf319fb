"""Readings of a sensor at rest, averaged pose by pose, without losing what the single readings say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimators.stillness.detection import SPEED_LIMIT, Stillness, find_still
from estimators.stillness.stretches import sums_over
from rig.arrays import Array, Rows
from rig.channels import COLUMNS_OF
from rig.pose_nodes import one_sign
from rig.recording import Recording
from rig.recording.samples import arrays_of
from rig.threads import one_blas_thread


@dataclass(frozen=True, eq=False)
class StillPoses:
    """The mean readings of each pose, with the number of readings behind them.

    Attributes:
        recording: (p,) one sample a pose: its mean time, pose and readings. The metadata hold the counts as
            ``pose_samples``.
        counts: (p,) samples a pose.
        noise: sensor -> (3,) standard deviation of a reading about its pose's mean [recorded unit], and
            ``degrees_of_freedom`` the number behind it.
        inflation: sensor -> (3,) the variance of the mean of half a pose over that of as many readings without memory:
            one for white noise. The covariance of a fit that takes them for independent is too small by it.
        stillness: how the poses were found.
    """

    recording: Recording
    counts: Rows
    noise: Mapping[str, Array]
    degrees_of_freedom: int
    inflation: Mapping[str, Array]
    stillness: Stillness

    def __len__(self) -> int:
        """How many poses."""
        return len(self.counts)


def still_poses(
    recording: Recording,
    *,
    window_s: float = 1.0,
    threshold: float | Mapping[str, float] | None = None,
    sensors: Sequence[str] | None = None,
    speed_limit: float = SPEED_LIMIT,
) -> StillPoses:
    """``average_poses`` over what ``find_still`` finds; the options are those of the latter."""
    found = find_still(recording, window_s=window_s, threshold=threshold, sensors=sensors, speed_limit=speed_limit)
    return average_poses(recording, found)


def average_poses(recording: Recording, stillness: Stillness) -> StillPoses:
    """Average a recording over the poses that were found in it.

    Everything recorded is averaged: readings, joint angles, the tool's pose (quaternions of either sign), temperature,
    currents and supply.

    Args:
        recording: in which ``stillness`` was found.
        stillness: the stretches and their poses.
    """
    first, stop, pose = stillness.first, stillness.stop, stillness.pose
    starts = np.flatnonzero(np.concatenate([[True], np.diff(pose) > 0]))
    counts = np.add.reduceat(stop - first, starts)

    def mean(arrays: list[Array]) -> Array:
        values = arrays[0]
        columns = [values] if values.ndim == 1 else list(values.T)
        means = np.add.reduceat(sums_over(columns, first, stop), starts, axis=1) / counts
        return means[0] if values.ndim == 1 else means.T

    arrays = arrays_of([recording], mean)
    if recording.tool_quaternion is not None:
        turned = mean([one_sign(recording.tool_quaternion)])
        arrays["tool_quaternion"] = turned / np.sqrt(np.square(turned).sum(axis=1))[:, None]
    extra = {**recording.metadata.extra, "pose_samples": [int(count) for count in counts]}
    metadata = replace(recording.metadata, rate_Hz=None, extra=extra)
    means = replace(recording, **arrays, metadata=metadata, first_row=0)
    squares, halves = _scatter(recording, stillness, means)
    freedom = int(counts.sum()) - len(counts)
    noise, inflation = {}, {}
    for sensor in recording.sensors:
        variance = squares[COLUMNS_OF[sensor]] / max(freedom, 1)
        noise[sensor] = np.sqrt(variance)
        inflation[sensor] = halves[COLUMNS_OF[sensor]] / np.maximum(variance, np.finfo(float).tiny)
    return StillPoses(means, counts, noise, freedom, inflation, stillness)


def counts_of(recording: Recording) -> Array | None:
    """(n,) how many readings each sample is the mean of, of averaged poses."""
    found = recording.metadata.extra.get("pose_samples")
    if not isinstance(found, list) or len(found) != len(recording):
        return None
    counts = np.asarray(found, dtype=float)
    return counts if bool((counts > 0.0).all()) else None


def _scatter(recording: Recording, stillness: Stillness, means: Recording) -> tuple[Array, Array]:
    """(6,) sums of squares about the poses' means, and (6,) the variance that the two halves of stretches suggest."""
    squares, halves = np.zeros(6), np.zeros(6)
    readings = np.zeros((int(np.max(stillness.stop - stillness.first)), 6))
    with one_blas_thread():
        for first, stop, pose in zip(stillness.first, stillness.stop, stillness.pose, strict=True):
            part = readings[: stop - first]
            for sensor in recording.sensors:
                part[:, COLUMNS_OF[sensor]] = recording.readings(sensor)[first:stop] - means.readings(sensor)[pose]
            squares += np.square(part).sum(axis=0)
            middle = len(part) // 2
            apart = part[:middle].mean(axis=0) - part[middle:].mean(axis=0)
            halves += np.square(apart) / (1.0 / middle + 1.0 / (len(part) - middle))
    return squares, halves / len(stillness.first)
