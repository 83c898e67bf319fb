"""A term of the discrepancy, weighed beside a set of effects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import log

import numpy as np

from estimators.gap.evidence.terms import Term
from rig.arrays import Array


@dataclass(frozen=True)
class Weighed:
    """A term beside a set of effects.

    Attributes:
        term: the source and course.
        gains: (8,) log evidence at each amplitude beyond that without the term.
        log_share: of the terms of its kind, among all kinds.
    """

    term: Term
    gains: Array
    log_share: float = 0.0

    @cached_property
    def log_mass(self) -> float:
        """With the term's prior, amplitudes averaged."""
        averaged = float(np.logaddexp.reduce(self.gains)) - log(len(self.gains))
        return self.term.log_prior + self.log_share + averaged

    @property
    def on_means(self) -> Weighed:
        """As it was on means, where it is of samples: enough to rank what effects explain beside it."""
        return self if self.term.of_means is None else replace(self, term=self.term.of_means)
