"""Poses of a log that is slower than the sensor's, each repeated until the next one came.

Joining two logs row by row makes such files. The arm moves on between: straight lines from pose to pose are nearer to
that than steps are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, overload

import numpy as np
from scipy.ndimage import maximum_filter1d
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
#: And in its last quarter by this share of what they do in its second; of a sensor that settles after a move, by less.
_STILL: Final = 0.5
#: Standard deviations from which on that is more than chance.
_SURE, _SETTLES = 4.0, 2.0
#: Numbers of a pose that change within so many poses to either side do so with each of a log, this share of them; those
#: of coarse encoders one by one.
_NEAR, _TOGETHER = 3, 0.75
#: Times the usual interval from which on one is a gap of the log.
_LOST: Final = 3.0
#: Of poses on a clock of its own, a share that stands in other than the usual number of rows.
_UNEVEN: Final = 0.05


@dataclass(frozen=True)
class Held:
    """Poses of a slower log.

    Attributes:
        starts: the rows at which they first stand. often: rows of each, as a rule.
        late: by which share of a row they are older than these.
    """

    starts: Rows
    often: int
    late: float

    @property
    def words(self) -> str:
        """What is the matter."""
        return f"each pose is repeated in {self.often} rows, throughout, while the readings go on"

    def read_at(self, t: Array, starts: Rows) -> Array:
        """When poses were read [s] that first stand at some rows after the first, at times (n,)."""
        return np.asarray((1.0 - self.late) * t[starts] + self.late * t[starts - 1])

    def next(self, poses: Array) -> Rows:
        """The rows at which later poses (n, k) of the same log first stand, the first of them at row 0.

        While the arm pauses, its pose is read as well.
        """
        rows = zip(*equal_rows(poses), strict=True)
        every = self.often
        return np.concatenate([np.arange(first, first + max(many - every // 2, 1), every) for first, many in rows])


def equal_rows(values: Array) -> tuple[Rows, Rows]:
    """Where runs of equal rows of (n,) or (n, k) begin, and how many each has."""
    changed = np.diff(values.reshape(len(values), -1), axis=0).any(axis=1)
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    return starts, np.diff(np.concatenate([starts, [len(values)]]))


def repeated(run: Recording) -> Held | None:
    """The poses of a slower log, joint angles or else the tool's; None where they are no such log's.

    An arm that is held in each pose repeats these too: then its readings do not go on within them, but for what a slow
    sensor has left to do. A coarse encoder repeats angles, one joint's when another's change.
    """
    return next(iter(held_poses(run).values()), None)


def held_poses(run: Recording) -> dict[bool, Held]:
    """As ``repeated``: of joint angles under True, of the tool's poses under False, where they are a slower log's."""
    found = {joints: _held(run, poses) for joints, poses in _kinds(run).items()}
    return {joints: held for joints, held in found.items() if held is not None}


def _kinds(run: Recording) -> dict[bool, Array]:
    """The poses that there are, each (n, k): under True joint angles, under False the tool's quaternions."""
    return {joints: poses for joints, poses in ((True, run.q), (False, run.tool_quaternion)) if poses is not None}


def _held(run: Recording, poses: Array) -> Held | None:
    """As ``repeated``, of one kind of poses."""
    first = poses[:_FIRST]
    alike = (first[1:] == first[:-1]).all(axis=1)
    if run.metadata.still_poses or not len(alike) or np.mean(alike) < _ANY:
        return None
    starts, counts = equal_rows(poses)
    inner = counts[1:-1]  # the first and the last may be cut off
    often = int(np.median(inner)) if len(inner) else 0
    if often < 2 or len(inner) < _LOGGED or np.mean(np.abs(inner - often) <= 1) < _THROUGHOUT:
        return None
    if not _changing_together(poses[starts]) or not _going_on(run.every_reading, starts, counts):
        return None
    found = Held(starts, often, 0.0)
    found = replace(found, starts=found.next(poses))
    uneven = np.mean(np.diff(found.starts[1:]) != often)
    return replace(found, late=0.5 if uneven > _UNEVEN else 0.0)


def _changing_together(poses: Array) -> bool:
    """Whether what changes of poses (m, k) that follow one another changes at once."""
    changed = np.diff(poses, axis=0) != 0.0
    near = maximum_filter1d(changed.astype(np.int8), 2 * _NEAR + 1, axis=0)
    return float(changed.sum()) > _TOGETHER * float(near.sum())


