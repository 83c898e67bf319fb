"""Stretches of quiet samples, and which of them belong to one pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.arrays import Array, Mask, Rows


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


def split_where_it_drifts(groups: Sequence[Signals], first: Rows, stop: Rows, window: int) -> tuple[Rows, Rows, Rows]:
    """Cut stretches that drift, where a window's mean is no longer near that of the first window since the last cut.

    Args:
        groups: signals, any of which can tell poses apart.
        first, stop: (s,) the stretches.
        window: samples; the last of a stretch is longer, by what is left.

    Returns:
        First samples, ends, and the numbers of the poses of the stretches after the cuts: the next one at a cut, and
        where the mean of the stretch is not where the one before was.
    """
    counts = np.maximum((stop - first) // window, 1)
    place = np.concatenate([[0], np.cumsum(counts)])  # of each stretch's first window among all windows
    begins = np.repeat(first - window * place[:-1], counts) + window * np.arange(place[-1])
    ends = begins + window
    ends[place[1:] - 1] = stop
    lengths = ends - begins
    tracks = [(group, sums_over(group.columns, begins, ends)) for group in groups]
    drifting = np.zeros(len(first), dtype=bool)
    for group, sums in tracks:
        means = sums / lengths
        lowest, highest = (bound.reduceat(means, place[:-1], axis=1) for bound in (np.minimum, np.maximum))
        drifting |= group.apart(lowest, highest)
    cuts: list[int] = []
    for number in np.flatnonzero(drifting).tolist():
        reference, end = int(place[number]), int(place[number + 1])
        while reference < end:
            rest = slice(reference, end)
            away = np.zeros(end - reference, dtype=bool)
            for group, sums in tracks:
                means = sums[:, rest] / lengths[rest]
                away |= group.apart(means, means[:, :1])
            if not away.any():
                break
            reference += int(np.argmax(away))
            cuts.append(reference)
    starts = np.sort(np.concatenate([place[:-1], np.array(cuts, dtype=np.intp)]))
    new = np.isin(starts, cuts)
    samples = np.add.reduceat(lengths, starts)
    for group, sums in tracks:
        means = np.add.reduceat(sums, starts, axis=1) / samples
        new[1:] |= group.apart(means[:, :-1], means[:, 1:]) if len(starts) > 1 else False
    return begins[starts], begins[starts] + samples, np.cumsum(new).astype(np.intp)


def mask_of(count: int, first: Rows, stop: Rows) -> Mask:
    """(n,) whether a sample lies in one of disjoint stretches, in order."""
    edges = np.concatenate([[0], np.stack([first, stop], axis=1).ravel(), [count]])
    return np.repeat(np.arange(len(edges) - 1) % 2 == 1, np.diff(edges))
