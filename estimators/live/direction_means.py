"""Means of residuals by the field's direction in the sensor, over the last minute of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from estimators.coverage import SphereCells, direction_name
from estimators.live.residual_blocks import Blocks
from rig.arrays import Array

#: Directions are told apart by so many cells, over so many parts of so many blocks.
CELLS: Final = 12
PARTS: Final = 6
PART: Final = 100


class ByDirection:
    """The means of one sensor.

    Attributes:
        cells: of the sphere.
    """

    def __init__(self, block: int) -> None:
        """Args: block: samples of a block."""
        self.cells = SphereCells.of(CELLS)
        self._block = block
        self._parts: deque[Array] = deque(maxlen=PARTS)
        self._room = 0

    def add(self, blocks: Blocks) -> Iterator[float]:
        """Take blocks up; the time of the last one [s] whenever a part is whole."""
        k = blocks.sums.shape[1]
        rows = np.hstack([np.ones((len(blocks), 1)), blocks.sums / self._block, blocks.predicted]) * self._block
        places = self.cells.number(blocks.directions)
        first = 0
        while first < len(blocks):
            if not self._room:
                self._parts.append(np.zeros((CELLS, 2 * k + 1)))
                self._room = PART
            chosen = slice(first, first + self._room)
            np.add.at(self._parts[-1], places[chosen], rows[chosen])
            count = len(places[chosen])
            first += count
            self._room -= count
            if not self._room:
                yield float(blocks.t[first - 1])

    def clear(self) -> None:
        """Begin anew."""
        self._parts.clear()
        self._room = 0

    @property
    def whole(self) -> bool:
        """Whether there are all parts."""
        return len(self._parts) == PARTS and not self._room

    @property
    def standardised(self) -> Array:
        """(cells, k) mean residual over its standard deviation in each cell; NaN unseen."""
        if not self._parts:
            return np.full((CELLS, 1), np.nan)
        total = np.sum(self._parts, axis=0)
        k = (total.shape[1] - 1) // 2
        count = np.where(total[:, :1] > 0.0, total[:, :1], np.nan)
        mean, predicted = total[:, 1 : k + 1] / count, total[:, k + 1 :] / count
        return np.asarray(mean / np.sqrt(1.0 / count + predicted))

    def mean_square(self, ratio: float) -> tuple[float, float]:
        """Of the standardised means, and its degrees of freedom where memory makes their mean square ``ratio``.

        What is remembered from one cell to the next moves all alike; degrees of freedom after Satterthwaite, "An
        approximate distribution of estimates of variance components" (1946).
        """
        z = self.standardised
        used = np.isfinite(z).all(axis=1)
        number, k = float(max(used.sum(), 1)), float(z.shape[1])
        degrees = k * (number * ratio) ** 2 / ((1.0 + number * (ratio - 1.0)) ** 2 + number - 1.0)
        return float(np.square(z[used]).sum()) / (k * number), degrees

    @property
    def worst(self) -> str:
        """The direction whose mean strays most."""
        square = np.square(np.nan_to_num(self.standardised)).sum(axis=1)
        return direction_name(self.cells.centres[int(np.argmax(square))])
