"""The variance that divides standing still from moving, chosen from the data.

Windows in which the sensor stands still all have nearly the same variance, that of its noise; windows in which it moves
have any variance above it. So the logarithms of the windowed variances have a narrow lowest peak. Its place is the
noise floor, and its lower flank, which no motion reaches, gives its width. The threshold lies five widths above the
peak. For white Gaussian noise the variance of c channels over windows of w samples, each divided by its floor, is
chi-square with nu = c (w - 1) degrees of freedom over nu, whose logarithm has the standard deviation sqrt(2 / nu): the
width is never taken to be less. Real noise is wider, and its threshold is higher.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import chdtrc

from rig.arrays import Array, Mask

#: Widths between the peak of still windows and the threshold.
WIDTHS: Final = 5.0
#: A peak counts from this share of the highest one on: the windows standing still may be that much rarer.
_PEAK_SHARE: Final = 0.1
#: Of the largest variance, that rounding leaves in windows without noise.
_ROUNDING: Final = 1e-12
_PASSES: Final = 4  # the floors of channels settle in two or three
_STEPS_A_WIDTH: Final = 8  # of the histogram
_MOST_BINS: Final = 1 << 16


@dataclass(frozen=True, eq=False)
class Threshold:
    """Where standing still ends.

    Attributes:
        floor: (c,) variance of each channel while still [recorded unit squared].
        limit: the sensor moves where the mean over channels of (variance / floor) exceeds it.
        width: of the peak of still windows, in the logarithm of that mean.
        false_alarm: probability that a window of a sensor standing still exceeds the limit, if its distribution is a
            chi-square of this width. Successive windows overlap: of n samples about n / w are independent.
    """

    floor: Array
    limit: float
    width: float
    false_alarm: float


def choose_threshold(variance: Array, window: int) -> Threshold:
    """Choose the threshold from windowed variances.

    Args:
        variance: (c, m) of channels in windows, a few for each window's length [recorded unit squared].
        window: samples a window.
    """
    least = np.maximum(_ROUNDING * variance.max(axis=1), np.finfo(float).tiny)  # where there is no noise
    variance = np.maximum(variance, least[:, None])
    expected = np.sqrt(2.0 / (len(variance) * (window - 1)))
    tenth = variance.shape[1] // 10
    floor = np.partition(variance, tenth, axis=1)[:, tenth]
    settled: Mask | None = None
    for turn in range(_PASSES + 1):
        activity = (variance / floor[:, None]).mean(axis=0)
        peak, width = _lowest_peak(activity, expected)
        quiet = activity < peak * np.exp(3.0 * width)
        if turn == _PASSES or (settled is not None and (quiet == settled).all()):
            break  # the floors are those of these windows already
        settled = quiet
        floor = variance[:, quiet].mean(axis=1)
    limit = float(peak * np.exp(WIDTHS * width))
    freedom = 2.0 / width**2
    return Threshold(floor, limit, width, float(chdtrc(freedom, freedom * limit / peak)))


def _lowest_peak(activity: Array, expected: float) -> tuple[float, float]:
    """The lowest peak of the distribution of the logarithm: where it is (as activity), and its width.

    Args:
        activity: (m,).
        expected: the width of the peak of white Gaussian noise.
    """
    logarithm = np.log(np.maximum(activity, np.finfo(float).tiny))
    low, high = logarithm.min() - 4.0 * expected, logarithm.max() + 4.0 * expected
    bins = int(min(_MOST_BINS, np.ceil((high - low) * _STEPS_A_WIDTH / expected)))
    step = float(high - low) / bins
    counts = np.bincount(((logarithm - low) / step).astype(np.intp), minlength=bins)
    density = gaussian_filter1d(counts.astype(float), expected / step, mode="constant")
    inner = density[1:-1]
    peaks = (inner > density[:-2]) & (inner >= density[2:]) & (inner >= _PEAK_SHARE * density.max())
    at = float(low) + (1.5 + int(np.argmax(peaks))) * step
    below = logarithm[logarithm < at] - at
    width = float(np.sqrt(np.square(below).mean())) if below.size else 0.0
    return float(np.exp(at)), max(width, expected)
