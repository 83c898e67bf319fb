"""Samples as they come, in bounded memory: all of them, or every second, fourth, .. once there are too many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.recording import Recording

Array = NDArray[np.float64]


class Thinned:
    """Times and readings of a stream or of a file's batches.

    Which samples are kept depends on their number alone, not on how they came in pieces: of n samples those whose row
    is a multiple of the least power of two that leaves ``at_most``.
    """

    def __init__(self, at_most: int, span_s: float | None = None) -> None:
        """Args:
        at_most: samples kept.
        span_s: samples older than this are dropped [s]; None: none.
        """
        self._at_most, self._span_s = at_most, span_s
        self._step = 1
        self._row = 0  # samples so far
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
        while True:
            chosen = slice(-self._row % self._step, None, self._step)
            new = len(range(*chosen.indices(len(batch))))
            if len(self) + new <= self._at_most:
                break
            self._halve()
        if new:
            if not len(self):
                self._first = self._row + chosen.start
            self._make_room(new)
            place = slice(self._end, self._end + new)
            self._table[0, place] = batch.t[chosen]
            for number, sensor in enumerate(batch.sensors):
                self._table[1 + 3 * number : 4 + 3 * number, place] = batch.readings(sensor)[chosen].T
            self._end += new
        self._row += len(batch)
        if self._span_s is not None:
            old = float(batch.t[-1]) - self._span_s
            gone = int(np.searchsorted(self._table[0, self._begin : self._end], old))
            self._begin += gone
            self._first += gone * self._step

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
            metadata=replace(like.metadata, rate_Hz=None if rate is None else rate / self._step),
            name=like.name,
            origin=like.origin,
        )

    def _halve(self) -> None:
        odd = self._first // self._step % 2
        half = self._table[:, self._begin + odd : self._end : 2].copy()
        self._first += odd * self._step
        self._step *= 2
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
