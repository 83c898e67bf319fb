"""The arithmetic that several effects share: products, filters with memory, derivatives along a path."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.linalg.lapack import dgtsv, dtbtrs

from rig.arrays import Array

#: Span [s] of the parabola that is fitted to a path for its curvature: at 100 Hz a path known to 0.1 mm gives
#: 0.07 m/s^2, and motions up to 2 Hz keep 97 % of their acceleration.
CURVATURE_SPAN: Final = 0.1

_BLOCK = 16384  # rows at a time, where windows are written out


def times(matrices: Array, right: ArrayLike) -> Array:
    """Matrices (n, 3, 3) times one vector (3,) or one matrix (3, 3), as a single product."""
    other = np.asarray(right)
    return np.asarray((matrices.reshape(-1, 3) @ other).reshape(len(matrices), 3, *other.shape[1:]))


def recursion(decay: Array, drive: Array) -> Array:
    """y[0] = drive[0], y[k] = decay[k-1] y[k-1] + drive[k].

    Solved as the bidiagonal system it is, so that unequal steps cost nothing.

    Args:
        decay: (n - 1,) below one.
        drive: (n, m).
    """
    bands = np.ones((2, len(drive)))
    bands[1, :-1] = -decay
    return np.asarray(dtbtrs(bands, drive, uplo="L")[0])


def gauss_markov(t: Array, tau: float, white: Array) -> Array:
    """(n, m) noise with autocovariance exp(-|lag|/tau) at times t (n,), from white noise (n, m); scaled as that is."""
    lags = np.diff(t) / tau
    drive = white.copy()
    drive[1:] *= np.sqrt(-np.expm1(-2.0 * lags))[:, None]
    return recursion(np.exp(-lags), drive)


def play(x: Array, half_width: float, start: float | None = None) -> Array:
    """The play operator: y[0] = start, y[k] = the point of x[k] -+ half_width that is nearest to y[k-1].

    Each step clamps y to an interval, and clamps upon clamps are a clamp: composed over ever longer spans of samples
    (a prefix scan) they give all y in log n passes, of which only the first few have anything left to do.

    Args:
        x: (n,).
        half_width: not negative.
        start: within half_width of x[0]; None: x[0].
    """
    low, high = x - half_width, x + half_width
    low[0] = high[0] = x[0] if start is None else start
    span = 1
    open_ = np.flatnonzero(low < high)
    while span < len(x) and open_.size:
        open_ = open_[open_ >= span]  # those before reach back to the first sample: settled
        earlier = open_ - span
        below, above = low[open_], high[open_]
        low[open_], high[open_] = np.clip(low[earlier], below, above), np.clip(high[earlier], below, above)
        open_ = open_[low[open_] < high[open_]]
        span *= 2
    return low


def shifted(t: Array, values: Array, at: Array) -> Array:
    """Samples (n, m) at times t (n,) read at other times ``at`` (n,) instead: a cubic spline, held beyond its ends.

    Columns of a sensor that is not there (NaN) stay as they are.
    """
    result = values.copy()
    there = np.flatnonzero(np.isfinite(values[0]))
    at = np.clip(at, t[0], t[-1])
    own = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(len(t) - 2, 0))
    cube, square, slope, level = (power.take(own, axis=1) for power in _spline(t, values[:, there]))
    since = at - t[own]
    result[:, there] = (level + since * (slope + since * (square + since * cube))).T
    return result


def slopes(t: Array, values: Array) -> Array:
    """(n, m) by how much what ``shifted`` reads changes with the time, at that of each sample."""
    result = np.zeros_like(values)
    there = np.flatnonzero(np.isfinite(values[0]))
    cube, square, slope, _ = _spline(t, values[:, there])
    step = t[-1] - t[-2]
    end = slope[:, -1:] + step * (2.0 * square[:, -1:] + 3.0 * step * cube[:, -1:])
    result[:, there] = np.hstack([slope, end]).T
    return result


def _spline(t: Array, values: Array) -> tuple[Array, Array, Array, Array]:
    """The cubic spline through samples (n, m) at times t (n,), as ``CubicSpline`` makes it, whose checks take longer.

    Its slopes solve a tridiagonal system (de Boor, A Practical Guide to Splines, 1978, chapter IV; "not a knot").

    Returns:
        (m, n - 1) coefficients of each interval: cube, square, slope, level, of the time since its start.
    """
    if len(t) < 4 or not values.size:  # LAPACK's solver writes a column where it is given none
        cube, square, slope, level = CubicSpline(t, values, axis=0).c
        return cube.T, square.T, slope.T, level.T
    step, level = np.diff(t), np.ascontiguousarray(values.T)
    before, after = step[:-1], step[1:]
    first, last = step[0] + step[1], step[-2] + step[-1]
    rise = np.diff(level) / step
    right = np.empty_like(level)
    right[:, 1:-1] = 3.0 * (after * rise[:, :-1] + before * rise[:, 1:])
    right[:, 0] = ((step[0] + 2.0 * first) * step[1] * rise[:, 0] + step[0] ** 2 * rise[:, 1]) / first
    right[:, -1] = (step[-1] ** 2 * rise[:, -2] + (2.0 * last + step[-1]) * step[-2] * rise[:, -1]) / last
    middle = np.concatenate([step[1:2], 2.0 * (before + after), step[-2:-1]])
    slopes = dgtsv(np.append(after, last), middle, np.append(first, before), right.T, overwrite_b=True)[3].T
    slope = slopes[:, :-1]
    bend = (slope + slopes[:, 1:] - 2.0 * rise) / step
    return bend / step, (rise - slope) / step - bend, slope, level[:, :-1]


def low_passed(t: Array, values: Array, tau: float) -> Array:
    """The response of tau y' + y = x to samples x (n, m) at times t (n,): exact for the cubic spline through them.

    It starts settled, y[0] = x[0]. As tau goes to zero it goes to x smoothly, however coarse the sampling.
    """
    cube, square, slope, level = _spline(t, values)
    step = np.diff(t)
    # The forced response to a polynomial p is p - tau p' + tau^2 p'' - tau^3 p'''.
    start = level - tau * (slope - tau * (2.0 * square - tau * 6.0 * cube))
    end_slope = slope + step * (2.0 * square + step * 3.0 * cube)
    end = values[1:].T - tau * (end_slope - tau * (2.0 * square + 6.0 * cube * (step - tau)))
    decay = np.exp(-step / tau)
    return recursion(decay, np.column_stack([values[0], end - decay * start]).T)


def curvature(t: Array, path: Array) -> Array:
    """Second derivative (n, m) of samples (n, m) at times t (n,): of the parabola fitted to the samples around each.

    The samples within ``CURVATURE_SPAN`` count; the first and last windows also serve the samples at the ends. Where
    there is but one on either side, the second difference is too small by h^2/12 times the fourth derivative, a mean
    over two steps, and the cubic spline's second derivative too large by as much: it is the mean of both.
    """
    count = len(t)
    if count < 3:
        return np.zeros_like(path)
    steps = np.diff(t)
    half = int(np.clip(round(0.5 * CURVATURE_SPAN / float(np.median(steps))), 1, (count - 1) // 2))
    uniform = np.ptp(steps) <= 1e-6 * steps[0]
    windows = _uniform_windows if uniform else _fitted_windows
    inner = windows(t, path, half)
    if half == 1:
        inner = 0.5 * inner + _spline(t, path)[1].T[1:]
    return np.concatenate([np.repeat(inner[:1], half, axis=0), inner, np.repeat(inner[-1:], half, axis=0)])


def _uniform_windows(t: Array, path: Array, half: int) -> Array:
    offset = np.arange(-half, half + 1, dtype=float)
    square = offset**2 - np.mean(offset**2)
    weights = 2.0 * square / (square @ square) / ((t[-1] - t[0]) / (len(t) - 1)) ** 2
    return np.stack([np.convolve(column, weights, mode="valid") for column in path.T], axis=1)


def _fitted_windows(t: Array, path: Array, half: int) -> Array:
    width = 2 * half + 1
    times = sliding_window_view(t, width)
    values = sliding_window_view(path, width, axis=0)  # (n - 2 half, m, width)
    result = np.empty(values.shape[:2])
    for first in range(0, len(result), _BLOCK):
        rows = slice(first, first + _BLOCK)
        tau = times[rows] - times[rows].mean(axis=1, keepdims=True)
        square = tau**2 - np.mean(tau**2, axis=1, keepdims=True)
        square -= tau * (np.sum(square * tau, axis=1) / np.sum(tau**2, axis=1))[:, None]  # at right angles to 1 and tau
        weights = 2.0 * square / np.sum(square**2, axis=1)[:, None]
        result[rows] = np.einsum("nmw,nw->nm", values[rows], weights)
    return result


def exponential_spectrum(frequency: Array, interval_s: float, tau_s: float) -> Array:
    """The spectrum of noise of variance one with autocovariance exp(-|lag|/tau_s), sampled; white where tau_s is zero.

    Args:
        frequency: (m,) [cycles a sample].
    """
    decay = np.exp(-interval_s / tau_s) if tau_s > 0.0 else 0.0
    return np.asarray((1.0 - decay**2) / (1.0 - 2.0 * decay * np.cos(2.0 * np.pi * frequency) + decay**2))
