"""Working memory as the processor's caches like it."""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array

_LINE: Final = 8  # doubles of a cache line
_APART: Final = 9 * _LINE  # beyond a row: rows a power of two apart would share their places in the caches


def working_rows(rows: int, columns: int) -> Array:
    """(rows, columns), not initialised; each row begins with a cache line.

    NumPy's own memory begins a quarter into one, so that every vector of eight doubles lies in two: sums of products
    over rows that stay in the second-level cache then take up to one and a half times as long.
    """
    apart = -(-columns // _LINE) * _LINE + _APART
    memory = np.empty(rows * apart + _LINE)
    first = -(memory.__array_interface__["data"][0] // memory.itemsize) % _LINE
    return memory[first : first + rows * apart].reshape(rows, apart)[:, :columns]
