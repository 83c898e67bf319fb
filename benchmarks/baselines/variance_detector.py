"""The textbook static detector: the variance of the accelerometer in a window about each sample, against a threshold.

D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, (15)-(16): a sample is static where the length of the vector of the three variances is below a
multiple of that of the first seconds, in which the sensor is known to rest. They try many multiples; this is one pass.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rig.arrays import Array, Mask


def window_by_window(readings: Array, window: int, rest: int, multiple: float) -> Mask:
    """(n,) static or not, as the published programs go about it: one window at a time.

    Args:
        readings: (n, 3).
        window: samples, odd.
        rest: samples at the beginning in which the sensor rests.
        multiple: of the variance at rest.
    """
    half = window // 2
    limit = multiple * float(np.linalg.norm(readings[:rest].var(axis=0)))
    still = np.zeros(len(readings), dtype=bool)
    for centre in range(half, len(readings) - half):
        still[centre] = np.linalg.norm(readings[centre - half : centre + half + 1].var(axis=0)) < limit
    return still


def all_windows_at_once(readings: Array, window: int, rest: int, multiple: float) -> Mask:
    """The same with NumPy's windows, without a loop."""
    half = window // 2
    limit = multiple * float(np.linalg.norm(readings[:rest].var(axis=0)))
    still = np.zeros(len(readings), dtype=bool)
    variances = [sliding_window_view(np.ascontiguousarray(column), window).var(axis=1) for column in readings.T]
    still[half : len(readings) - half] = np.linalg.norm(variances, axis=0) < limit
    return still
