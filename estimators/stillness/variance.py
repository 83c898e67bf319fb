"""The variance of a signal in a sliding window, in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from rig.errors import RigError

Array = NDArray[np.float64]

_BLOCK: Final = 16384  # samples: a block's few arrays stay in the second-level cache


def windowed_variance(channels: Sequence[Array], window: int) -> Array:
    """The variance of each channel over a window centred on each sample.

    Running sums of the signal and of its square, so that the cost does not grow with the window. They begin anew with
    every block, about a sample of that block, so that rounding does not grow with the length of the recording: the
    result is good to some 1e-13 of the squared range within a block (about 16,000 samples).

    Args:
        channels: c arrays (n,) [recorded unit].
        window: samples, odd, at least 3 and at most n.

    Returns:
        (c, n) [recorded unit squared], unbiased (divided by window - 1). Half a window from either end, where no full
        window is centred, the nearest full one stands.

    Raises:
        RigError: the window is even, too short or longer than the signal.
    """
    count = len(channels[0])
    if window < 3 or window % 2 == 0 or window > count:
        raise RigError(f"window: found {window} samples of {count}, expected an odd number, 3 or more, at most as many")
    half = window // 2
    inside = count - 2 * half  # full windows
    result = np.empty((len(channels), count))
    centred = np.empty(min(_BLOCK, inside) + 2 * half)
    squares, mean, mean_square = np.empty_like(centred), np.empty_like(centred), np.empty_like(centred)
    for begin in range(0, inside, _BLOCK):
        size = min(_BLOCK, inside - begin) + 2 * half
        y, yy, m, mm = centred[:size], squares[:size], mean[:size], mean_square[:size]
        full = slice(half, size - half)
        for channel, values in enumerate(channels):
            part = values[begin : begin + size]
            np.subtract(part, part[size // 2], out=y)
            np.multiply(y, y, out=yy)
            uniform_filter1d(y, window, output=m)
            uniform_filter1d(yy, window, output=mm)
            m *= m
            mm -= m
            np.maximum(mm[full], 0.0, out=result[channel, begin + half : begin + size - half])
    result[:, half : count - half] *= window / (window - 1)
    result[:, :half] = result[:, half, None]
    result[:, count - half :] = result[:, count - half - 1, None]
    return result
