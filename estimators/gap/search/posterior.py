"""The posterior over explanations: masses of all hypotheses that were weighed, twins merged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.common import common_noises
from estimators.gap.evidence.discrepancy import Discrepancies, total
from estimators.gap.evidence.states import UNSEEN, NoiseState, raised
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.considered import set_prior, unseen_places, visible
from estimators.gap.hypotheses.prior import Prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import Explained
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation, distinct
from estimators.gap.search.further_unknowns import weigh_further
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.likeliest_alone import weigh_likeliest_alone
from estimators.gap.search.noise_beside_unknown import weigh_noise_beside_unknown
from estimators.gap.search.noises import Given, Noises, Promise
from estimators.gap.search.waveforms import weigh_other_waveforms, with_own_courses
from estimators.gap.search.weighing import FAR, NEAR, Weighing, near_leading
from rig.arrays import Array
from rig.progress import Progress

#: Log odds against the leading hypothesis beyond which a state of the noise beside the leading explanation is not
#: followed: what it promises is what it is worth.
_CLOSE: Final = 3.0
#: Log odds by which a state that names nothing must be better than what was found to be worth a search.
_BETTER: Final = 2.0
#: Rounds of search, each under the states of the noise that what was found promises; of those before them.
_ROUNDS: Final = 6
_OUTWARDS: Final = 2


@dataclass(frozen=True)
class Posterior:
    """Everything that was weighed.

    Attributes:
        hypotheses: the likeliest first. prior: of sets.
        scanner, discrepancies: of the data under the floor. candidates: what was considered. absorbed: what the
            calibration takes. taken: of each term of the discrepancies the course, and the squared gap that it takes
            where there are no effects.
    """

    hypotheses: tuple[Hypothesis, ...]
    prior: Prior
    scanner: Scanner
    discrepancies: Discrepancies
    candidates: tuple[Candidate, ...] = ()
    absorbed: tuple[Candidate, ...] = ()
    taken: tuple[tuple[str, float], ...] = ()

    @cached_property
    def probabilities(self) -> Array:
        """(h,) of the hypotheses."""
        masses = np.array([each.log_mass for each in self.hypotheses])
        return np.asarray(np.exp(masses - total(list(masses))))

    @property
    def leading(self) -> Hypothesis:
        """The likeliest."""
        return self.hypotheses[0]


def explain(
    data: WhitenedData,
    without: Sequence[str] = (),
    at_rest: bool = True,
    weights: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Posterior:
    """All hypotheses worth weighing.

    Args:
        data: of means at their mean poses.
        without: effects to leave out of the catalogue.
        at_rest: whether the floor was learned at rest.
        weights: relative prior weights of effects.
    """
    scanner = Scanner.of(data)
    candidates, absorbed = visible(data, scanner, without)
    prior = set_prior(candidates, unseen_places(data, without), data, weights or {})
    noises = Noises(prior, without, at_rest)
    work = Weighing(scanner, candidates, noises, progress, common_noises(data, without))
    floor = NoiseState()
    for promise in noises.as_floor((floor, scanner), Search(scanner, candidates, prior).fine(())):
        work.promised(promise)  # how likely that is tells how far sets of effects are worth following
    found = work.weigh(floor, scanner, (), deep=True)
    work.move_floor_under_common(floor)
    tried: set[tuple[str, tuple[str, ...]]] = set()
    frontier = [(floor, scanner, found)]
    again = [] if work.overtaken else _far_from_it(work, (floor, scanner), found[0])
    for _ in range(_ROUNDS):
        states = noises.again(again)
        again = []
        for given, given_scanner, explanations in frontier:
            smallest_first = sorted(explanations, key=lambda one: (len(one.members), -one.log_mass))
            best_of_size = {len(one.members): one for one in reversed(smallest_first)}
            looked_at = [*near_leading(explanations), *best_of_size.values(), *work.beside_other(given)]
            states += noises.beyond_each((given, given_scanner), distinct(looked_at), work.best - NEAR)
        states += noises.moved_beside(states)
        for name in {one.state.name for one in states if one.state.name}:
            likeliest = max((one for one in states if one.state.name == name), key=lambda one: one.log_mass)
            if likeliest.log_mass > work.best - FAR:
                states += noises.beside_fewer(likeliest)
        near = max((one.log_mass for one in states), default=-np.inf) - NEAR
        states = [noises.learned_again(one) if one.log_mass > near else one for one in states]
        states, frontier = noises.kept(states), []
        # before what the states promise is entered
        reached = max(each.log_mass for each in work.hypotheses.values() if tried or each.state is floor)
        best: dict[tuple[str, tuple[str, ...]], Promise] = {}
        for one in states:
            kind = one.state.kind
            anew = kind not in tried or (not one.state.fitted and one.log_mass > reached + _BETTER)
            if anew and (kind not in best or best[kind].log_mass < one.log_mass):
                best[kind] = one
        for one in states:
            work.promised(one)
        for kind, one in sorted(best.items(), key=lambda item: -item[1].log_mass):
            same = one.explanation.key == work.leading.explanation.key and not work.leading.terms
            if len(frontier) >= 2 or one.log_mass < work.best - (_CLOSE if same else FAR):
                continue
            if not one.state.fitted and one.log_mass < reached + _BETTER:
                continue
            tried.add(kind)
            given, below = one.given
            fresh = below.stepped(one.state.steps[len(given.steps) :])
            deep = not frontier and any(given is state for state, _ in work.overtaken)
            found = work.weigh(one.state, fresh, one.explanation.seeds, deep)
            frontier.append((one.state, fresh, found))
            if deep and not any(one.state is state for state, _ in work.overtaken):
                again += _far_from_it(work, (one.state, fresh), found[0])
            if deep or one.state.other or one.state.name == UNSEEN:  # learned beside worse causes, or one too many
                again += [(one.given, each) for each in found]
        # something without a name is likelier than the other noise that ended the search
        if not frontier and work.overtaken and (work.leading.other or not tried):
            work.overtaken.clear()
            frontier = [(floor, scanner, work.weigh(floor, scanner, (), deep=True, to_the_end=True))]
        if not frontier:
            break
    assert work.discrepancies is not None
    weigh_noise_beside_unknown(work)
    weigh_likeliest_alone(work)
    weigh_further(work)
    weigh_other_waveforms(work)
    every = with_own_courses(work.hypotheses.values(), work.discrepancies.sources)
    weighed_all = tuple(sorted(every, key=lambda one: -one.log_mass))
    taken = tuple(work.taken or ())
    return Posterior(weighed_all, prior, scanner, work.discrepancies, tuple(candidates), tuple(absorbed), taken)


def _far_from_it(work: Weighing, given: Given, each: Explanation) -> list[tuple[Given, Explanation]]:
    """Where noise without a name is far likelier than all that was found, sets of effects that leave ever less.

    They are searched under white noise as large as what is left: a floor that everything misses a hundred times ranks
    effects by what they do to the least of errors. Noise without a name that is no likelier beside the set that leads
    then ends it: such sets leave less by their number alone.

    Args:
        given: state of the noise, and its scanner. each: what leads under it.
    """
    found: list[tuple[Given, Explanation]] = []
    reached = work.best + FAR
    for _ in range(_OUTWARDS):
        here = each.on(given[1].fine.data)
        promises = work.noises.nameless(given, here)
        promised = max((one.log_mass for one in promises), default=-np.inf)
        if promised < reached:
            break
        reached = promised
        scanner = given[1].stepped(raised(here.data, Explained(here.data.absorbed, here.linear.left)))
        search = Search(scanner, work.candidates, work.noises.prior, work.progress, wide=True)
        found += [(given, one) for one in search.run(each.seeds, deep=False)]
        leading = search.ranked[0]
        if leading.key == each.key:
            break
        each = leading
    return found
