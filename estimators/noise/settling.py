"""Readings of a pose before they have settled: of a slow sensor, or while the arm still swings after it stopped."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import fdtri

from estimators.noise.equivalent_channels import equivalent_channels
from rig.arrays import Array, Mask, Rows

#: Means of fewer readings are not compared: single ones may have long tails.
_SHORTEST: Final = 8
#: The share of a pose in which it may settle; what takes longer is a drift.
_LONGEST: Final = 1.0 / 8.0
#: Poses shorter than this share of the usual length are not asked.
_USUAL: Final = 0.5
#: The chance that poses which have settled are cut, for each length of the means.
_CHANCE: Final = 1e-6


def unsettled(labels: Rows, readings: Array) -> Mask:
    """Which readings of held poses come before the sensors have settled.

    Means of neighbouring stretches differ more at the beginning of the poses than in their later halves: an F test,
    over all poses and channels, for ever longer stretches. Drifts differ alike all along.

    Args:
        labels: (n,) number of the pose, -1 where the arm moves. readings: (n, c), NaN in channels that are not there.

    Returns:
        (n,) mask.
    """
    values = readings[:, np.isfinite(readings).all(axis=0)]
    poses = [rows for number in range(labels.max(initial=-1) + 1) if len(rows := np.flatnonzero(labels == number))]
    usual = float(np.median([len(rows) for rows in poses])) if poses else 0.0
    segments = [values[rows] for rows in poses if len(rows) >= _USUAL * usual]  # pauses tell too little
    longest = int(_LONGEST * min(map(len, segments), default=0))
    length, first = _SHORTEST, 0
    while first + 2 * length <= longest:
        first += length * _different([segment[first:] for segment in segments], length, longest - first)
        length *= 2
    found = np.zeros(len(labels), dtype=bool)
    for rows in poses:
        found[rows[: min(first, int(_LONGEST * len(rows)))]] = True
    return found


def _different(segments: list[Array], length: int, longest: int) -> int:
    """After how many stretches of a length, at the poses' beginning, neighbours differ no more than later.

    Channels that share noise count as so many that do not as scatter as much.
    """
    early, late = [], []
    for segment in segments:
        stretches = segment[: len(segment) // length * length].reshape(-1, length, segment.shape[1]).mean(axis=1)
        steps = np.diff(stretches, axis=0)
        late.append(steps[len(steps) // 2 :])
        early.append(steps[: longest // length])
    typical = np.concatenate(late)
    level = np.mean(typical**2, axis=0)
    there = level > 0.0
    if not there.any():
        return 0
    ratio = np.mean([each[:, there] ** 2 / level[there] for each in early], axis=(0, 2))
    channels = equivalent_channels(typical[:, there])
    limit = fdtri(channels * len(segments), max(0.5 * channels * len(typical), 1.0), 1.0 - _CHANCE)
    above = ratio > limit
    return int(np.argmin(np.append(above, False))) + 1 if above[0] else 0
