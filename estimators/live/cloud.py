"""Where the readings lie, thinned to a bounded number of places: what coverage is told from while the sensor turns.

The readings' space is cut into cubes, and each cube in which a reading fell keeps their number and their mean. Nothing
has to be known of the sensor: through whatever is estimated of it later, the means become directions of the field.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.arrays import Array

Key = tuple[int, int, int]

#: Cubes over the largest extent of the readings: a sphere across them touches some 1,900 cubes of 5.5 degrees.
_ACROSS: Final = 24
#: Cubes kept at most; beyond it those seen longest ago go.
_MOST: Final = 8192


class Cloud:
    """The cubes of one sensor.

    Attributes:
        low, high: (3,) the extent of the readings so far [recorded unit].
    """

    def __init__(self, span_s: float | None = None) -> None:
        """Args: span_s: readings older than this are forgotten [s]; None: none."""
        self._span_s = span_s
        self._size = 0.0
        self._cubes: dict[Key, Array] = {}  # count, sum of readings (3), time of the last
        self.low = np.full(3, np.inf)
        self.high = np.full(3, -np.inf)

    def __len__(self) -> int:
        """How many cubes."""
        return len(self._cubes)

    def add(self, t_s: float, readings: Array) -> None:
        """Readings (n, 3), the last of them of time ``t_s``."""
        self.low = np.minimum(self.low, readings.min(axis=0))
        self.high = np.maximum(self.high, readings.max(axis=0))
        extent = float((self.high - self.low).max())
        if not extent > 0.0:
            extent = max(1e-9, 1e-9 * float(np.abs(readings).max()))
        if extent > self._size * _ACROSS:
            self._grow(extent)
        keys = np.floor(readings / self._size).astype(np.int64)
        self._merge(keys, np.ones(len(readings)), readings, np.full(len(readings), t_s))
        if self._span_s is not None:
            old = t_s - self._span_s
            self._cubes = {key: row for key, row in self._cubes.items() if row[4] >= old}
        if len(self._cubes) > _MOST:
            latest = sorted(self._cubes.items(), key=lambda item: -float(item[1][4]))[:_MOST]
            self._cubes = dict(latest)

    def _grow(self, extent: float) -> None:
        """Larger cubes, by a factor of two at least."""
        self._size = max(2.0 * extent / _ACROSS, 2.0 * self._size)
        if self._cubes:
            table = np.array(list(self._cubes.values()))
            self._cubes = {}
            means = table[:, 1:4] / table[:, :1]
            self._merge(np.floor(means / self._size).astype(np.int64), table[:, 0], means, table[:, 4])

    def _merge(self, keys: NDArray[np.int64], counts: Array, means: Array, times: Array) -> None:
        base = keys.min(axis=0)
        width = keys.max(axis=0) - base + 1
        flat = ((keys[:, 0] - base[0]) * width[1] + keys[:, 1] - base[1]) * width[2] + keys[:, 2] - base[2]
        places, rows, inverse = np.unique(flat, return_index=True, return_inverse=True)
        number = len(places)
        weighted = counts[:, None] * means
        sums = np.stack([np.bincount(inverse, weighted[:, axis], number) for axis in range(3)], axis=1)
        total = np.bincount(inverse, counts, number)
        latest = np.full(number, -np.inf)
        np.maximum.at(latest, inverse, times)
        for place, key in enumerate(map(tuple, keys[rows].tolist())):
            row = self._cubes.setdefault(key, np.zeros(5))
            row[0] += total[place]
            row[1:4] += sums[place]
            row[4] = max(row[4], latest[place])

    @property
    def means(self) -> Array:
        """(m, 3) mean reading of each cube [recorded unit]."""
        table = self._table
        return np.asarray(table[:, 1:4] / table[:, :1])

    @property
    def counts(self) -> Array:
        """(m,) readings in each cube."""
        return np.asarray(self._table[:, 0])

    @property
    def _table(self) -> Array:
        return np.array(list(self._cubes.values())).reshape(-1, 5)
