"""Rotation matrices of quaternions, fast enough not to be noticed beside the calibration that needs them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rig.arrays import Array


def blocks(quaternion: Array, rows: int) -> Iterator[tuple[slice, Array]]:
    """vec R_base_tool in blocks that stay in the cache: the samples, and (9, m), one column a sample.

    The array is overwritten by the next block.

    Args:
        quaternion: (n, 4), scalar first; the norm need not be exactly one.
        rows: samples a block.
    """
    count = len(quaternion)
    buffer = np.empty((9, min(rows, count)))
    for first in range(0, count, rows):
        span = slice(first, min(first + rows, count))
        block = buffer[:, : span.stop - first]
        _fill(quaternion[span], block)
        yield span, block


def _fill(quaternion: Array, block: Array) -> None:
    w, x, y, z = np.ascontiguousarray(quaternion.T)
    scale = 2.0 / (w * w + x * x + y * y + z * z)
    sx, sy, sz = scale * x, scale * y, scale * z
    xx, yy, zz = sx * x, sy * y, sz * z
    xy, xz, yz = sx * y, sx * z, sy * z
    wx, wy, wz = sx * w, sy * w, sz * w
    np.subtract(1.0, yy + zz, out=block[0])
    np.subtract(xy, wz, out=block[1])
    np.add(xz, wy, out=block[2])
    np.add(xy, wz, out=block[3])
    np.subtract(1.0, xx + zz, out=block[4])
    np.subtract(yz, wx, out=block[5])
    np.subtract(xz, wy, out=block[6])
    np.add(yz, wx, out=block[7])
    np.subtract(1.0, xx + yy, out=block[8])
