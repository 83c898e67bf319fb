"""Poses and readings on two clocks: how far the one is off the other, by what the readings follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from rig.arrays import Array
from scenarios.importing.tracks import Track

_ROWS: Final = 800
_SEARCH_S: Final = 2.0  # on one clock
_INNER: Final = 0.95
_STEPS: Final = 200
_MOST: Final = 1600
_MUCH: Final = 0.1  # of what the readings vary by, left over: the clocks may be far apart


@dataclass(frozen=True)
class Offset:
    """What has to be added to the times of the poses.

    Attributes:
        seconds, std: the estimate; std infinite where the motion does not tell it.
        gain: how many times the misfit falls by it.
        misfit: what is left, over what the readings vary by.
    """

    seconds: float
    std: float
    gain: float
    misfit: float

    @property
    def told(self) -> bool:
        """Whether the readings tell it at all."""
        return bool(np.isfinite(self.std)) and abs(self.seconds) > 4.0 * self.std and self.gain > 1.02


def clock_offset(reading: Track, pose: Track, rotations: Array, apart: bool, anywhere: bool = False) -> Offset:
    """The offset on one clock, near zero, or ``anywhere``; of clocks ``apart`` any; see ``_searched``.

    Where the misfit near zero is large, or least at the end of what is searched, it is looked for anywhere.
    """
    narrow = None if apart or anywhere else _searched(reading, pose, rotations, False, _SEARCH_S)
    if narrow is not None and narrow.misfit < _MUCH and abs(narrow.seconds) < _INNER * _SEARCH_S:
        return narrow
    half = float(max(np.ptp(reading.t), np.ptp(pose.t))) / 2 if reading.t is not None and pose.t is not None else 0.0
    wide = _searched(reading, pose, rotations, apart, half)
    return wide if narrow is None or wide.misfit < 0.5 * narrow.misfit else narrow


def _searched(reading: Track, pose: Track, rotations: Array, apart: bool, reach: float) -> Offset:
    """The offset at which the readings follow the poses best.

    A reading is affine in the entries of the rotation, whatever gravity, axes and offsets are; the offset with the
    least squared residual of that is taken, its standard deviation from the curvature there.

    Args:
        reading: of the accelerometer or magnetometer.
        pose: with its own times.
        rotations: (n, 9) of the pose's samples.
        apart: whether the clocks have nothing in common: then the search begins where both logs start together.
        reach: how far the search goes [s].
    """
    assert reading.t is not None
    assert pose.t is not None
    turning = Track(pose.log, "rotation", pose.t, rotations)
    base = float(reading.t[0] - pose.t[0]) if apart else 0.0
    reach = reach if apart else min(reach, np.ptp(pose.t) / 2)
    spread = float(np.sum(reading.values.var(axis=0)))
    every = max(1, len(reading.t) // _ROWS)

    def look(offset: float) -> tuple[float, float]:
        """The mean squared residual, and how much less likely than no relation at all: n log(residual / variance)."""
        t = reading.t[::every] - offset  # type: ignore[index]
        inside = (t >= pose.t[0]) & (t <= pose.t[-1])  # type: ignore[index]
        if inside.sum() < 30 or inside.mean() < 0.3:
            return np.inf, np.inf
        table = np.column_stack([np.ones(inside.sum()), turning.at(t[inside])])
        values = reading.values[::every][inside]
        left = values - table @ np.linalg.lstsq(table, values, rcond=1e-9)[0]
        square = float(np.mean(left**2))
        return square, len(values) * float(np.log(max(square, 1e-300) / max(float(values.var(axis=0).mean()), 1e-300)))

    def misfit(offset: float) -> float:
        return look(offset)[0]

    grid = base + np.linspace(-reach, reach, max(_STEPS, min(_MOST, int(4 * reach))) + 1)
    values = np.array([look(offset)[1] for offset in grid])  # a short overlap is not to win by being short
    if not np.isfinite(values).any():
        return Offset(base, np.inf, 1.0, np.inf)
    best, step = grid[int(np.argmin(values))], grid[1] - grid[0]
    fine = minimize_scalar(misfit, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-5})
    seconds, least = float(fine.x), float(fine.fun)
    near = max(2e-3, 0.1 * step)
    curve = (misfit(seconds + near) - 2 * least + misfit(seconds - near)) / near**2
    count = len(reading.t[::every]) * reading.values.shape[1]
    std = float(np.sqrt(2.0 * least / (curve * count))) if curve > 0 and np.isfinite(curve) else np.inf
    gain = float(np.sqrt(misfit(base) / least)) if least > 0 else 1.0
    return Offset(seconds, max(std, 1e-5), gain, float(np.sqrt(least * reading.values.shape[1] / max(spread, 1e-300))))
