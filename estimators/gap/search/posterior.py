"""The posterior over explanations: masses of all hypotheses that were weighed, twins merged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.common import CommonNoise, beside, beside_other, common_noises
from estimators.gap.evidence.discrepancy import Discrepancies, Weighed, total, weighed
from estimators.gap.evidence.states import (
    UNSEEN,
    NoiseState,
    raised,
)
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.considered import set_prior, unseen_places, visible
from estimators.gap.hypotheses.prior import OTHER, OTHER_NOISE, Prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.search import robust
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation, Member
from estimators.gap.search.noises import Noises, Promise

Array = NDArray[np.float64]

#: Log odds against the leading hypothesis beyond which a state of the noise is not followed.
_FAR: Final = 14.0
#: The same for a state beside the leading explanation: what it promises is what it is worth.
_CLOSE: Final = 3.0
#: Log odds by which a state that names nothing must be better than what was found to be worth a search.
_BETTER: Final = 2.0
#: Rounds of search, each under the states of the noise that what was found promises; of those before them.
_ROUNDS: Final = 6
_OUTWARDS: Final = 2
#: So many explanations of a state are weighed beside discrepancies, and beside other noise.
_BESIDE: Final = 4
#: Log odds against the leading explanation within which others are.
_NEAR: Final = 6.0
#: Terms of a discrepancy that are kept of each, for what is left.
_KEPT: Final = 12


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects under a state of the noise, with or without a discrepancy.

    Attributes:
        explanation: the mean effects. state: the noise.
        terms: the discrepancy's terms, the likeliest first; empty without one.
        log_mass: unnormalised.
    """

    explanation: Explanation
    state: NoiseState
    terms: tuple[Weighed, ...]
    log_mass: float

    @property
    def other(self) -> bool:
        """Whether it holds something that the catalogue does not have."""
        return bool(self.terms) or self.state.other

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
        return linear.posterior(linear.precision(linear.averaged[1]))


@dataclass(frozen=True)
class Posterior:
    """Everything that was weighed.

    Attributes:
        hypotheses: the likeliest first. prior: of sets.
        scanner, discrepancies: of the data under the floor. candidates: what was considered. absorbed: what the
            calibration takes.
    """

    hypotheses: tuple[Hypothesis, ...]
    prior: Prior
    scanner: Scanner
    discrepancies: Discrepancies
    candidates: tuple[Candidate, ...] = ()
    absorbed: tuple[Candidate, ...] = ()

    @cached_property
    def probabilities(self) -> Array:
        """(h,) of the hypotheses."""
        masses = np.array([each.log_mass for each in self.hypotheses])
        return np.asarray(np.exp(masses - total(list(masses))))

    @property
    def leading(self) -> Hypothesis:
        """The likeliest."""
        return self.hypotheses[0]


