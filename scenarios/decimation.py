"""Fewer samples to look at: evenly taken ones for poses, extremes for series, means of blocks for what noise hides."""

from __future__ import annotations

import numpy as np

from rig.arrays import Array, Rows


def evenly(count: int, at_most: int) -> Rows:
    """Row numbers (m,), m = min(count, at_most), spread evenly from the first row to the last."""
    if count <= at_most:
        return np.arange(count)
    return np.linspace(0, count - 1, at_most).round().astype(np.intp)


def means_of_blocks(values: Array, at_most: int) -> Array:
    """Means (m, ...), m = min(n, at_most), of values (n, ...) over blocks of successive samples, all about as long."""
    return np.stack([block.mean(axis=0) for block in np.array_split(values, min(at_most, len(values)))])


def gone_by(t: Array, rows: Rows) -> Array:
    """The share (m,) of the time from first to last of times (n,) [s] that has gone by at rows (m,)."""
    return np.asarray(t[rows] - t[0]) / max(float(t[-1] - t[0]), 1e-9)


def extremes(values: Array, at_most: int) -> Rows:
    """Row numbers (m,), ascending, at which a series is to be drawn so that no peak is lost.

    Up to ``at_most`` samples are all kept. A longer series is cut into intervals of equally many samples, half as many
    as ``at_most``, and each gives its lowest and its highest sample; the first and the last sample are kept as well.

    Args:
        values: (n,).
        at_most: number of samples wanted, at least 2; two more may come.
    """
    count = len(values)
    if count <= at_most:
        return np.arange(count)
    intervals = max(at_most // 2, 1)
    edges = np.linspace(0, count, intervals + 1).round().astype(np.intp)
    width = int(np.diff(edges).max())
    rows = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)  # a short interval repeats its last row
    table = values[rows]
    line = np.arange(intervals)
    return np.unique(
        np.concatenate([rows[line, table.argmin(axis=1)], rows[line, table.argmax(axis=1)], [0, count - 1]])
    )
