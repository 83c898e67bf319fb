"""What the readings themselves show before any model: repeated ones, and ones at the end of the range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import pdtrc

from estimators._json import AsJson
from rig.arrays import Array, Mask

_SAMPLE: Final = 4096
#: A converter's steps are told from a continuous reading where the range has at most this many.
_MOST_STEPS: Final = 1e5
#: Noise of fewer steps than this hides neither repeated readings nor a piled-up end.
_LEAST_NOISE: Final = 0.5
#: Without noise, the end of a sine has 2.41 = 1 + sqrt(2) times the readings of the step before it.
_STEEPEST_END: Final = 2.5
_SIGNIFICANT: Final = 1e-6
#: Two channels are one where they differ by less than this, as a share of their spread: rounding of a factor.
_ALIKE: Final = 1e-7
_FEWEST_ALIKE: Final = 8  # samples of which that is said


@dataclass(frozen=True)
class Repeats(AsJson):
    """Readings that are the same as the one before in all three channels.

    Attributes:
        count, share: of the readings. expected: how many there would be by chance, from the noise and the converter's
            step.
        longest: of equal readings in a row.
        held: readings for each new one: 5 where a 20 Hz sensor is recorded at 100 Hz.
        significant: more than chance explains (false alarms: 1e-6).
    """

    count: int
    share: float
    expected: float
    longest: int
    held: float
    significant: bool


@dataclass(frozen=True)
class Clipped(AsJson):
    """Readings piled up at an end of the range.

    Attributes:
        low, high: (3,) readings at the lowest and at the highest value of each channel, zero where there is no pile-up.
        lowest, highest: (3,) these values [recorded unit].
    """

    low: tuple[int, int, int]
    high: tuple[int, int, int]
    lowest: tuple[float, float, float]
    highest: tuple[float, float, float]

    @property
    def count(self) -> int:
        """All of them."""
        return sum(self.low) + sum(self.high)

    def to_json(self) -> dict[str, Any]:
        """What a calibration's quality holds of it."""
        return {"count": self.count, **super().to_json()}


def repeats(readings: Array, noise: ArrayLike | None = None) -> Repeats:
    """Look for readings that were not made anew.

    Args:
        readings: (n, 3) [recorded unit].
        noise: (3,) standard deviation of a reading; None: from the differences of successive ones.
    """
    n = len(readings)
    same = _same_as_before(readings)
    count = int(same.sum())
    sigma = _noise(readings, same) if noise is None else np.broadcast_to(np.asarray(noise, dtype=float), 3)
    # Two Gaussian readings fall into the same step with the probability step / (2 sigma sqrt(pi)), motion apart.
    steps = np.array([step_of(values) for values in readings.T])
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = np.where(sigma > 0.0, steps / (2.0 * sigma * np.sqrt(np.pi)), 1.0)
    expected = (n - 1) * float(np.prod(np.minimum(np.nan_to_num(chance, nan=1.0), 1.0)))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    longest = int(np.max(edges[1::2] - edges[::2])) + 1 if count else 1
    significant = count > 0 and float(pdtrc(count - 1, max(expected, 1e-300))) < _SIGNIFICANT
    return Repeats(count, count / n, expected, longest, n / (n - count), significant)


def clipped(readings: Array, noise: ArrayLike | None = None, limits: tuple[float, float] | None = None) -> Clipped:
    """Look for readings at the end of the range.

    An end is taken for clipped where significantly more readings have exactly the outermost value than the shape of the
    distribution just inside allows: 2.5 times as many as the fullest of the three steps before it. Where the noise is
    below half a converter's step, poses pile up by themselves, and only known limits are looked at.

    Args:
        readings: (n, 3) [recorded unit].
        noise: as of ``repeats``.
        limits: of the converter or of the sensor, where they are known [recorded unit].
    """
    same = _same_as_before(readings)
    sigma = _noise(readings, same) if noise is None else np.broadcast_to(np.asarray(noise, dtype=float), 3)
    fresh = readings[~same] if same.any() else readings
    counts: list[list[int]] = [[], []]
    ends: list[list[float]] = [[], []]
    for values, deviation in zip(fresh.T, sigma, strict=True):
        step = step_of(values)
        stepped = step > 0.0 and float(np.ptp(values)) / step < _MOST_STEPS
        for side, sign in enumerate((-1.0, 1.0)):
            end = float(sign * np.max(sign * values))
            at = sign * (end - values)  # how far inside
            reach = values[at < 4.5 * step]
            inside = np.rint(sign * (end - reach) / step).astype(int) if step > 0.0 else np.zeros(len(reach), dtype=int)
            bins = np.bincount(inside, minlength=4)[:4]
            expected = _STEEPEST_END * max(int(bins[1:].max()), 0.4) if stepped else 1e-2
            piled = deviation >= _LEAST_NOISE * step and float(pdtrc(int(bins[0]) - 1, expected)) < _SIGNIFICANT
            if limits is not None and bins[0] > 2 and abs(end - limits[side]) <= 1.5 * step:
                piled = True
            counts[side].append(int(bins[0]) if piled else 0)
            ends[side].append(end)
    low, high = ((a, b, c) for a, b, c in counts)
    lowest, highest = ((a, b, c) for a, b, c in ends)
    return Clipped(low, high, lowest, highest)


def copies(readings: Array) -> tuple[tuple[int, int, float], ...]:
    """Channels that are another one's readings: wired or converted twice, or a column copied.

    Args:
        readings: (n, 3) [recorded unit].

    Returns:
        Pairs of columns with the factor from the first to the second; of an offset between them nothing is said.
    """
    if len(readings) <= _FEWEST_ALIKE:
        return ()
    found = []
    with np.errstate(over="ignore", invalid="ignore"):
        deviations = readings - readings.mean(axis=0)
        power = np.einsum("ij,ij->j", deviations, deviations)
        for first, second in ((0, 1), (0, 2), (1, 2)):
            factor = float(deviations[:, first] @ deviations[:, second] / power[first]) if power[first] > 0.0 else 0.0
            left = deviations[:, second] - factor * deviations[:, first]
            if power[second] > 0.0 and float(left @ left) < _ALIKE**2 * power[second]:
                found.append((first, second, factor))
    return tuple(found)


def step_of(values: Array) -> float:
    """The smallest step between different values (n,): the converter's, or next to nothing [recorded unit]."""
    some = np.unique(values[:: max(1, len(values) // _SAMPLE)])
    gaps = np.diff(some)
    gaps = gaps[gaps > 1e-9 * np.abs(some).max()] if len(gaps) else gaps  # the same step to rounding
    return float(gaps.min()) if len(gaps) else 0.0


def _same_as_before(readings: Array) -> Mask:
    same = np.zeros(len(readings), dtype=bool)
    same[1:] = True
    for values in readings.T:
        same[1:] &= values[1:] == values[:-1]
    return same


def _noise(readings: Array, same: Mask) -> Array:
    """(3,) from the differences of successive readings, which slow motion hardly changes (von Neumann)."""
    steps = np.diff(readings, axis=0)[~same[1:]]
    if not len(steps):
        return np.zeros(3)
    return np.asarray(np.median(np.abs(steps), axis=0) / (0.6744897501960817 * np.sqrt(2.0)))