@dataclass
class _Weighing:
    scanner: Scanner
    candidates: Sequence[Candidate]
    prior: Prior
    without: Sequence[str]
    at_rest: bool
    progress: Callable[[float], None] | None
    common: Sequence[CommonNoise] = ()
    discrepancies: Discrepancies | None = None
    hypotheses: dict[tuple[tuple[str, ...], str, bool, bool], Hypothesis] = field(default_factory=dict)

    @property
    def leading(self) -> Hypothesis:
        return max(self.hypotheses.values(), key=lambda each: each.log_mass)

    @property
    def best(self) -> float:
        return self.leading.log_mass

    def best_under(self, state: NoiseState) -> float:
        """The same of what has the same named noise: with more of that, every set of effects may be likelier."""
        own = [each.log_mass for each in self.hypotheses.values() if each.state.labels == state.labels]
        return max(own, default=-np.inf)

    def beside_other(self, state: NoiseState) -> list[Explanation]:
        """The explanation that is likeliest under a state of the noise beside a discrepancy, if there is one."""
        own = [each for each in self.hypotheses.values() if each.state is state and each.terms]
        return [max(own, key=lambda each: each.log_mass).explanation] if own else []

    def known(self, explanation: Explanation, state: NoiseState) -> float:
        """Log mass without a discrepancy, but for its own prior."""
        return explanation.log_mass + state.log_weight

    def alone(self, each: Explanation, state: NoiseState) -> Hypothesis:
        """An explanation without a discrepancy."""
        return Hypothesis(each, state, (), self.known(each, state) + _nothing_else(state))

    def enter(self, hypothesis: Hypothesis) -> None:
        key = hypothesis.labels, hypothesis.state.name, bool(hypothesis.terms), hypothesis.state.other
        if key not in self.hypotheses or self.hypotheses[key].log_mass < hypothesis.log_mass:
            self.hypotheses[key] = hypothesis

    def promised(self, one: Promise) -> None:
        """A state of the noise beside the explanation that it was learned beside."""
        self.enter(Hypothesis(one.explanation, one.state, (), one.log_mass + _nothing_else(one.state)))

    def enter_nameless(self, each: Explanation, state: NoiseState, discrepancies: Discrepancies) -> None:
        """An explanation beside discrepancies."""
        changes = {
            (member.label, str(member.fit.kept)): partial(each.whitened_change, index)
            for index, member in enumerate(each.members)
        }
        nameless = self.known(each, state) + float(np.log(OTHER * (1.0 - OTHER_NOISE)))
        least = self.best_under(state) - _FAR - nameless
        if terms := weighed(each.linear, discrepancies, changes, least):
            found = Hypothesis(each, state, tuple(terms[:_KEPT]), nameless + total([term.log_mass for term in terms]))
            self.enter(found)
            # noise of all channels is what changes from sample to sample, too: it is weighed beside what does not
            slow = [term for term in terms if term.term.edges is None]
            if slow:
                for log_mass, fitted, both in beside_other(each.linear, self.common, each.data.absorbed, slow):
                    self._enter_with(replace(found, terms=tuple(both), log_mass=nameless + log_mass), fitted)

    def enter_common(self, found: Hypothesis) -> None:
        """A hypothesis beside each noise effect that all channels share."""
        for log_mass, fitted in beside(found.explanation.linear, self.common):
            self._enter_with(replace(found, log_mass=found.log_mass + log_mass), fitted)

    def _enter_with(self, found: Hypothesis, fitted: FittedNoise) -> None:
        """A hypothesis, but for the prior of one more noise effect."""
        each = found.explanation
        named = replace(found.state, fitted=(*found.state.fitted, fitted))
        prior = self.prior.log_set([*named.drawn, *(member.drawn for member in each.members)])
        self.enter(replace(found, state=named, log_mass=found.log_mass - each.log_prior + prior))

    def move_floor(self) -> None:
        """What has no name, beside the floor that known causes are likeliest beside: it was weighed there only where
        something else led to that floor."""
        known = [each for each in self.hypotheses.values() if not each.other and not each.state.labels]
        floor = max(known, key=lambda each: each.log_mass).state
        plain = [each.log_mass for each in known if not each.state.steps]
        nameless = [each for each in self.hypotheses.values() if each.terms and not each.state.steps]
        there = [each for each in self.hypotheses.values() if each.terms and each.state.steps and not each.state.labels]
        if not floor.steps or not nameless or any(each.state.name == floor.name for each in there):
            return
        each = max(nameless, key=lambda one: one.log_mass)
        if each.log_mass + self.best - max(plain, default=-np.inf) < self.best - _NEAR:
            return
        scanner = self.scanner.stepped(floor.steps)
        moved = each.explanation.on(scanner.fine.data)
        self.enter(self.alone(moved, floor))
        self.enter_nameless(moved, floor, Discrepancies.of(scanner.fine.data, scanner.rough.data, self.without))

    def weigh(
        self, state: NoiseState, scanner: Scanner, seeds: Sequence[Sequence[Member]], deep: bool
    ) -> list[Explanation]:
        """Search under a state of the noise, and enter what was found, with and without a discrepancy."""
        search = Search(scanner, self.candidates, self.prior, self.progress, given=tuple(state.drawn))
        discrepancies = None
        target = -np.inf
        if deep:  # what a discrepancy alone comes to tells how far sets of effects are worth following
            self.discrepancies = discrepancies = Discrepancies.of(search.data, search.rough, self.without)
            self._beside([search.fine(())], state, search, discrepancies)
            self._under_common(state)
            target = self.best - state.log_weight - search.fine(()).log_mass
        found = search.run(seeds, deep, target)
        for each in found:
            self.enter(self.alone(each, state))
        # where something without a name leads by far, causes can be there beside it, if not without it
        best = self.best_under(state)
        near = self.known(found[0], state) > best - _FAR or (self.leading.terms and self.leading.state is state)
        if near or deep:  # of a floor that is far off, what leads: something else may be beside it
            discrepancies = discrepancies or Discrepancies.of(search.data, search.rough, self.without)
            self._beside(found if near else found[:1], state, search, discrepancies)
        return found

    def _under_common(self, floor: NoiseState) -> None:
        """Sets of effects where noise that all channels share is far likelier than none: searched as if each channel
        had noise of that size by itself, and weighed as what it is."""
        assert self.discrepancies is not None
        data = self.scanner.fine.data
        for _ in range(_OUTWARDS):
            leading = self.leading
            if not leading.state.fitted or 0.5 * leading.state.fitted[-1].gain < _FAR:
                return
            steps = [step for fitted in leading.state.fitted for step in fitted.steps(data)]
            given = tuple(leading.state.drawn)
            search = Search(self.scanner.stepped(steps), self.candidates, self.prior, self.progress, given=given)
            alone = self.hypotheses.get((leading.state.labels, floor.name, False, False))
            target = -np.inf if alone is None else leading.log_mass - alone.log_mass
            for each in search.run(leading.explanation.seeds, False, target)[:_BESIDE]:
                prior = self.prior.log_set([member.drawn for member in each.members])
                moved = replace(each.on(data), log_prior=prior)
                self.enter_common(self.alone(moved, floor))
            if self.leading is leading:
                return
            self.enter_nameless(self.leading.explanation, floor, self.discrepancies)

    def _beside(
        self, found: Sequence[Explanation], state: NoiseState, search: Search, discrepancies: Discrepancies
    ) -> None:
        """Explanations beside discrepancies, and additions once one of these is there."""
        done: set[tuple[str, ...]] = set()
        near = _near(found)
        leading_members = found[0].members
        drops = {
            tuple(sorted(member.label for member in leading_members if member is not out)) for out in leading_members
        }
        queue = near + [each for each in found if not each.members or each.key in drops]
        extended = len(found) == 1
        while queue:
            each = queue.pop(0)
            if each.key in done:
                continue
            done.add(each.key)
            self.enter_common(self.alone(each, state))
            self.enter_nameless(each, state, discrepancies)
            if queue:
                continue
            nameless = [one for one in self.hypotheses.values() if one.terms and one.state is state]
            leading = max(nameless, key=lambda one: one.log_mass, default=None)
            if leading is None or leading.log_mass < self.best - _NEAR:
                continue
            # what was needed without a discrepancy may do a part of what that does
            queue += [rest for rest in search.without_one(leading.explanation) if rest.key not in done]
            if not queue and not extended:
                extended = True
                queue += search.beside(leading.explanation, leading.terms[0])


