"""Poses of a log that is slower than the sensor's, each repeated until the next one came.

Joining two logs row by row makes such files. The arm moves on between: straight lines from pose to pose are nearer to
that than steps are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from rig.arrays import Array, Rows
from rig.recording.recording_files import RecordingScan
from rig.recording.samples import Recording

#: Poses of a slower log, at least, and the share of them that are repeated equally often, give or take once.
_LOGGED, _THROUGHOUT = 20, 0.9
#: So many of the first rows, and a share of them that repeat the one before, as more do in any such log.
_FIRST, _ANY = 4096, 0.1
#: From the first to the second half of the rows of a pose, readings go on by this share of what they change between
#: the pose before and the one after, where the arm moves evenly; by nothing where it is held.
_GOES_ON: Final = 0.25
#: Standard deviations from which on that is more than chance.
_SURE: Final = 4.0


def equal_rows(values: Array) -> tuple[Rows, Rows]:
    """Where runs of equal rows of (n,) or (n, k) begin, and how many each has."""
    changed = np.diff(values.reshape(len(values), -1), axis=0).any(axis=1)
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    return starts, np.diff(np.concatenate([starts, [len(values)]]))


def poses_of(run: Recording) -> Array | None:
    """(n, N) [rad] joint angles, else the tool's quaternions (n, 4); None where there are neither."""
    return run.tool_quaternion if run.q is None else run.q


def repeated(run: Recording) -> Rows | None:
    """The rows at which the poses of a slower log first stand; None where they are no such log's.

    An arm that is held in each pose repeats these too: then its readings do not go on within them.
    """
    poses = poses_of(run)
    if poses is None or run.metadata.still_poses:
        return None
    first = poses[:_FIRST]
    if len(first) < 2 or np.mean((first[1:] == first[:-1]).all(axis=1)) < _ANY:
        return None
    starts, counts = equal_rows(poses)
    inner = counts[1:-1]  # the first and the last may be cut off
    often = int(np.median(inner)) if len(inner) else 0
    if often < 2 or len(inner) < _LOGGED or np.mean(np.abs(inner - often) <= 1) < _THROUGHOUT:
        return None
    if not _going_on(run.every_reading, starts, counts):
        return None
    return read_at(poses, often)


def read_at(poses: Array, often: int) -> Rows:
    """The rows at which poses (n, k) were read, each for so many rows; while the arm pauses, too."""
    rows = zip(*equal_rows(poses), strict=True)
    return np.concatenate([np.arange(first, first + max(many - often // 2, 1), often) for first, many in rows])


def _going_on(readings: Array, starts: Rows, counts: Rows) -> bool:
    """Whether readings (n, c) go on within the poses as they do from one to the next.

    By the mean of the second half of a pose's rows less that of the first, against the pose after less the pose before:
    these have no reading in common. The noise in their squares is taken off.
    """
    sums = np.cumsum(np.vstack([np.zeros((1, readings.shape[1])), readings]), axis=0)

    def mean(first: Rows, last: Rows) -> Array:
        return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])

    whole = mean(starts, starts + counts)
    between = whole[2:] - whole[:-2]
    first, many = starts[1:-1][counts[1:-1] > 1], counts[1:-1][counts[1:-1] > 1]
    between, half = between[counts[1:-1] > 1], many // 2
    within = mean(first + many - half, first + many) - mean(first, first + half)
    scale = np.maximum(between.std(axis=0), 1e-300)
    within, between = within / scale, between / scale
    along = np.sum(within * between, axis=1)
    squares = float(np.sum(between**2) - np.sum((half / many)[:, None] * within**2))
    sure = float(along.sum()) > _SURE * float(np.sqrt(np.sum(along**2)))
    return sure and float(along.sum()) > 0.5 * _GOES_ON * squares


def repeated_words(starts: Rows) -> str:
    """What is the matter, with the rows of ``repeated``."""
    often = int(np.median(np.diff(starts)))
    return f"each pose is repeated in {often} rows, throughout, while the readings go on"


def evenly_posed(source: Recording | RecordingScan) -> tuple[Recording | RecordingScan, str]:
    """As ``straight_between``, of a recording, or a scan of one by its first rows; and a warning in words, empty where
    it is as it was.

    Raises:
        RigError: the file cannot be read, or is such a log and does not fit into the memory.
    """
    first = source if isinstance(source, Recording) else next(iter(source))
    if (starts := repeated(first)) is None:
        return source, ""
    whole = first if isinstance(source, Recording) else source.read()
    words = f"{repeated_words(starts)}, as of a slower log, held until the next came: straight lines were put between"
    return straight_between(whole), words


def straight_between(run: Recording) -> Recording:
    """The recording with straight lines and turns about one axis from each pose of a slower log to the next.

    A pose was read between the row before and the one where it first stands: at that one, if each stands in equally
    many rows, as of one clock; else halfway. Before the first that is known so, and after the last, there is no line:
    these rows go. Other recordings are returned as they are.
    """
    if (starts := repeated(run)) is None:
        return run
    return lines_between(run, starts[1:], lateness(starts))  # nobody knows how long the first one stood before


def lateness(starts: Rows) -> float:
    """By which share of a row poses are older than the rows at which they first stand; the first may be cut."""
    return 0.5 if np.ptp(np.diff(starts[1:])) else 0.0


def lines_between(run: Recording, starts: Rows, late: float) -> Recording:
    """As ``straight_between``, of the poses that first stand at some rows after the first, so late."""
    t = run.t
    at = (1.0 - late) * t[starts] + late * t[starts - 1]

    def lines(values: Array) -> Array:
        return np.stack([np.interp(t, at, column) for column in values.T], axis=1)

    q, position = run.q, run.tool_position
    if q is not None:
        turning = np.array([joint not in run.slides for joint in range(1, q.shape[1] + 1)])
        q = lines(np.where(turning, np.unwrap(q[starts], axis=0), q[starts]))  # or a line leads through a whole turn
    if position is not None:
        position = lines(position[starts])
    quaternion = run.tool_quaternion
    if quaternion is not None:
        turns = Slerp(at, Rotation.from_quat(quaternion[starts], scalar_first=True))
        quaternion = turns(np.clip(t, at[0], at[-1])).as_quat(scalar_first=True)
    whole = replace(run, q=q, tool_quaternion=quaternion, tool_position=position)
    return whole.select((t >= at[0]) & (t <= at[-1]))
