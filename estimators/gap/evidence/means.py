"""Whitened samples as sums over neighbours, which slow errors outlive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array


@dataclass(frozen=True)
class Means:
    """Sums over neighbours, scaled so that white noise keeps its variance of one.

    Attributes:
        fine: sample by sample. rough: the data of means over so many neighbours, for what courses follow.
    """

    fine: WhitenedData
    rough: WhitenedData

    @property
    def of_single(self) -> bool:
        """Whether each is of a single sample."""
        return self.rough is self.fine

    @property
    def exact(self) -> bool:
        """Whether what sources along slow courses do to them is what whitening that sample by sample would make."""
        return self.of_single and self.fine.only_scaled

    @property
    def count(self) -> int:
        """Sums a channel."""
        return self.rough.count

    def __call__(self, columns: Array) -> Array:
        """Whitened columns (c n, k) as (c m, k)."""
        if self.of_single:
            return columns
        by_channel = columns.T.reshape(-1, len(self.fine.columns), self.fine.count)
        found = np.empty((*by_channel.shape[:2], self.count))
        for fine, own in zip(self.fine.stretches, self.rough.stretches, strict=True):
            count = own.stop - own.start
            size = (fine.stop - fine.start) // count
            cut = by_channel[:, :, fine.start : fine.start + count * size]
            found[:, :, own] = cut.reshape(*found.shape[:2], count, size).sum(axis=3) / np.sqrt(size)
        return found.reshape(len(found), -1).T

    def spread(self, sums: Array) -> Array:
        """(c n,) of sums (c m,): what each sample has of them where neighbours are alike."""
        if self.of_single:
            return sums
        by_channel = sums.reshape(len(self.fine.columns), self.count)
        found = np.zeros((len(by_channel), self.fine.count))
        for fine, own in zip(self.fine.stretches, self.rough.stretches, strict=True):
            size = (fine.stop - fine.start) // (own.stop - own.start)
            each = np.repeat(by_channel[:, own] / np.sqrt(size), size, axis=1)
            found[:, fine.start : fine.start + each.shape[1]] = each
        return found.ravel()
