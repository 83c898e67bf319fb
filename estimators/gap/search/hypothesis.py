"""A hypothesis: a set of effects under a state of the noise, with or without something that has no name."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from estimators.gap.evidence.states import NoiseState
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.search import robust
from estimators.gap.search.explanation import Explanation
from rig.arrays import Array


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects under a state of the noise, with or without a discrepancy.

    Attributes:
        explanation: the mean effects. state: the noise.
        terms: the discrepancy's terms, the likeliest first; empty without one.
        log_mass: unnormalised.
        further: of each further discrepancy beside the first, its terms, the likeliest first.
    """

    explanation: Explanation
    state: NoiseState
    terms: tuple[Weighed, ...]
    log_mass: float
    further: tuple[tuple[Weighed, ...], ...] = ()

    @property
    def other(self) -> bool:
        """Whether it holds something that the catalogue does not have."""
        return bool(self.terms) or self.state.other

    @property
    def kind(self) -> tuple[tuple[str, ...], str, bool, bool, bool]:
        """Its effects, the floor, and what it has that no catalogue does: of one kind the likeliest is kept."""
        return self.labels, self.state.name, bool(self.terms), self.state.other, bool(self.further)

    @property
    def labels(self) -> tuple[str, ...]:
        """Effects and places, mean and noise."""
        return tuple(sorted((*self.explanation.key, *self.state.labels)))

    @cached_property
    def moments(self) -> tuple[Array, Array]:
        """Of all parameters, in typical sizes: mean less the fitted values (p,), and covariance (p, p)."""
        linear, channels = self.explanation.linear, len(self.explanation.data.columns)
        if self.other:
            return robust.moments(linear, channels, self.terms[0] if self.terms else None)
        return linear.posterior(linear.likeliest)
