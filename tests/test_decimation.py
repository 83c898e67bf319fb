"""Thinning for display: peaks stay, and rows are spread evenly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.decimation import evenly, extremes


@given(
    values=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300).map(np.array),
    at_most=st.integers(2, 80),
)
@settings(max_examples=200, deadline=None)
def test_decimation_keeps_the_extremes_of_every_interval(values: np.ndarray, at_most: int) -> None:
    rows = extremes(values, at_most)
    assert (np.diff(rows) > 0).all()
    assert len(rows) <= max(at_most, 2) + 2
    assert {0, len(values) - 1} <= set(rows)
    assert values[rows].max() == values.max()
    assert values[rows].min() == values.min()
    if len(values) <= at_most:
        assert len(rows) == len(values)
    else:
        edges = np.linspace(0, len(values), max(at_most // 2, 1) + 1).round().astype(int)
        for start, stop in pairwise(edges):
            inside = values[rows[(rows >= start) & (rows < stop)]]
            assert inside.max() == values[start:stop].max()
            assert inside.min() == values[start:stop].min()


@given(count=st.integers(1, 5000), at_most=st.integers(2, 500))
@settings(max_examples=200, deadline=None)
def test_evenly_spread_rows(count: int, at_most: int) -> None:
    rows = evenly(count, at_most)
    assert len(rows) == min(count, at_most)
    assert rows[0] == 0
    assert rows[-1] == count - 1
    assert len(rows) < 2 or (np.diff(rows).min() > 0 and np.ptp(np.diff(rows)) <= 1)
