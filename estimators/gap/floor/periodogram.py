"""Periodograms of readings at rest, and what exponentially correlated noise leads one to expect of them.

The likelihood of a periodogram against its own expectation, with the leakage of a finite segment in it, is the debiased
Whittle likelihood (Sykulski, Olhede, Guillaumin, Lilly, Early, Biometrika 106, 2019): many times as quick as that of
the samples, and close to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rig.arrays import Array

#: Frequencies whose logarithms differ by less are added up.
_ALIKE: Final = 0.03


@dataclass(frozen=True)
class Periodogram:
    """Power of segments of one length, about their means, added up over neighbouring frequencies.

    Attributes:
        length: samples a segment.
        frequency: (b,) [rad a sample] mean of each group.
        power: (b,) sum of the group's ordinates; white noise of variance one has one each.
        counts: (b,) ordinates in the group.
    """

    length: int
    frequency: Array
    power: Array
    counts: Array

    @classmethod
    def of(cls, segments: Sequence[Array]) -> Self:
        """Of segments (n,), cut into pieces as long as most of them are; shorter ones are left out."""
        length = int(np.quantile([len(segment) for segment in segments], 0.25))
        pieces = [
            segment[first : first + length]
            for segment in segments
            for first in range(0, len(segment) - length + 1, length)
        ]
        table = np.stack(pieces)
        table = table - table.mean(axis=1, keepdims=True)
        power = np.abs(np.fft.rfft(table, axis=1)[:, 1 : (length + 1) // 2]) ** 2 / length
        number: Array = np.arange(1.0, power.shape[1] + 1.0)
        group = np.unique((np.log(number) / _ALIKE).astype(int), return_inverse=True)[1]
        many = _sums(group, np.ones(len(group)))
        frequency = 2.0 * np.pi * _sums(group, number) / (many * length)
        return cls(length, frequency, _sums(group, power.sum(axis=0)), many * len(pieces))

    def loss(self, parts: Sequence[tuple[float, float]]) -> float:
        """Minus twice the log likelihood, up to a constant, at the most likely variance.

        0 of segments of less than three samples, which have no frequency.

        Args:
            parts: of the exponentially correlated noise, the share of the variance and the correlation from sample to
                sample; the rest is white.
        """
        expected = sum((share * self.exponential(decay) for share, decay in parts), start=np.zeros_like(self.power))
        expected = expected + (1.0 - sum(share for share, _ in parts))
        total = float(self.counts.sum())
        if total == 0.0:
            return 0.0
        scale = float(np.sum(self.power / expected)) / total
        return 2.0 * (total * float(np.log(max(scale, 1e-300))) + float(self.counts @ np.log(expected)))

    def exponential(self, decay: float) -> Array:
        """(b,) the expected periodogram of correlations decay^|lag|: their sum under the segment's triangle."""
        z = decay * np.exp(-1j * self.frequency)
        half = 1.0 / (1.0 - z) - z * (1.0 - decay**self.length) / (self.length * (1.0 - z) ** 2)
        return np.asarray(2.0 * half.real - 1.0)


def _sums(group: NDArray[np.intp], values: Array) -> Array:
    return np.asarray(np.bincount(group, values), dtype=float)
