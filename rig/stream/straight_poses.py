"""Poses of a stream, with straight lines between those that a slower source repeats until its next one came."""

from __future__ import annotations

import numpy as np

from rig.recording import Recording, joined
from rig.recording.repeated_poses import Held, equal_rows, held_poses, lines_between

#: So many rows are looked at together at most; so many poses, and of all rows this share, tell that none is repeated.
_MOST, _ENOUGH, _NEW = 4096, 60, 0.9
#: While poses stand for so long at most [s], so many of them wait until it is known whether they are repeated.
_SHORT_S, _WAIT = 2.0, 40


class StraightPoses:
    """Takes the samples of a stream, batch by batch, and gives those whose poses are known by then.

    Attributes:
        words: what was found, once it is; empty before, and where no pose is repeated.
    """

    def __init__(self) -> None:
        self.words = ""
        self._held: Held | None = None
        self._kinds: tuple[bool, ...] = ()  # whether joint angles or the tool's poses, as ``held_poses`` has it
        self._settled = False
        self._seen: Recording | None = None  # from a pose's first row on, once they are known to be repeated
        self._at_s = 0.0  # when that was read
        self._given_s = -np.inf  # the last row that was given

    def __call__(self, batch: Recording) -> Recording | None:
        """Samples that follow on those given before; None where all wait for the next pose."""
        if self._settled:
            return batch
        seen = batch if self._seen is None else joined([self._seen, batch])
        kinds = [poses for poses in (seen.q, seen.tool_quaternion) if poses is not None]
        if not kinds:
            self._settled = True
            return batch
        if self._held is None:
            every = held_poses(seen)
            if not every:
                return self._undecided(seen, min((equal_rows(poses)[0] for poses in kinds), key=len))
            self._held = found = next(iter(every.values()))
            self._kinds = tuple(kind for kind, own in every.items() if np.array_equal(own.starts, found.starts))
            self.words = f"{found.words}: straight lines are put between them"
            self._at_s = float(found.read_at(seen.t, found.starts[1:2])[0])
            seen = seen.select(slice(int(found.starts[1]), None))
        poses = seen.q if self._kinds[0] else seen.tool_quaternion
        assert poses is not None
        self._seen = seen
        starts = self._held.next(poses)
        if len(starts) < 2:
            return None
        at = np.append(self._at_s, self._held.read_at(seen.t, starts[1:]))
        straight = seen
        for joints in self._kinds:
            straight = lines_between(straight, joints, starts, at)
        self._seen, self._at_s = seen.select(slice(int(starts[-1]), None)), float(at[-1])
        return self._given(straight, float(at[-1]))

    def _undecided(self, seen: Recording, starts: np.ndarray) -> Recording | None:
        """What has not been given yet, unless it is soon known whether its poses are repeated."""
        self._settled = len(starts) > max(_ENOUGH, _NEW * len(seen))
        self._seen = None if self._settled else seen.select(slice(-_MOST, None))
        stands_s = float(np.median(np.diff(seen.t[starts]))) if 1 < len(starts) < _WAIT else np.inf
        if not self._settled and len(starts) < _NEW * len(seen) and stands_s < _SHORT_S:
            return None
        return self._given(seen, float(seen.t[-1]))

    def _given(self, seen: Recording, until_s: float) -> Recording | None:
        """What comes after what was given before, up to a time."""
        fresh = (seen.t > self._given_s) & (seen.t <= until_s)
        self._given_s = max(self._given_s, until_s)
        return seen.select(fresh) if fresh.any() else None
