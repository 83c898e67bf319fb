"""Poses of a stream, with straight lines between those that a slower source repeats until its next one came."""

from __future__ import annotations

import numpy as np

from rig.recording import Recording, joined
from rig.recording.repeated_poses import (
    equal_rows,
    lateness,
    lines_between,
    poses_of,
    read_at,
    repeated,
    repeated_words,
)

#: So many rows are looked at together at most; so many poses, and of all rows this share, tell that none is repeated.
_MOST, _ENOUGH, _NEW = 4096, 60, 0.9


class StraightPoses:
    """Takes the samples of a stream, batch by batch, and gives those whose poses are known by then.

    What came before it was seen that poses are repeated is given as it is: some twenty poses, more where they differ by
    less than the noise.

    Attributes:
        words: what was found, once it is; empty before, and where no pose is repeated.
    """

    def __init__(self) -> None:
        self.words = ""
        self._every: tuple[int, float] | None = None  # rows of a pose, and how late it is
        self._settled = False
        self._seen: Recording | None = None
        self._given_s = -np.inf  # the last row that was given

    def __call__(self, batch: Recording) -> Recording | None:
        """Samples that follow on those given before; None where all wait for the next pose."""
        if self._settled:
            return batch
        seen = batch if self._seen is None else joined([self._seen, batch])
        poses = poses_of(seen)
        if poses is None:
            self._settled = True
            return batch
        if self._every is None and (starts := repeated(seen)) is not None:
            self._every = int(np.median(np.diff(starts))), lateness(starts)
            self.words = f"{repeated_words(starts)}: straight lines are put between"
        if self._every is None:
            self._settled = len(equal_rows(poses)[0]) > max(_ENOUGH, _NEW * len(poses))
            self._seen, self._given_s = seen.select(slice(-_MOST, None)), float(batch.t[-1])
            return batch
        often, late = self._every
        starts = read_at(poses, often)[1:]
        self._seen = seen if len(starts) < 2 else seen.select(slice(int(starts[-1]) - 1, None))
        straight = None if len(starts) < 2 else lines_between(seen, starts, late)
        if straight is None or straight.t[-1] <= self._given_s:
            return None
        straight = straight.select(straight.t > self._given_s)
        self._given_s = float(straight.t[-1])
        return straight
