"""Stretches of quiet samples, and which of them belong to one pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals that change from pose to pose.

    Attributes:
        columns: c arrays (n,).
        same: (c,) squared differences that are still the same pose: where the mean over c of the differences' squares
            over these exceeds one, it is another.
    """

    columns: Sequence[Array]
    same: Array

    def apart(self, means: Array, others: Array) -> Mask:
        """(m,) whether means (c, m) and others (c, m) are of different poses."""
        rounding = 1e-18 * np.square(np.maximum(np.abs(means).max(axis=1), np.abs(others).max(axis=1)))
        limit = np.maximum(np.maximum(self.same, rounding), np.finfo(float).tiny)
        return np.asarray((np.square(means - others) / limit[:, None]).mean(axis=0) > 1.0)


def stretches_of(quiet: Mask, least: int) -> tuple[Rows, Rows]:
    """First sample and the one after the last of each stretch of at least so many quiet samples."""
    turns = np.flatnonzero(np.diff(quiet)) + 1
    edges = np.concatenate([[0], turns, [len(quiet)]])
    begin = 0 if quiet[0] else 1
    first, stop = edges[begin:-1:2], edges[begin + 1 :: 2]
    long = stop - first >= least
    return first[long], stop[long]


def sums_over(columns: Sequence[Array], first: Rows, stop: Rows) -> Array:
    """(c, s) sum of each of c columns (n,) over each of s stretches."""
    edges = np.stack([first, stop], axis=1).ravel()  # every other result of ``reduceat`` is a stretch's
    if edges[-1] == len(columns[0]):
        edges = edges[:-1]
    return np.array([np.add.reduceat(values, edges)[::2] for values in columns])


def split_where_it_drifts(groups: Sequence[Signals], first: Rows, stop: Rows, window: int) -> tuple[Rows, Rows]:
    """Cut stretches that drift, where a window's mean is no longer near that of the first window since the last cut.

    Args:
        groups: signals, any of which can tell poses apart.
        first, stop: (s,) the stretches.
        window: samples.
    """
    whole = (stop - first) // window
    begins, counts = first[whole > 1], whole[whole > 1]
    if not len(begins):
        return first, stop
    stretch = np.repeat(np.arange(len(begins)), counts)
    place = np.concatenate([[0], np.cumsum(counts)[:-1]])  # of each stretch's first window among all windows
    starts = begins[stretch] + window * (np.arange(len(stretch)) - place[stretch])
    drifting = np.zeros(len(begins), dtype=bool)
    tracks = []
    for group in groups:
        means = sums_over(group.columns, starts, starts + window) / window
        tracks.append((group, means))
        lowest, highest = (bound.reduceat(means, place, axis=1) for bound in (np.minimum, np.maximum))
        drifting |= group.apart(lowest, highest)
    cuts: list[int] = []
    for number in np.flatnonzero(drifting).tolist():
        reference, end = int(place[number]), int(place[number] + counts[number])
        while reference < end:
            rest = slice(reference, end)
            away = np.zeros(end - reference, dtype=bool)
            for group, means in tracks:
                away |= group.apart(means[:, rest], means[:, reference, None])
            if not away.any():
                break
            reference += int(np.argmax(away))
            cuts.append(int(starts[reference]))
    added = np.array(cuts, dtype=np.intp)
    return np.sort(np.concatenate([first, added])), np.sort(np.concatenate([stop, added]))


def poses_of(groups: Sequence[Signals], first: Rows, stop: Rows) -> Rows:
    """(s,) the number of each stretch's pose: the next one where its mean is not in the same place."""
    new = first[1:] == stop[:-1]  # where it was cut
    for group in groups:
        means = sums_over(group.columns, first, stop) / (stop - first)
        new |= group.apart(means[:, :-1], means[:, 1:]) if len(first) > 1 else False
    return np.concatenate([[0], np.cumsum(new)]).astype(np.intp)


def mask_of(count: int, first: Rows, stop: Rows) -> Mask:
    """(n,) whether a sample lies in a stretch."""
    steps = np.zeros(count + 1, dtype=np.int8)
    steps[first] = 1
    steps[stop] -= 1
    return np.asarray(np.cumsum(steps[:-1], dtype=np.int8) > 0)