def _going_on(readings: Array, starts: Rows, counts: Rows) -> bool:
    """Whether readings (n, c) go on within the poses as they do from one to the next, to their ends.

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
    if not sure or float(along.sum()) <= 0.5 * _GOES_ON * squares:
        return False
    long = many >= 4
    first, many, between, quarter = first[long], many[long], between[long], many[long] // 4
    early = mean(first + quarter, first + 2 * quarter) - mean(first, first + quarter)
    late = mean(first + many - quarter, first + many) - mean(first + many - 2 * quarter, first + many - quarter)
    less = np.sum((_STILL * early - late) / scale * between, axis=1)
    return not float(less.sum()) > _SETTLES * float(np.sqrt(np.sum(less**2)))


@overload
def evenly_posed(source: Recording) -> tuple[Recording, tuple[str, ...]]: ...


@overload
def evenly_posed(source: Recording | RecordingScan) -> tuple[Recording | RecordingScan, tuple[str, ...]]: ...


def evenly_posed(source: Recording | RecordingScan) -> tuple[Recording | RecordingScan, tuple[str, ...]]:
    """As ``straight_between``, of a recording, or a scan of one by the first rows in which the arm moves; and warnings,
    none where it is as it was.

    Raises:
        RigError: the file cannot be read, or is such a log and does not fit into the memory.
    """
    whole = source if isinstance(source, Recording) else None
    if isinstance(source, RecordingScan):
        moving = next((batch for batch in source if not _resting(batch)), None)
        whole = None if moving is None or repeated(moving) is None else source.read()
    if whole is None or not (found := held_poses(whole)):
        return source, ()
    words = next(iter(found.values())).words
    return _straight(whole, found), (
        f"{words}, as of a slower log, held until the next came: straight lines were put between them",
    )


def _resting(batch: Recording) -> bool:
    """Whether there are too few poses to tell."""
    kinds = _kinds(batch).values()
    return bool(kinds) and all(len(equal_rows(poses)[0]) <= _LOGGED for poses in kinds)


def straight_between(run: Recording) -> Recording:
    """The recording with straight lines and turns about one axis from each pose of a slower log to the next.

    A pose was read between the row before and the one where it first stands: at that one, if each stands in equally
    many rows, as of one clock; else halfway. Before the first that is known so, after the last, and where the log has a
    gap, there is no line: these rows go. Other recordings are returned as they are.
    """
    found = held_poses(run)
    return _straight(run, found) if found else run


def _straight(run: Recording, found: Mapping[bool, Held]) -> Recording:
    """As ``straight_between``, of the poses that ``held_poses`` has found."""
    straight, known = run, np.ones(len(run), dtype=bool)
    for joints, each in found.items():
        starts = each.starts[1:]  # nobody knows how long the first one stood before
        at = each.read_at(run.t, starts)
        straight = lines_between(straight, joints, starts, at)
        known &= (run.t >= at[0]) & (run.t <= at[-1])
        before = np.clip(np.searchsorted(at, run.t, side="right") - 1, 0, len(at) - 2)
        lost = np.diff(at) > _LOST * np.median(np.diff(at))
        known &= ~(lost[before] & (run.t > at[before]) & (run.t < at[before + 1]))
    return straight.select(known)


def lines_between(run: Recording, joints: bool, starts: Rows, at: Array) -> Recording:
    """The joint angles, or the tool's poses, on straight lines between those that first stand at some rows.

    Args:
        starts, at: (m,) these rows, and when the poses were read [s].
    """
    t = run.t

    def lines(values: Array) -> Array:
        return np.stack([np.interp(t, at, column) for column in values.T], axis=1)

    if joints:
        assert run.q is not None
        turning = np.array([joint not in run.slides for joint in range(1, run.q.shape[1] + 1)])
        q = lines(np.where(turning, np.unwrap(run.q[starts], axis=0), run.q[starts]))  # or through a whole turn
        turns = np.where(turning, np.round((q - run.q) / (2.0 * np.pi)), 0.0)
        return replace(run, q=q - 2.0 * np.pi * turns)
    assert run.tool_quaternion is not None
    turned = Slerp(at, Rotation.from_quat(run.tool_quaternion[starts], scalar_first=True))
    quaternion = turned(np.clip(t, at[0], at[-1])).as_quat(scalar_first=True)
    position = run.tool_position if run.tool_position is None else lines(run.tool_position[starts])
    return replace(run, tool_quaternion=quaternion, tool_position=position)
