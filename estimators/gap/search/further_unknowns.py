"""Where something without a name is likely, further such things beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.evidence.amplitudes import between_steps
from estimators.gap.evidence.discrepancy import Discrepancies, left_beside, total, weighed, weighed_terms
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.states import NoiseState
from estimators.gap.evidence.terms import Term
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.prior import FURTHER_UNKNOWN
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.weighing import FAR, KEPT, Weighing, of_all_channels

#: Log probability of a second such thing, and of each further one: things are rarely alone.
SECOND: Final = float(np.log(FURTHER_UNKNOWN))
#: Log odds against the leading hypothesis within which a discrepancy may have a second one beside it, or in a cause's
#: place.
_DOUBTED: Final = 3.0
#: So many further things at most, and so many hypotheses are weighed without each of their causes.
_MOST, _ROUNDS = 8, 3


def weigh_further(work: Weighing) -> None:
    """Where something without a name is likely, ever one more such thing in what the others leave: beside what leads,
    and in the place of each cause, and of noise that all channels share, that was found beside it. Under other noise,
    which may be that second thing, beside what leads there.

    A discrepancy that the data do not ask for has no second one beside it. What two could explain is the first one's
    alone: each further one is rather too unlikely than too likely.
    """
    likely = [one for one in _likeliest(work) if one.log_mass > work.best - FAR and work.asked_for(one)]
    if not likely or likely[0].log_mass < work.best - _DOUBTED:
        return
    for leading in likely:
        discrepancies = _discrepancies(work, leading)
        work.enter(_with_further(work, leading, discrepancies))
    tried: list[Hypothesis] = []
    while len(tried) < _ROUNDS and (one := following(work, tried)) is not None:
        tried.append(one)
        discrepancies = _discrepancies(work, one)
        for rest in _rests(work, one, discrepancies):
            ways = [_with_further(work, rest, discrepancies)]
            same = first_as(rest, one)
            if one.further or same.terms[0] is not rest.terms[0]:  # or what was found beside it, in that order
                ways.append(_with_further(work, same, discrepancies, one.further))
            work.enter(max(ways, key=lambda each: each.log_mass))


def following(work: Weighing, tried: Sequence[Hypothesis]) -> Hypothesis | None:
    """The likeliest hypothesis with a discrepancy and a cause, or noise that all channels share, of those not tried yet
    and nearly as likely as what leads; None where there is none.

    Not what leads alone: causes that stand for several errors without a name go one after another.
    """
    near = [
        one
        for one in work.hypotheses.values()
        if one.terms and (one.explanation.members or of_all_channels(one.state))
        if one.log_mass > work.best - _DOUBTED and not any(one is each for each in tried)
    ]
    return max(near, key=lambda one: one.log_mass, default=None)


def _likeliest(work: Weighing) -> list[Hypothesis]:
    """Under each state of the noise, the likeliest hypothesis with a discrepancy."""
    found: dict[tuple[int, tuple[str, ...]], Hypothesis] = {}
    for one in sorted(work.hypotheses.values(), key=lambda each: -each.log_mass):
        if one.terms:
            found.setdefault((id(one.state.steps), one.state.labels), one)
    return list(found.values())


def without_common(work: Weighing, leading: Hypothesis) -> NoiseState:
    """The state of the noise of a hypothesis, without what all channels share."""
    state = leading.state
    if not of_all_channels(state):
        return state
    own = replace(state, fitted=state.fitted[:-1])
    known = (each.state for each in work.hypotheses.values() if each.state.steps is own.steps)
    return next((each for each in known if each.labels == own.labels), own)


def _discrepancies(work: Weighing, leading: Hypothesis) -> Discrepancies:
    state = without_common(work, leading)
    return work.discrepancies_under(state, work.scanner.stepped(state.steps))


def _rests(work: Weighing, leading: Hypothesis, discrepancies: Discrepancies) -> Iterator[Hypothesis]:
    """A hypothesis without each of its causes, and without noise that all channels share."""
    state, labels = without_common(work, leading), leading.state.labels
    if labels != state.labels:
        yield from work.enter_nameless(leading.explanation, state, discrepancies)[:1]
    for rest in work.search(state, work.scanner.stepped(state.steps)).without_one(leading.explanation):
        entered = work.enter_nameless(rest, state, discrepancies)
        yield from (one for one in entered if one.state.labels == labels)


def first_as(rest: Hypothesis, leading: Hypothesis) -> Hypothesis:
    """With the first thing that another hypothesis has, where it is one of its own, alone."""
    first = _name(leading.terms[0].term)
    own = [one for one in rest.terms if _name(one.term) == first][:1]
    if not own:
        return rest
    every, taken = (total([one.log_mass for one in terms]) for terms in (rest.terms, own))
    return replace(rest, terms=tuple(own), log_mass=rest.log_mass - every + taken)


def _with_further(
    work: Weighing, found: Hypothesis, discrepancies: Discrepancies, before: Sequence[Sequence[Weighed]] = ()
) -> Hypothesis:
    """With as many further things without a name as are likelier than fewer, at least one.

    Args:
        before: those that come first, in this order: what was found beside another hypothesis.
    """
    whole = found.explanation.linear
    less = left_beside(whole, found.terms[0], discrepancies)
    if less.averaged[0] < whole.averaged[0]:
        return found  # causes and discrepancy all but cancel: what is left of both is more than there was
    if of_all_channels(found.state):
        less = _beside_common(work, found, less, discrepancies)
    every, log_mass, fixed = list[tuple[Weighed, ...]](), found.log_mass, {_name(one) for one in discrepancies.terms}
    there = {_name(found.terms[0].term)} & fixed
    while len(every) < _MOST:
        if len(every) < len(before):
            terms = _again(less, before[len(every)])
        else:  # a term that leaves it far behind need not be weighed, nor if others that gain as much are to come
            behind = work.best - FAR - log_mass
            least = behind / (_MOST - len(every)) - SECOND if behind > 0.0 else min(behind - SECOND, 0.0)
            terms = weighed(less, discrepancies, least=least)
            terms = [one for one in terms if _name(one.term) not in there]  # that is the same thing once more
        gained = SECOND + total([one.log_mass for one in terms])
        if not terms or (every and gained < 0.0):
            break
        every.append(tuple(terms[:KEPT]))
        there |= {_name(terms[0].term)} & fixed
        log_mass += gained
        # those that are looked for gain less one after another
        hopeless = log_mass + (_MOST - len(every)) * gained < work.best - FAR
        if gained < 0.0 or (hopeless and len(every) >= len(before)):
            break
        less = left_beside(less, terms[0], discrepancies)
    return replace(found, log_mass=log_mass, further=tuple(every))


def _name(term: Term) -> tuple[str, str]:
    return term.source, term.course


def _again(less: Linear, terms: Sequence[Weighed]) -> list[Weighed]:
    """Terms beside something else, the likeliest first."""
    shares = {id(one.term): one.log_share for one in terms}
    found = weighed_terms(less, [one.term for one in terms])
    return between_steps(less, [replace(one, log_share=shares[id(one.term)]) for one in found])


def _beside_common(work: Weighing, found: Hypothesis, less: Linear, discrepancies: Discrepancies) -> Linear:
    """What is left beside noise that all channels share, too."""
    name = found.state.fitted[-1].effect.name
    noises = [each.term for each in work.common_under(found.explanation.data) if each.effect.name == name]
    likeliest = weighed_terms(less, noises)[:1]
    return left_beside(less, likeliest[0], discrepancies) if likeliest else less