def explain(
    data: WhitenedData,
    without: Sequence[str] = (),
    at_rest: bool = True,
    weights: Mapping[str, float] | None = None,
    progress: Callable[[float], None] | None = None,
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
    work = _Weighing(scanner, candidates, prior, without, at_rest, progress, common_noises(data, without))
    noises = Noises(prior, without, at_rest)
    floor = NoiseState()
    for promise in noises.as_floor((floor, scanner), Search(scanner, candidates, prior).fine(())):
        work.promised(promise)  # how likely that is tells how far sets of effects are worth following
    found = work.weigh(floor, scanner, (), deep=True)
    tried: set[tuple[str, tuple[str, ...]]] = set()
    frontier = [(floor, scanner, found)]
    again = [((floor, scanner), each) for each in _far_from_it(work, noises, found[0])]
    for _ in range(_ROUNDS):
        states = noises.again(again)
        again = []
        for given, given_scanner, explanations in frontier:
            smallest_first = sorted(explanations, key=lambda one: (len(one.members), -one.log_mass))
            best_of_size = {len(one.members): one for one in reversed(smallest_first)}
            looked_at = [*_near(explanations), *best_of_size.values(), *work.beside_other(given)]
            for each in {each.key: each for each in looked_at}.values():
                states += noises.beyond((given, given_scanner), each)
        for name in {one.state.name for one in states if one.state.name}:
            likeliest = max((one for one in states if one.state.name == name), key=lambda one: one.log_mass)
            if likeliest.log_mass > work.best - _FAR:
                states += noises.beside_fewer(likeliest)
        frontier = []
        # before what the states promise is entered
        reached = max(each.log_mass for each in work.hypotheses.values() if tried or each.state is floor)
        best: dict[tuple[str, tuple[str, ...]], Promise] = {}
        for one in states:
            kind = one.state.name, one.state.labels
            anew = kind not in tried or (not one.state.fitted and one.log_mass > reached + _BETTER)
            if anew and (kind not in best or best[kind].log_mass < one.log_mass):
                best[kind] = one
        for one in states:
            work.promised(one)
        for kind, one in sorted(best.items(), key=lambda item: -item[1].log_mass):
            same = one.explanation.key == work.leading.explanation.key and not work.leading.terms
            if len(frontier) >= 2 or one.log_mass < work.best - (_CLOSE if same else _FAR):
                continue
            if not one.state.fitted and one.log_mass < reached + _BETTER:
                continue
            tried.add(kind)
            given, below = one.given
            fresh = below.stepped(one.state.steps[len(given.steps) :])
            found = work.weigh(one.state, fresh, one.explanation.seeds, deep=False)
            frontier.append((one.state, fresh, found))
            if one.state.other or one.state.name == UNSEEN:  # learned beside worse causes, or one too many
                again += [(one.given, each) for each in found]
        if not frontier:
            break
    assert work.discrepancies is not None
    work.move_floor()
    weighed_all = tuple(sorted(work.hypotheses.values(), key=lambda one: -one.log_mass))
    return Posterior(weighed_all, prior, scanner, work.discrepancies, tuple(candidates), tuple(absorbed))


def _nothing_else(state: NoiseState) -> float:
    """log probability that beside a state of the noise there is nothing without a name; noise without one says it."""
    return 0.0 if state.other else float(np.log1p(-OTHER))


def _near(found: Sequence[Explanation]) -> list[Explanation]:
    """The leading explanation and those nearly as likely: other noise and discrepancies are weighed beside them all."""
    return [each for each in found if each.log_mass > found[0].log_mass - _NEAR][:_BESIDE]


def _far_from_it(work: _Weighing, noises: Noises, each: Explanation) -> list[Explanation]:
    """Where noise without a name is far likelier than all that was found, sets of effects that leave ever less.

    They are searched under white noise as large as what is left: a floor that everything misses a hundred times ranks
    effects by what they do to the least of errors. Noise without a name that is no likelier beside the set that leads
    then ends it: such sets leave less by their number alone.
    """
    found: list[Explanation] = []
    reached = work.best + _FAR
    for _ in range(_OUTWARDS):
        here = each.on(work.scanner.fine.data)
        promises = noises.nameless((NoiseState(), work.scanner), here)
        promised = max((one.log_mass for one in promises), default=-np.inf)
        if promised < reached:
            break
        reached = promised
        scanner = work.scanner.stepped(raised(here.data, Explained(here.data.absorbed, here.linear.left)))
        search = Search(scanner, work.candidates, work.prior, work.progress, wide=True)
        found += search.run(each.seeds, deep=False)
        leading = max(search.found.values(), key=search.gained)
        if leading.key == each.key:
            break
        each = leading
    return found
