"""Samples as they come, in bounded memory: all of them, or every second, fourth, .. once there are too many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rig.arrays import Array, Rows
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.recording import Recording


class Thinned:
    """Times and readings of a stream or of a file's batches.

    Which samples are kept depends on their number alone, not on how they came in pieces: of n samples those whose row
    is a multiple of the least power of two that has left ``at_most`` ever since, within the last ``span_s``
    where that is given.

    Attributes:
        step: this power of two. seen: samples so far.
    """

    def __init__(self, at_most: int, span_s: float | None = None) -> None:
        """Args:
        at_most: samples kept.
        span_s: samples older than this are dropped [s]; None: none.
        """
        self._at_most, self._span_s = at_most, span_s
        self.step = 1
        self.seen = 0
        self._first = 0  # row of the first one that is kept
        self._begin = self._end = 0
        self._table = np.empty((0, 0))  # columns of t and readings, by rows
        self._like: Recording | None = None

    def __len__(self) -> int:
        """How many are kept."""
        return self._end - self._begin

    def add(self, batch: Recording) -> None:
        """Take samples up that follow those before."""
        if self._like is None:
            self._like = batch.select(slice(0, 1))
            self._table = np.empty((1 + 3 * len(batch.sensors), 0))
        for begin in range(0, len(batch), self._at_most):  # the table has room for twice as many
            self._take(batch if len(batch) <= self._at_most else batch.select(slice(begin, begin + self._at_most)))

    def _take(self, batch: Recording) -> None:
        first = 0  # the row of the batch that comes next
        while first < len(batch):
            rows = np.arange(first + -self.seen % self.step, len(batch), self.step)
            room = self._room(batch.t[rows])
            end = int(rows[room]) if room < len(rows) else len(batch)
            if room:
                self._append(batch, rows[:room], self.seen + int(rows[0]) - first)
            self.seen += end - first
            first = end
            if self._span_s is not None:
                self._forget(float(batch.t[min(end, len(batch) - 1)]) - self._span_s)
            if room < len(rows):
                self._halve()

    def _room(self, times: Array) -> int:
        """How many of the next samples, which have these times, can be kept before there are too many."""
        if self._span_s is None:
            return min(len(times), self._at_most - len(self))
        together = np.concatenate([self._table[0, self._begin : self._end], times])
        number = len(self) + 1 + np.arange(len(times)) - np.searchsorted(together, times - self._span_s)
        over = np.flatnonzero(number > self._at_most)
        return int(over[0]) if over.size else len(times)

    def _append(self, batch: Recording, rows: Rows, number: int) -> None:
        """Keep rows of a batch, the first of them being sample ``number`` of all."""
        if not len(self):
            self._first = number
        self._make_room(len(rows))
        place = slice(self._end, self._end + len(rows))
        self._table[0, place] = batch.t[rows]
        for index, sensor in enumerate(batch.sensors):
            self._table[1 + 3 * index : 4 + 3 * index, place] = batch.readings(sensor)[rows].T
        self._end += len(rows)

    def _forget(self, before_s: float) -> None:
        gone = int(np.searchsorted(self._table[0, self._begin : self._end], before_s))
        self._begin += gone
        self._first += gone * self.step

    def latest(self, sensor: str, count: int) -> Array:
        """(count, 3) the last readings of a sensor that are kept [recorded unit]."""
        assert self._like is not None
        row = 1 + 3 * self._like.sensors.index(sensor)
        return self._table[row : row + 3, self._end - count : self._end].T

    def recording(self) -> Recording:
        """What is kept, without poses, at the rate of what is kept."""
        assert self._like is not None
        like, rows = self._like, slice(self._begin, self._end)
        readings = {
            sensor: self._table[1 + 3 * number : 4 + 3 * number, rows].T for number, sensor in enumerate(like.sensors)
        }
        rate = like.metadata.rate_Hz
        return Recording(
            t=self._table[0, rows],
            accelerometer=readings.get(ACCELEROMETER),
            magnetometer=readings.get(MAGNETOMETER),
            units=like.units,
            metadata=replace(like.metadata, rate_Hz=None if rate is None else rate / self.step),
            name=like.name,
            origin=like.origin,
        )

    def _halve(self) -> None:
        odd = self._first // self.step % 2
        half = self._table[:, self._begin + odd : self._end : 2].copy()
        self._first += odd * self.step
        self.step *= 2
        self._begin, self._end = 0, half.shape[1]
        self._table[:, : self._end] = half

    def _make_room(self, new: int) -> None:
        if self._end + new <= self._table.shape[1]:
            return
        used = self._table[:, self._begin : self._end]
        most = self._at_most if self._span_s is None else 2 * self._at_most
        self._table = np.empty((len(used), min(max(2 * len(self), len(self) + new, 1024), most)))
        self._table[:, : used.shape[1]] = used
        self._begin, self._end = 0, used.shape[1]
