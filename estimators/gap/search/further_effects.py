"""Effects beside something without a name: one more, and one in the place of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from estimators.gap.evidence.weighed import Weighed
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.hypothesis import Hypothesis


def further_effects(
    leading: Hypothesis, nameless: Sequence[Hypothesis], search: Search, asked_for: bool, least: float
) -> Iterator[Explanation]:
    """One effect more beside what leads with a discrepancy, and one in the place of each of its effects: beside the
    same discrepancy, and beside that which is likeliest without it, as that may do what the effect did.

    A discrepancy that the data do not ask for has nothing beside it that would not be there without it.

    Args:
        nameless: hypotheses with a discrepancy under the same state of the noise.
        asked_for: whether the discrepancy beside what leads is likelier than none by more than chance, its prior aside.
        least: log mass without an effect from which on others are tried in its place all the same.
    """
    first = leading.terms[0].on_means
    if asked_for:
        yield from search.beside(leading.explanation, first)
    for rest in search.without_one(leading.explanation):
        every = [one for one in nameless if one.explanation.key == rest.key]
        own = max(every, key=lambda one: one.log_mass, default=None)
        if own is not None and (asked_for or own.log_mass > least):
            yield from search.beside(rest, own.terms[0].on_means)
        if asked_for and (own is None or _named(own.terms[0]) != _named(leading.terms[0])):
            yield from search.beside(rest, first)


def _named(one: Weighed) -> tuple[str, str]:
    return one.term.source, one.term.course
