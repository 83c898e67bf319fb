"""Sums over all samples, or over the last seconds of them, in constant memory."""

from __future__ import annotations

from collections import deque
from functools import reduce
from operator import add
from typing import Final

import numpy as np

from estimators.known_angle.statistics import Statistics

#: The window slides in steps of this share of itself.
STEP: Final = 0.05


class SlidingSum:
    """The sum of parts that come one after another; with a span, of those of the last ``span_s`` seconds only.

    Old parts are dropped, never subtracted, so that rounding does not build up. The window is a twentieth of the span
    longer at most.

    Attributes:
        forgotten_s: samples up to this time do not count any more [s].
    """

    def __init__(self, span_s: float | None = None) -> None:
        """Args: span_s [s]; None: everything."""
        self._span_s = span_s
        self.forgotten_s = -np.inf
        self._older: deque[tuple[float, Statistics]] = deque()  # the time of the last sample of each, and its sum
        self._begun_s = 0.0
        self._newest: Statistics | None = None

    def add(self, t_s: float, part: Statistics) -> None:
        """A part whose last sample is of time ``t_s`` [s]."""
        if self._newest is None:
            self._newest, self._begun_s = part, t_s
            return
        self._newest = self._newest + part
        if self._span_s is None:
            return
        if t_s - self._begun_s >= STEP * self._span_s:
            self._older.append((t_s, self._newest))
            self._newest = None
        while self._older and self._older[0][0] < t_s - self._span_s:
            self.forgotten_s, _ = self._older.popleft()

    @property
    def total(self) -> Statistics | None:
        """The sum; None where nothing has come."""
        parts = [part for _, part in self._older] + ([] if self._newest is None else [self._newest])
        return reduce(add, parts) if parts else None
