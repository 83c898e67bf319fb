"""The variance of signals in a sliding window, in one pass: at each sample, at every half window, or summed up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from estimators._rows import working_rows
from rig.arrays import Array
from rig.errors import RigError

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
    return np.array([weighted_variance([values], window, np.ones(1)) for values in channels])


def weighted_variance(channels: Sequence[Array], window: int, weights: Array) -> Array:
    """(n,) the sum over channels of weights (c,) times ``windowed_variance``, at half its cost.

    The weighted squares of all channels have one running sum.
    """
    count, half = len(channels[0]), window // 2
    inside = count - 2 * half  # full windows
    result = np.empty(count)
    scales = np.sqrt(weights * (window / (window - 1)))
    work = working_rows(3, min(_BLOCK, inside) + 2 * half)
    for begin in range(0, inside, _BLOCK):
        size = min(_BLOCK, inside - begin) + 2 * half
        y, mean, squares = work[:, :size]
        squares[:] = 0.0
        full = slice(half, size - half)
        found = result[begin + half : begin + size - half]
        found[:] = 0.0
        for values, scale in zip(channels, scales, strict=True):
            part = values[begin : begin + size]
            np.subtract(part, part[size // 2], out=y)
            y *= scale
            uniform_filter1d(y, window, output=mean)
            y *= y
            squares += y
            mean *= mean
            found -= mean[full]
        uniform_filter1d(squares, window, output=mean)
        found += mean[full]
        np.maximum(found, 0.0, out=found)
    result[:half] = result[half]
    result[count - half :] = result[count - half - 1]
    return result


def variance_by_half_windows(channels: Sequence[Array], window: int) -> tuple[Array, Array]:
    """``windowed_variance`` at samples half, 2 half, .., with half = window // 2, as far as full windows go.

    Returns:
        (c, m) variances [recorded unit squared]; (c, m + 1) means of the halves, which begin at samples 0, half, ..
        [recorded unit].
    """
    count, half = len(channels[0]), window // 2
    steps = (count - 1) // half  # halves, each followed by a sample at least
    result, means_of_all = np.empty((len(channels), steps - 1)), np.empty((len(channels), steps))
    squares = np.empty(steps)
    size = max(1, _BLOCK // half)
    about = np.empty((min(size, steps), half))
    for variance, means, values in zip(result, means_of_all, channels, strict=True):
        rows = values[: steps * half].reshape(steps, half)
        for begin in range(0, steps, size):
            part = slice(begin, min(begin + size, steps))
            origin = rows[begin, 0]
            y = np.subtract(rows[part], origin, out=about[: part.stop - begin])
            mean = np.einsum("ij->i", y) / half
            squares[part] = np.vecdot(y, y) - half * mean * mean
            means[part] = mean + origin
        # both halves of each window, and the sample after them, about the mean of the halves (Chan et al., 1983)
        middle = 0.5 * (means[1:] + means[:-1])
        between = 0.5 * half * np.square(means[1:] - means[:-1])
        last = np.square(values[2 * half :: half][: steps - 1] - middle) * (2 * half / window)
        variance[:] = np.maximum(squares[1:] + squares[:-1] + between + last, 0.0) / (window - 1)
    return result, means_of_all
