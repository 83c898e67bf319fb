"""Which readings are used: repeated and all-zero ones are not measurements of their own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rig.arrays import Array, Rows
from rig.errors import RigError


@dataclass(frozen=True)
class Dropped:
    """How many readings were left out, and why.

    Attributes:
        repeated: equal to the reading before in all three channels, as a sensor read faster than it converts gives.
        zero: zero in all three channels, as a driver gives that has nothing to give.
        outliers: further from the ellipsoid than noise can be.
    """

    repeated: int = 0
    zero: int = 0
    outliers: int = 0

    def __str__(self) -> str:
        """In words; empty if none."""
        found = ((self.repeated, "repeated"), (self.zero, "all-zero"), (self.outliers, "outlying"))
        return ", ".join(f"{count} {what}" for count, what in found if count)


def check_finite(readings: Array, name: str) -> None:
    """Raise RigError for the first reading (3,) of (n, 3) that is not finite."""
    bad = np.flatnonzero(~np.isfinite(readings).all(axis=1))
    if bad.size:
        raise RigError(f"{name}: reading {bad[0]} is {readings[bad[0]]}, expected finite numbers")


def usable(readings: Array) -> tuple[Rows | None, Dropped]:
    """The rows to use, or None for all of them, and what the others are.

    Args:
        readings: (n, 3), one after the other in time.
    """
    first = readings[:, 0].copy()
    same = first[1:] == first[:-1]
    if first.all() and not same.any():
        return None, Dropped()
    again, zero = np.flatnonzero(same), np.flatnonzero(first == 0.0)
    again = again[(readings[again + 1, 1:] == readings[again, 1:]).all(axis=1)] + 1
    zero = zero[(readings[zero] == 0.0).all(axis=1)]
    if not again.size and not zero.size:
        return None, Dropped()
    keep = np.ones(len(readings), dtype=bool)
    keep[again] = False
    repeated = int(np.setdiff1d(again, zero).size)
    keep[zero] = False
    return np.flatnonzero(keep), Dropped(repeated=repeated, zero=int(zero.size))


@lru_cache(maxsize=16)
def spread_rows(count: int, wanted: int) -> Rows | None:
    """``wanted`` row numbers, one from each of as many equal stretches of ``count``; None for all of them.

    Which one is drawn, always the same way: equal steps would see the same few poses of readings that repeat a cycle.
    """
    if count <= wanted:
        return None
    within = np.random.default_rng(0).random(wanted)
    rows = ((np.arange(wanted) + within) * (count / wanted)).astype(np.intp)
    rows.flags.writeable = False
    return rows
