"""Readings that stay what they were: a sensor, or the line to it, that is stuck."""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array
from rig.recording.samples import Recording

#: Equal readings of all three axes in a row, more than which noise, at rest or not, does not make.
_REPEATS: Final = 10


def stuck_words(run: Recording) -> list[str]:
    """What seems stuck, a line each: channels that never change, else many equal readings of a sensor in a row."""
    found = []
    for sensor in run.sensors:
        values = run.readings(sensor)
        still = np.flatnonzero(values.std(axis=0) == 0.0)
        found += [f"{sensor}: channel {channel + 1} never changes" for channel in still]
        row, count = _longest_repeat(values)
        if count > _REPEATS and not len(still):
            found.append(f"{sensor}: {count} readings in a row are the same, from row {row} on (first row 0): stuck?")
    return found


def _longest_repeat(values: Array) -> tuple[int, int]:
    """Where the longest run of equal rows of (n, 3) begins, and how many they are."""
    changes = np.flatnonzero((np.diff(values, axis=0) != 0.0).any(axis=1)) + 1
    starts = np.concatenate([[0], changes])
    counts = np.diff(np.concatenate([starts, [len(values)]]))
    longest = int(np.argmax(counts))
    return int(starts[longest]), int(counts[longest])
