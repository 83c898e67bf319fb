"""Proportions with their intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Self

_Z = 1.959964  # two-sided 95 %


@dataclass(frozen=True)
class Rate:
    """A proportion ``hits`` of ``count`` with Wilson's 95 % interval (J. Am. Stat. Assoc. 22, 1927).

    Hits may be fractions, where a part of a point was given; the interval is then the one of a proportion of that size.
    """

    hits: float
    count: int

    @classmethod
    def of(cls, values: Iterable[float]) -> Self:
        """Of values from 0 to 1."""
        listed = list(values)
        return cls(float(sum(listed)), len(listed))

    @property
    def value(self) -> float:
        """The proportion; nan of nothing."""
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper bound; everything is possible of nothing."""
        if not self.count:
            return 0.0, 1.0
        share, n = self.value, self.count
        centre = (share + _Z * _Z / (2 * n)) / (1 + _Z * _Z / n)
        half = _Z / (1 + _Z * _Z / n) * sqrt(max(share * (1 - share), 0.0) / n + _Z * _Z / (4 * n * n))
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        """As ``97 % (90-99) of 61``."""
        if not self.count:
            return "-"
        low, high = self.interval
        return f"{100 * self.value:.0f} % ({100 * low:.0f}-{100 * high:.0f})"
