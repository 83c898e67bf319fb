"""What sources would leave along courses that only a residual tells: what repeats, jumps, two levels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.terms import Term
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array


@dataclass(frozen=True)
class FittedCourses(ABC):
    """One kind of such courses, of every source.

    Attributes:
        data: sample by sample. every: the sources of it. shares: of each the log prior of one course.
        stepping: names of the sources of which the catalogue has single steps.
    """

    data: WhitenedData
    every: Sequence[Source]
    shares: Sequence[float]
    stepping: frozenset[str] = frozenset()

    @abstractmethod
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """The sources that explain most of a residual, each along the course that does.

        Args:
            left: (c n,) whitened, with the calibration projected out.
            least: log mass below which a term is not made.
        """


def worth(square: float, freedoms: int) -> float:
    """About the log evidence of what explains such a square of whitened residuals with so many numbers, at their
    likeliest amplitude."""
    return 0.5 * (square - freedoms - freedoms * log(max(square / freedoms, 1.0)))
