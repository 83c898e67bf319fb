"""Hypotheses as they are told of: without the effects that are more likely images than causes.

Beside something outside the catalogue an effect may be there as it does part of what that does. Then what it does is no
bound for the others: a lag that stands in for the noise of a path takes the lateness from a latency. The others are
fitted again without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.discrepancy import weighed_terms
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.hypothesis import Hypothesis

#: Of an explanation that holds something outside the catalogue, the causes that are told of and fitted.
REPORTED: Final = 0.5


@dataclass(frozen=True)
class Told:
    """A hypothesis as it is told of.

    Attributes:
        hypothesis: with the causes alone. kept: the numbers that these have in the hypothesis that was weighed.
    """

    hypothesis: Hypothesis
    kept: tuple[int, ...]

    def place(self, weighed: Hypothesis, index: int) -> tuple[Hypothesis, int]:
        """Where a label of the hypothesis that was weighed is told of, and its number there: an image where it was."""
        effects = len(weighed.explanation.members)
        if index >= effects:
            return self.hypothesis, index - effects + len(self.kept)
        return (self.hypothesis, self.kept.index(index)) if index in self.kept else (weighed, index)


def told(weighed: Hypothesis, believed: Sequence[float]) -> Told:
    """A hypothesis without the mean effects that are images.

    Args:
        believed: the probability of each of its labels, mean effects first, where it holds.
    """
    explanation = weighed.explanation
    kept = tuple(index for index in range(len(explanation.members)) if believed[index] >= REPORTED)
    if len(kept) == len(explanation.members):
        return Told(weighed, kept)
    members = [explanation.members[index] for index in kept]
    found = converged([member.fit for member in members], explanation.data)
    alone = Explanation.of(members, found, explanation.log_prior, explanation.fine)
    terms = tuple(weighed_terms(alone.linear, [each.term for each in weighed.terms]))
    return Told(replace(weighed, explanation=alone, terms=terms or weighed.terms), kept)
