"""The time of a stream: samples in order, gaps and clocks that jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.arrays import Array, Mask

#: A pause of so many periods, and of so many seconds at least, is a gap.
_GAP_PERIODS: Final = 10.0
_GAP_S: Final = 0.25
#: So many samples in a row that lie behind the last good one are a clock that was set back.
_SET_BACK: Final = 5
#: A step ahead of more than this is a clock that was set, not a pause [s].
_JUMP_S: Final = 3600.0


@dataclass(frozen=True)
class Ticked:
    """What became of some samples' times.

    Attributes:
        t: (m,) [s] the times of those that are kept, increasing, and later than all before.
        kept: (n,) which they are.
        words: what there is to say.
    """

    t: Array
    kept: Mask
    words: tuple[str, ...]


class Clock:
    """Keeps a stream's time increasing.

    A sample that is not later than the one before is left out. Where the clock was set, back or by more than an hour,
    its time is continued from the last good sample, a period later: nothing is known of how long it really was.
    """

    def __init__(self, rate_Hz: float | None = None) -> None:
        """Args:
        rate_Hz: of samples without a time; None: they bring their own.
        """
        self.last = -np.inf
        self.period: float | None = None if rate_Hz is None else 1.0 / rate_Hz
        self.left_out = 0
        self._shift = 0.0
        self._made = rate_Hz is not None
        self._behind = 0

    def made(self, count: int) -> Array:
        """(n,) times of samples that bring none [s].

        Raises:
            ValueError: no rate is known.
        """
        if self.period is None or not self._made:
            raise ValueError("a clock without a rate makes no time")
        first = 0.0 if not np.isfinite(self.last) else self.last + self.period
        return np.asarray(first + self.period * np.arange(count), dtype=float)

    def tick(self, t: Array) -> Ticked:
        """Look at the times (n,) of the next samples [s]."""
        words: list[str] = []
        times = t + self._shift
        if not np.isfinite(self.last) and len(times):
            self.last = float(times[0]) - (self.period or 1e-9 * max(1.0, abs(float(times[0]))))
        before = np.concatenate([[self.last], times[:-1]])
        if bool((times > before).all()) and not (len(times) and float((times - before).max()) > _JUMP_S):
            kept = np.ones(len(times), dtype=bool)
        else:
            times, kept = self._mended(times, words)
        good = times[kept]
        if len(good):
            self._gaps(good, words)
            self._behind = 0 if kept[-1] else self._behind
            self.last = float(good[-1])
        self.left_out += int(len(kept) - len(good))
        return Ticked(good, kept, tuple(words))

    def _mended(self, times: Array, words: list[str]) -> tuple[Array, Mask]:
        times, kept = times.copy(), np.ones(len(times), dtype=bool)
        last = self.last
        for row in range(len(times)):
            step = float(times[row]) - last
            if 0.0 < step <= _JUMP_S:
                last, self._behind = float(times[row]), 0
                continue
            self._behind += 1
            if self._behind < _SET_BACK:
                kept[row] = False
                continue
            change = last + (self.period or 1e-3) - float(times[row])
            how = "back" if change > 0.0 else "ahead"
            words.append(f"the clock was set {how} by {abs(change):.3g} s: its time is continued from {last:.3f} s")
            times[row:] += change
            self._shift += change
            last, self._behind = float(times[row]), 0
        return times, kept

    def _gaps(self, t: Array, words: list[str]) -> None:
        steps = np.diff(np.concatenate([[self.last], t]))
        if self.period is not None:
            longest = int(np.argmax(steps))
            if steps[longest] > max(_GAP_PERIODS * self.period, _GAP_S):
                words.append(f"a gap of {steps[longest]:.3g} s before {t[longest]:.3f} s")
        if self._made:
            return
        inside = steps[1:] if self.period is None else steps
        if len(inside):
            typical = float(np.median(inside))
            self.period = typical if self.period is None else self.period + 0.1 * (typical - self.period)
