"""Sufficient statistics of the known-angle model: one pass over the data, after which its length no longer matters.

A reading is linear in the entries of the rotation: V_k = f^T R m_k + delta_k with f the field's unit direction in the
base frame, R = R_base_tool, m_k = S_k |field| P_k (Renk (11), (13), (19)). With x = [vec R, 1], vec by rows, and
theta_k = [vec(f m_k^T), delta_k] this is V_k = x . theta_k, so that the least-squares costs (14), (15), (20), (21) need
the data only through n, sum x x^T, sum x V^T and sum V V^T.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from estimators._rows import working_rows
from rig.arrays import Array, Rows
from rig.errors import RigError
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm.rotation_map import RotationMap


#: Entries of x = [vec R, 1].
ROTATION_TERMS = 10
#: Samples summed at a time: 16 rows of 4,096 doubles are 512 KiB and stay in a core's second-level cache.
BLOCK = 4096

# Products of a unit quaternion (w, x, y, z) in the order of ``_fill_quaternion``: wy, wz, xy, xz, yz, wx, ww, xx, yy,
# zz. Row i holds entry i of [vec R, 1] in terms of them; the matrix is invertible, so sums over one give sums over the
# other.
_ELEMENTS = ((0, 2), (0, 3), (1, 2), (1, 3), (2, 3), (0, 1), (0, 0), (1, 1), (2, 2), (3, 3))
_FROM_QUATERNION = np.array(
    [
        [0, 0, 0, 0, 0, 0, 1, 1, -1, -1],
        [0, -2, 2, 0, 0, 0, 0, 0, 0, 0],
        [2, 0, 0, 2, 0, 0, 0, 0, 0, 0],
        [0, 2, 2, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 1, -1, 1, -1],
        [0, 0, 0, 0, 2, -2, 0, 0, 0, 0],
        [-2, 0, 0, 2, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 2, 2, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 1, -1, -1, 1],
        [0, 0, 0, 0, 0, 0, 1, 1, 1, 1],
    ],
    dtype=float,
)
# Products of two of the first five are products of two others, one of them among the last five: wy wz = ww yz.
_IMPLIED = 5


@dataclass(frozen=True)
class Statistics:
    """What n samples say about the channels of one sensor, or of both.

    They are plain sums, so statistics of disjoint samples add. Rounding: every sum is good to a few units in the last
    place of itself (blocks are summed apart, so a million blocks cost some 1e-13), hence estimates lose about 1e-16
    times the condition of the poses, and a residual RMS below some 5e-8 of the readings' RMS cannot be seen in
    ``square``.

    Attributes:
        count: n.
        gram: (10, 10) sum of x x^T, x = [vec R_base_tool by rows, 1].
        cross: (10, c) sum of x V^T [recorded unit].
        square: (c, c) sum of V V^T [recorded unit squared].
    """

    count: int
    gram: Array
    cross: Array
    square: Array

    @classmethod
    def from_rotations(cls, rotations: ArrayLike, *readings: ArrayLike) -> Self:
        """Sum over recorded orientations.

        Args:
            rotations: (n, 9) vec R_base_tool by rows, or (n, 3, 3).
            readings: one (n, 3) array a sensor [recorded unit]; their channels follow one another.

        Raises:
            RigError: the lengths differ.
        """
        table = np.asarray(rotations, dtype=float)
        table = table.reshape(len(table), 9)

        def fill(start: int, stop: int, rows: Array) -> None:
            rows[:9] = table[start:stop].T
            rows[9] = 1.0

        return cls._of(len(table), _summed(len(table), fill, readings))

    @classmethod
    def from_quaternions(cls, quaternion: ArrayLike, *readings: ArrayLike) -> Self:
        """Sum over recorded tool poses.

        [vec R, 1] is linear in the ten products of a unit quaternion's elements, so these are summed and no matrix is
        formed. A block whose quaternions are not of unit length to 1e-12 (RMS) is normalised.

        Args:
            quaternion: (n, 4) w, x, y, z of R_base_tool.
            readings: one (n, 3) array a sensor [recorded unit]; their channels follow one another.

        Raises:
            RigError: the lengths differ.
        """
        table = np.asarray(quaternion, dtype=float)

        def fill(start: int, stop: int, rows: Array) -> None:
            _fill_quaternion(table[start:stop], rows)

        total = _summed(len(table), fill, readings, _IMPLIED)
        total[:_IMPLIED, :_IMPLIED] = total[_SAME]
        products = cls._of(len(table), total)
        return cls(
            products.count,
            _FROM_QUATERNION @ products.gram @ _FROM_QUATERNION.T,
            _FROM_QUATERNION @ products.cross,
            products.square,
        )

    @classmethod
    def from_joints(cls, rotation_map: RotationMap, q: ArrayLike, *readings: ArrayLike) -> Self:
        """Sum over recorded joint angles, the rotations made block by block and dropped again.

        Args:
            rotation_map: of the arm that was recorded.
            q: (n, N) [rad] joint angles.
            readings: one (n, 3) array a sensor [recorded unit]; their channels follow one another.

        Raises:
            RigError: the lengths differ.
        """
        table = np.asarray(q, dtype=float)
        blocks = rotation_map.blocks(table, BLOCK)

        def fill(start: int, stop: int, rows: Array) -> None:
            rows[:9] = next(blocks)[1]
            rows[9] = 1.0

        return cls._of(len(table), _summed(len(table), fill, readings))

    @classmethod
    def _of(cls, count: int, total: Array) -> Self:
        """From all products (10 + c, 10 + c)."""
        k = ROTATION_TERMS
        return cls(count, total[:k, :k].copy(), total[:k, k:].copy(), total[k:, k:].copy())

    def __add__(self, other: Statistics) -> Self:
        """The statistics of both sets of samples."""
        return type(self)(
            self.count + other.count, self.gram + other.gram, self.cross + other.cross, self.square + other.square
        )

    @property
    def channels(self) -> int:
        """The number c of channels."""
        return int(self.cross.shape[1])

    def select(self, columns: slice) -> Self:
        """The statistics of some channels only: those of one sensor out of both, say."""
        return type(self)(self.count, self.gram, self.cross[:, columns], self.square[columns, columns])


def _summed(
    count: int, fill: Callable[[int, int, Array], None], readings: Sequence[ArrayLike], implied: int = 0
) -> Array:
    """The products (10 + c, 10 + c) of ten rows and the readings, summed block by block.

    Args:
        count: n.
        fill: ``fill(start, stop, rows)`` writes the ten rows (10, stop - start) of samples start to stop.
        readings: (n, 3) each.
        implied: rows whose products with one another are not summed, but left zero.

    Raises:
        RigError: the lengths differ.
    """
    tables = [np.asarray(values, dtype=float) for values in readings]
    for table in tables:
        if table.ndim != 2 or len(table) != count:
            raise RigError(
                f"readings: found an array of shape {table.shape}, expected one row for each of {count} poses"
            )
    size = ROTATION_TERMS + sum(table.shape[1] for table in tables)
    work = working_rows(size, min(BLOCK, count))
    total = np.zeros((size, size))
    # Not rows @ rows.T: of a symmetric product so narrow BLAS takes twice the time of a general one.
    parts = [slice(implied, size)] if implied else [slice(0, size // 2), slice(size // 2, size)]
    with one_blas_thread():
        for start in range(0, count, BLOCK):
            stop = min(start + BLOCK, count)
            rows = work[:, : stop - start]
            fill(start, stop, rows[:ROTATION_TERMS])
            row = ROTATION_TERMS
            for table in tables:
                rows[row : row + table.shape[1]] = table[start:stop].T
                row += table.shape[1]
            for part in parts:
                total[part] += rows[part] @ rows.T
    total[:implied, implied:] = total[implied:, :implied].T
    return total


def _fill_quaternion(quaternion: Array, rows: Array) -> None:
    """The ten products of quaternions (b, 4), divided by their squared length, into rows (10, b)."""
    elements = quaternion.T
    if elements.strides[1] != elements.itemsize:
        elements = np.ascontiguousarray(elements)
    np.multiply(elements[0], elements[2:], out=rows[:2])
    np.multiply(elements[1], elements[2:], out=rows[2:4])
    np.multiply(elements[2], elements[3], out=rows[4])
    np.multiply(elements[0], elements[1], out=rows[5])
    np.multiply(elements, elements, out=rows[6:])
    excess = np.add.reduce(rows[6:])
    excess -= 1.0
    if excess @ excess > len(excess) * 1e-24:
        rows /= 1.0 + excess


def _same_products() -> tuple[Rows, Rows]:
    """Where each product of two of the first ``_IMPLIED`` products of elements stands among those that are summed."""
    summed = {
        tuple(sorted(_ELEMENTS[i] + _ELEMENTS[j])): (i, j)
        for i in range(_IMPLIED, ROTATION_TERMS)
        for j in range(ROTATION_TERMS)
    }
    places = np.array([[summed[tuple(sorted(a + b))] for b in _ELEMENTS[:_IMPLIED]] for a in _ELEMENTS[:_IMPLIED]])
    return places[..., 0], places[..., 1]


_SAME = _same_products()
