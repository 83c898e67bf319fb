"""The set that is likeliest by itself, where something without a name or noise that all channels share leads."""

from __future__ import annotations

from typing import Final

from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.weighing import HARDLY, Weighing, of_all_channels

#: So many sets at most are weighed beside these, one after another.
_ROUNDS: Final = 3


def weigh_likeliest_alone(work: Weighing) -> None:
    """Weigh the set that is likeliest with neither beside something without a name and noise that all channels share.

    Where these lead, all that is weighed without them is far behind; a set that comes up late, as a state of the noise
    is learned beside it, would never be weighed with them.
    """
    for _ in range(_ROUNDS):
        leading, every = work.leading, list(work.hypotheses.values())
        alone, beside = filter(_alone, every), [one for one in every if not _alone(one)]
        likeliest = max(alone, key=lambda one: one.log_mass)
        same = [one for one in beside if one.explanation.key == likeliest.explanation.key]
        if _alone(leading) or any(one.state.steps is likeliest.state.steps for one in same):
            return
        others = [one.log_mass for one in every if _alone(one) and _same(one, leading)]
        if likeliest.log_mass < max(others, default=float("-inf")) + HARDLY:
            return
        work.moved([likeliest], likeliest.state)


def _alone(one: Hypothesis) -> bool:
    return not one.terms and not of_all_channels(one.state)


def _same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether they are of one set under one floor."""
    return one.explanation.key == other.explanation.key and one.state.name == other.state.name
