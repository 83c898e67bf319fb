"""Channels that stand still: a reading that repeats itself longer than noise lets it."""

from __future__ import annotations

from typing import Final

import numpy as np

from estimators.live.alarm import Alarm
from estimators.live.naming import Likeness
from rig.arrays import Array

#: A repeat is never taken to be rarer than this, nor a channel for stuck before so many readings.
_RAREST: Final = 1e-2
_LEAST: Final = 8


class Stuck:
    """Counts how long each channel of a sensor has repeated its reading.

    The probability of a repeat is that of the stream so far, so that a converter's steps are no alarm; a run of r
    repeats has this probability to the power r.

    Attributes:
        stuck: whether a channel is, now.
    """

    def __init__(self, sensor: str, chance: float) -> None:
        """Args: sensor: whose. chance: of a false alarm, per sample."""
        self._sensor, self._chance = sensor, chance
        self._run = np.zeros(3)
        self._last: Array | None = None
        self._repeats, self._seen = np.zeros(3), 0.0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self.stuck = False

    def add(self, t: Array, readings: Array) -> Alarm | None:
        """Readings (n, 3) at times (n,); an alarm when a channel has stopped."""
        before = readings[:1] if self._last is None else self._last[None]
        same = readings == np.concatenate([before, readings[:-1]])
        if self._last is None:
            same[0] = False
        self._last = readings[-1].copy()
        n = len(readings)
        moved = ~same
        any_moved = moved.any(axis=0)
        last_move = n - 1 - np.argmax(moved[::-1], axis=0)
        run = np.where(any_moved, n - 1 - last_move, self._run + n)
        probability = np.maximum((self._repeats + 1.0) / (self._seen + 2.0), _RAREST)
        needed = np.maximum(_LEAST, np.log(self._chance) / np.log(np.minimum(probability, 0.999)))
        long = run >= needed
        ends = (self._run < needed) | any_moved
        if not long.any():
            self._repeats += same.sum(axis=0)
            self._seen += n
            self._low = np.minimum(self._low, readings.min(axis=0))
            self._high = np.maximum(self._high, readings.max(axis=0))
        new = long & ends & (not self.stuck)
        self._run = run
        self.stuck = bool(long.any())
        if not new.any():
            return None
        longest = int(run[new].min())
        since = float(t[max(n - longest, 0)]) if longest < n else float(t[0])
        sure = float(t[max(n - 1 - int((run - np.ceil(needed))[new].max()), 0)])
        names = ", ".join(str(channel + 1) for channel in np.flatnonzero(new))
        at_end = (readings[-1] <= self._low) | (readings[-1] >= self._high)
        clipped = bool(at_end[new].all()) and not new.all()
        name = "saturation" if clipped else "dropouts"
        plural = "s" if int(new.sum()) > 1 else ""
        words = f"channel{plural} {names} repeat{'' if plural else 's'} the same reading"
        chance = float((probability[new] ** run[new]).max())
        likeness = Likeness(name, f"channel{plural} {names}", 0.0, "stuck")
        return Alarm("change", sure, since, self._sensor, words, chance, (likeness,))
