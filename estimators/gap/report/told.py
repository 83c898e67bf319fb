"""Hypotheses as they are told of: without the effects that are more likely images than causes.

Beside something outside the catalogue an effect may be there as it does part of what that does. Then what it does is no
bound for the others: a lag that stands in for the noise of a path takes the lateness from a latency. The others are
fitted again without it; where either is likely, widths are of both.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from typing import Final

from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.discrepancy import weighed_terms
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.hypothesis import Hypothesis

#: Of an explanation that holds something outside the catalogue, the causes that are told of and fitted.
REPORTED: Final = 0.5
#: Effects that are causes, or images, by more than this are not judged the other way.
_SURE: Final = 0.1


@dataclass(frozen=True)
class Told:
    """A hypothesis as it is told of.

    Attributes:
        weighed: as it was weighed. hypothesis: with the causes alone. kept: the numbers that these have in the former.
        otherwise: the same where the effects that are in doubt are judged the other way; None where none is.
        share: how likely that is.
    """

    weighed: Hypothesis
    hypothesis: Hypothesis
    kept: tuple[int, ...]
    otherwise: Told | None = None
    share: float = 0.0

    def places(self, index: int) -> list[tuple[Hypothesis, int, float]]:
        """Where a label of the hypothesis that was weighed is told of, its number there, and the share of that."""
        effects = len(self.weighed.explanation.members)
        if index >= effects:
            return [(self.hypothesis, index - effects + len(self.kept), 1.0)]
        beside = [] if self.otherwise is None else [self.otherwise]
        there = [each for each in (self, *beside) if index in each.kept]
        if not there:
            return [(self.weighed, index, 1.0)]
        shares = (1.0 - self.share, self.share) if len(there) == 2 else (1.0,)
        return [(each.hypothesis, each.kept.index(index), share) for each, share in zip(there, shares, strict=True)]


def told(weighed: Hypothesis, believed: Sequence[float]) -> Told:
    """A hypothesis without the mean effects that are images.

    Args:
        believed: the probability of each of its labels, mean effects first, where it holds.
    """
    effects = believed[: len(weighed.explanation.members)]
    kept = {index for index, share in enumerate(effects) if share >= REPORTED}
    found = _of(weighed, kept)
    doubted = {index: min(share, 1.0 - share) for index, share in enumerate(effects) if _SURE < share < 1.0 - _SURE}
    if not doubted:
        return found
    share = sum(doubted.values()) / len(doubted)
    return replace(found, otherwise=_of(weighed, kept ^ set(doubted)), share=share)


def _of(weighed: Hypothesis, kept: Set[int]) -> Told:
    """A hypothesis with some of its mean effects."""
    explanation, own = weighed.explanation, tuple(sorted(kept))
    if len(own) == len(explanation.members):
        return Told(weighed, weighed, own)
    members = [explanation.members[index] for index in own]
    found = converged([member.fit for member in members], explanation.data)
    alone = Explanation.of(members, found, explanation.log_prior, explanation.fine)
    terms = tuple(weighed_terms(alone.linear, [each.term for each in weighed.terms]))
    return Told(weighed, replace(weighed, explanation=alone, terms=terms or weighed.terms), own)
