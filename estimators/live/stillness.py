"""Still poses as they come: the detector of ``estimators.stillness`` in streaming form, with a fixed delay.

Readings are taken in pieces of half a window. A piece counts as still if both windows that hold it, it and its
neighbour on either side, are quiet: so it is known one piece later, and motion at either side is never averaged in. The
threshold is chosen as offline, from the variances of all windows so far (of a bounded number of them, evenly spread).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimators.stillness.detection import SAME_POSE, TREND_LIMIT
from estimators.stillness.threshold import choose_threshold
from rig.arrays import Array

_WINDOW_S: Final = 1.0  # as offline
_SHORTEST: Final = 5  # samples of a piece
#: Windows whose variances are remembered for the threshold, and how many are needed to choose one.
_REMEMBERED: Final = 2048
_LEAST: Final = 6
#: Poses kept at most.
_MOST_POSES: Final = 4096


@dataclass(frozen=True, eq=False)
class _Piece:
    """Half a window: sums over its samples, about an origin."""

    t_s: float
    count: int
    sums: Array  # (c,)
    squares: Array  # (c,) about the piece's own mean


class StillStream:
    """Finds poses in a stream of readings.

    Attributes:
        accepted: pieces that were still so far.
    """

    def __init__(self, rate_Hz: float, span_s: float | None = None) -> None:
        """Args:
        rate_Hz: of the samples.
        span_s: poses that ended longer ago are forgotten [s]; None: none.
        """
        self._length = max(_SHORTEST, round(0.5 * _WINDOW_S * rate_Hz))
        self.accepted = 0
        self._span_s = span_s
        self._rest: list[tuple[Array, Array]] = []
        self._waiting = 0
        self._last: list[_Piece] = []
        self._variances: list[Array] = []
        self._stride = self._phase = 0
        self._limit: tuple[Array, float] | None = None
        self._poses: list[list[float]] = []  # time of the end, count, sums (c)
        self._open = False
        self._chosen_at = 0

    def add(self, t: Array, readings: Array) -> None:
        """Samples: times (n,) [s] and readings (n, c)."""
        self._rest.append((t, readings))
        self._waiting += len(t)
        if self._waiting < self._length:
            return
        t, readings = np.concatenate([r[0] for r in self._rest]), np.concatenate([r[1] for r in self._rest])
        whole = len(t) // self._length * self._length
        parts = readings[:whole].reshape(whole // self._length, self._length, -1)
        means = parts.mean(axis=1)
        squares = np.square(parts - means[:, None]).sum(axis=1)
        for number in range(len(parts)):
            end = float(t[(number + 1) * self._length - 1])
            self._decide(_Piece(end, self._length, means[number] * self._length, squares[number]))
        self._rest = [(t[whole:], readings[whole:])]
        self._waiting = len(t) - whole

    def _decide(self, piece: _Piece) -> None:
        if self._last:
            self._remember(_variance(self._last[-1], piece))
        self._last = [*self._last[-2:], piece]
        if len(self._last) < 3:
            return
        before, own, after = self._last
        quiet = self._quiet(before, own) and self._quiet(own, after)
        self.accepted += quiet
        if quiet:
            self._take(own)
        else:
            self._open = False
        if self._span_s is not None:
            self._poses = [row for row in self._poses if row[0] >= piece.t_s - self._span_s]

    def _quiet(self, one: _Piece, other: _Piece) -> bool:
        if self._limit is None:
            return False
        floor, limit = self._limit
        variance = _variance(one, other)
        # As offline: a steady motion makes the squared difference of the halves' means three times the variance.
        steps = np.square(one.sums / one.count - other.sums / other.count)
        steady = float(steps.mean()) > TREND_LIMIT * 3.0 * float(variance.mean())
        return bool((variance / floor).mean() < limit) and not steady

    def _remember(self, variance: Array) -> None:
        self._phase += 1
        if self._phase > self._stride:
            self._phase = 0
            self._variances.append(variance)
            if len(self._variances) > _REMEMBERED:
                self._variances = self._variances[::2]
                self._stride = 2 * self._stride + 1
        known = len(self._variances)
        if known >= _LEAST and (known - self._chosen_at >= max(1, known // 8) or known < self._chosen_at):
            found = choose_threshold(np.array(self._variances).T, 2 * self._length)
            self._limit, self._chosen_at = (found.floor, found.limit), known

    def _take(self, piece: _Piece) -> None:
        assert self._limit is not None
        mean = piece.sums / piece.count
        if self._open:
            row = self._poses[-1]
            own = np.array(row[2:]) / row[1]
            if float((np.square(mean - own) / np.maximum(self._limit[0], 1e-300)).mean()) < SAME_POSE**2:
                row[0], row[1] = piece.t_s, row[1] + piece.count
                row[2:] = [a + b for a, b in zip(row[2:], piece.sums.tolist(), strict=True)]
                return
        self._poses.append([piece.t_s, piece.count, *piece.sums.tolist()])
        self._open = True
        if len(self._poses) > _MOST_POSES:
            del self._poses[0]

    @property
    def means(self) -> Array:
        """(p, c) mean readings of the poses so far [recorded unit]."""
        table = self._table
        return np.asarray(table[:, 2:] / table[:, 1:2])

    @property
    def counts(self) -> Array:
        """(p,) samples of each pose."""
        return np.asarray(self._table[:, 1])

    def __len__(self) -> int:
        """How many poses."""
        return len(self._poses)

    @property
    def _table(self) -> Array:
        return np.array(self._poses).reshape(len(self._poses), -1)


def _variance(one: _Piece, other: _Piece) -> Array:
    """(c,) unbiased variance over two pieces (Chan et al., 1983)."""
    count = one.count + other.count
    apart = one.sums / one.count - other.sums / other.count
    squares = one.squares + other.squares + np.square(apart) * (one.count * other.count / count)
    return np.asarray(squares / (count - 1))
