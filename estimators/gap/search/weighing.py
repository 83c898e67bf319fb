"""Weighing: every hypothesis that a search comes upon, with its log mass."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.common import CommonNoise, beside, beside_other, common_noises
from estimators.gap.evidence.discrepancy import Discrepancies, squares_taken, total, weighed
from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.prior import OTHER, OTHER_NOISE
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.stochastic import EVERY, FittedNoise
from estimators.gap.search.beam import Search
from estimators.gap.search.displaced import FEW, displaced
from estimators.gap.search.explanation import Explanation, Key, Member, distinct, key_of, without_one
from estimators.gap.search.further_effects import further_effects
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.noises import Given, Noises, Promise
from rig.progress import Progress

#: Log odds against the leading hypothesis beyond which a state of the noise is not followed.
FAR: Final = 14.0
#: Log odds against the leading explanation within which others are.
NEAR: Final = 6.0
#: Log odds by which a floor, or something without a name, is hardly likelier and changes nothing else.
HARDLY: Final = 1.0
#: Log probability of something without a name that is no noise.
UNKNOWN: Final = float(np.log(OTHER * (1.0 - OTHER_NOISE)))
#: Searches under common noise, each beside what the last one found.
_OUTWARDS: Final = 2
#: So many explanations of a state are weighed beside discrepancies, and beside other noise.
_BESIDE: Final = 4
#: Discrepancies are kept of so many readings: they are large.
_READINGS: Final = 100_000
#: Terms of a discrepancy that are kept of each, for what is left.
KEPT: Final = 12


@dataclass
class Weighing:
    """All that was weighed so far.

    Attributes:
        scanner: of the data under the floor as it was learned. candidates: what is considered.
        noises: what the noise may be, with the prior of sets, and the effects left out of the catalogue.
        progress: called with the share of a search that is done. common: noise that all channels share.
        discrepancies: under the floor as it was learned. hypotheses: the likeliest of each kind.
        overtaken: states of the noise whose search ended as another is far likelier, and the log mass under that.
        gains: what a discrepancy makes of the log mass of a set under a state.
        taken: of each term the course, and the squared gap that it takes where there are no effects.
        _under: discrepancies under the states that were asked for last. _shared: common noise under the steps of
            the last one.
    """

    scanner: Scanner
    candidates: Sequence[Candidate]
    noises: Noises
    progress: Progress | None
    common: Sequence[CommonNoise] = ()
    discrepancies: Discrepancies | None = None
    hypotheses: dict[tuple[tuple[str, ...], str, bool, bool, bool], Hypothesis] = field(default_factory=dict)
    overtaken: list[tuple[NoiseState, float]] = field(default_factory=list)
    gains: list[tuple[NoiseState, Key, float]] = field(default_factory=list)
    taken: list[tuple[str, float]] | None = None
    _under: list[tuple[NoiseState, Discrepancies]] = field(default_factory=list)
    _shared: tuple[tuple[Step, ...], Sequence[CommonNoise]] | None = None

    @property
    def leading(self) -> Hypothesis:
        """The likeliest."""
        return max(self.hypotheses.values(), key=lambda each: each.log_mass)

    @property
    def best(self) -> float:
        """Its log mass, or that of what a search ended for."""
        return max(self.leading.log_mass, *(mass for _, mass in self.overtaken), -np.inf)

    def best_under(self, state: NoiseState) -> float:
        """The same of what has the same named noise: with more of that, every set of effects may be likelier."""
        own = [each.log_mass for each in self.hypotheses.values() if each.state.labels == state.labels]
        return max(own, default=-np.inf)

    @property
    def _gained_by_unknown(self) -> float:
        """By how much the likeliest with a discrepancy is likelier than the likeliest without; its prior at least."""
        every = self.hypotheses.values()
        with_it, without = (
            max((each.log_mass for each in every if bool(each.terms) is there), default=-np.inf)
            for there in (True, False)
        )
        return max(with_it - without, UNKNOWN)

    def beside_other(self, state: NoiseState) -> list[Explanation]:
        """The explanation that is likeliest under a state of the noise beside a discrepancy, if there is one."""
        own = [each for each in self.hypotheses.values() if each.state is state and each.terms]
        return [max(own, key=lambda each: each.log_mass).explanation] if own else []

    def known(self, explanation: Explanation, state: NoiseState) -> float:
        """Log mass without a discrepancy, but for its own prior."""
        return explanation.log_mass + state.log_weight

    def asked_for(self, one: Hypothesis) -> bool:
        """Whether the discrepancy of a hypothesis is likelier than none by more than chance, its prior aside."""
        return one.log_mass > self.known(one.explanation, one.state) + UNKNOWN + HARDLY

    def alone(self, each: Explanation, state: NoiseState) -> Hypothesis:
        """An explanation without a discrepancy."""
        return Hypothesis(each, state, (), self.known(each, state) + nothing_else(state))

    def enter(self, hypothesis: Hypothesis) -> None:
        """A hypothesis, where none of its kind is likelier."""
        key = hypothesis.kind
        if key not in self.hypotheses or self.hypotheses[key].log_mass < hypothesis.log_mass:
            self.hypotheses[key] = hypothesis

    def promised(self, one: Promise) -> None:
        """A state of the noise beside the explanation that it was learned beside."""
        self.enter(Hypothesis(one.explanation, one.state, (), one.log_mass + nothing_else(one.state)))

    def enter_nameless(self, each: Explanation, state: NoiseState, discrepancies: Discrepancies) -> list[Hypothesis]:
        """An explanation beside discrepancies where any is worth weighing, then beside noise that all channels share,
        too; what was entered is given."""
        changes = {
            (member.label, str(member.fit.kept)): partial(each.change_and_slopes, index)
            for index, member in enumerate(each.members)
        }
        nameless = self.known(each, state) + UNKNOWN
        # beside nothing at all, the first that is weighed, whatever is followed is told
        least = -np.inf if self.taken is None else self.best_under(state) - FAR - nameless
        terms = weighed(each.linear, discrepancies, changes, least)
        if self.taken is None:
            floor = self.scanner.fine.data
            squares = squares_taken(terms, each.linear.left, floor, floor)
            self.taken = [(term.term.course, square) for term, square in zip(terms, squares, strict=True)]
        gained = total([term.log_mass for term in terms])
        self.gains.append((state, each.key, UNKNOWN + max(gained, 0.0)))
        if not terms:
            return []
        found = Hypothesis(each, state, tuple(terms[:KEPT]), nameless + gained)
        every = [found]
        # noise of all channels is what changes from sample to sample, too: it is weighed beside what does not
        slow = [term for term in terms if term.term.edges is None]
        if slow:
            common = self.common_under(each.data)
            for log_mass, fitted, both in beside_other(each.linear, common, each.data.absorbed, slow):
                every.append(self._with(replace(found, terms=tuple(both), log_mass=nameless + log_mass), fitted))
        for one in every:
            self.enter(one)
        return every

    def enter_common(self, found: Hypothesis) -> None:
        """A hypothesis beside each noise effect that all channels share."""
        for one in self._beside_common(found):
            self.enter(one)

    def _beside_common(self, found: Hypothesis) -> list[Hypothesis]:
        every = beside(found.explanation.linear, self.common_under(found.explanation.data))
        return [self._with(replace(found, log_mass=found.log_mass + gained), fitted) for gained, fitted in every]

    def _with(self, found: Hypothesis, fitted: FittedNoise) -> Hypothesis:
        """One more noise effect, with its prior."""
        each = found.explanation
        named = replace(found.state, fitted=(*found.state.fitted, fitted))
        prior = self.noises.log_prior(named, each.members)
        return replace(found, state=named, log_mass=found.log_mass - each.log_prior + prior)

    def weigh(
        self,
        state: NoiseState,
        scanner: Scanner,
        seeds: Sequence[Sequence[Member]],
        deep: bool,
        to_the_end: bool = False,
    ) -> list[Explanation]:
        """Search under a state of the noise, and enter what was found, with and without a discrepancy.

        Args:
            to_the_end: whether the search goes on where another state is far likelier.
        """
        search = self.search(state, scanner)
        given, target = (state, scanner), -np.inf
        if first := self.discrepancies is None:
            self.discrepancies = self.discrepancies_under(state, scanner)
            self._beside([search.fine(())], state, search, self.discrepancies)
        if not state.steps:
            target = self._without_effects(state, search)
        others = None if to_the_end else lambda each: self._under_others(given, each)
        found = search.run(seeds, deep, target, others)
        if first and (search.overtaken is None or search.overtaken[0] < self.best):
            self._under_common(state, scanner, self.discrepancies)
            if search.overtaken is not None:  # by noise that all channels share: what is found beside it may need none
                seeds, target = self.leading.explanation.seeds, self._without_effects(state, search)
                found = search.run(seeds, deep, target, lambda each: self._under_floors(given, each))
        for each in found:
            self.enter(self.alone(each, state))
        if search.overtaken is not None:
            there, belongs = search.overtaken
            self.overtaken.append((state, there + state.log_weight))
            some = [belongs, *_leading_and_less(found[:1], found)]
            return found + self._beside(some, state, search, self.discrepancies_under(state, scanner))
        # where something without a name leads by far, causes can be there beside it, if not without it
        near = self.known(found[0], state) > self.best_under(state) - FAR
        near = near or bool(self.leading.terms and self.leading.state is state)
        if near and not first:  # by what a discrepancy gains elsewhere
            near = self.known(found[0], state) + self._gained_by_unknown > self.best - NEAR
        if near or first:  # of a floor that is far off, what leads: something else may be beside it
            some = _leading_and_less(near_leading(found) if near else found[:1], found if near else [])
            found += self._beside(some, state, search, self.discrepancies_under(state, scanner))
        return found

    def search(self, state: NoiseState, scanner: Scanner) -> Search:
        """A search of sets under a state of the noise."""
        return Search(scanner, self.candidates, self.noises.prior, self.progress, given=tuple(state.drawn))

    def common_under(self, data: WhitenedData) -> Sequence[CommonNoise]:
        """Noise that all channels share, as data under a state of the noise have it."""
        if not (data.steps and self.common):
            return self.common
        if self._shared is None or self._shared[0] is not data.steps:
            self._shared = None  # one of them at a time
            self._shared = data.steps, common_noises(data, self.noises.without)
        return self._shared[1]

    def discrepancies_under(self, state: NoiseState, scanner: Scanner) -> Discrepancies:
        """Discrepancies under a state of the noise."""
        if self.discrepancies is not None and not state.steps:
            return self.discrepancies
        known = next((own for under, own in self._under if under is state), None)
        if known is None:
            del self._under[: max(len(self._under) + 1 - max(_READINGS // scanner.fine.data.size, 1), 0)]
            known = Discrepancies.of(scanner.fine.data, scanner.rough.data, self.noises.without)
            self._under.append((state, known))
        return known.without_forms

    def _without_effects(self, state: NoiseState, search: Search) -> float:
        """Log mass of the likeliest without effects, beyond that of nothing at all: so far sets are followed."""
        own = [each.log_mass for each in self.hypotheses.values() if not each.explanation.members]
        return max(own) - state.log_weight - search.fine(()).log_mass

    def _under_floors(self, given: Given, each: Explanation) -> float:
        """Log mass of a set under the likeliest state beyond a given one, as that counts."""
        return self.noises.best_beside(given, each) - given[0].log_weight

    def _under_others(self, given: Given, each: Explanation) -> float:
        """The same, or beside noise that all channels share."""
        common = self._beside_common(self.alone(each, given[0]))
        for one in common:
            self.enter(one)
        shared = max((one.log_mass for one in common), default=-np.inf)
        return max(self._under_floors(given, each), shared - given[0].log_weight)

    def _under_common(self, floor: NoiseState, scanner: Scanner, discrepancies: Discrepancies) -> None:
        """Sets of effects where noise that all channels share is far likelier than none: searched as if each channel
        had noise of that size by itself, and weighed as what it is."""
        data = scanner.fine.data
        for _ in range(_OUTWARDS):
            leading = self.leading
            if (common := self._common()) is None:
                return
            below, given = scanner.stepped(common.steps(data)), tuple(leading.state.drawn)
            search = Search(below, self.candidates, self.noises.prior, self.progress, given=given)
            alone = self.hypotheses.get((leading.state.labels, floor.name, False, False, False))
            target = -np.inf if alone is None else leading.log_mass - alone.log_mass
            for each in search.run(leading.explanation.seeds, False, target)[:_BESIDE]:
                prior = self.noises.prior.log_set([member.drawn for member in each.members])
                moved = replace(each.on(data), log_prior=prior)
                self.enter_common(self.alone(moved, floor))
            if self.leading is leading:
                return
            self.enter_nameless(self.leading.explanation, floor, discrepancies)

    def _common(self) -> FittedNoise | None:
        """Noise that all channels share, where that is far likelier than none."""
        fitted = self.leading.state.fitted
        return fitted[-1] if of_all_channels(self.leading.state) and 0.5 * fitted[-1].gain > FAR else None

    def move_floor_under_common(self, floor: NoiseState) -> None:
        """The same beside other floors: as it was learned, the floor was judged beside nothing else. Each is moved
        beside what leads, and beside fewer effects: beside one that does what the floor does, it is as it was."""
        leading = self.leading
        if (common := self._common()) is None or leading.state.steps:
            return
        known, moved = leading.explanation, list[tuple[NoiseState, Scanner]]()
        for members in {key_of(some): some for some in [known.members, *without_one(known.members), ()]}.values():
            prior = self.noises.log_prior(floor, members)
            each = replace(known, members=members, log_prior=prior, refitted=False)
            for state in self.noises.moved_under((floor, self.scanner), each, common):
                scanner = self.scanner.stepped(state.steps)
                moved.append((state, scanner))
                self.enter_common(self.alone(each.on(scanner.fine.data), state))
        for state, scanner in moved:
            if self.leading.state.steps is state.steps:
                self._under_common(state, scanner, self.discrepancies_under(state, scanner))
                return

    def moved(self, every: Sequence[Hypothesis], state: NoiseState) -> None:
        """The likeliest sets of hypotheses beside discrepancies under other noise, with what then can be added or left
        out."""
        scanner = self.scanner.stepped(state.steps)
        some = [
            replace(each.on(scanner.fine.data), log_prior=self.noises.log_prior(state, each.members))
            for each in distinct(one.explanation for one in every)[:_BESIDE]
        ]
        self._beside(some, state, self.search(state, scanner), self.discrepancies_under(state, scanner))

    def nameless(self, plain: bool = False) -> list[Hypothesis]:
        """Hypotheses with a discrepancy, the likeliest first, but for noise that all channels share.

        Args:
            plain: under the floor as it was learned at rest, alone.
        """
        own = [one for one in self.hypotheses.values() if one.terms and not of_all_channels(one.state)]
        return sorted((one for one in own if not (plain and one.state.steps)), key=lambda one: -one.log_mass)

    def _beside(
        self, some: Sequence[Explanation], state: NoiseState, search: Search, discrepancies: Discrepancies
    ) -> list[Explanation]:
        """Explanations beside discrepancies, and additions once one of these is there, which are given."""
        done = {key for under, key, _ in self.gains if under is state and not key}  # nothing has no other fit
        queue, added = list(some), list[Explanation]()
        if len(some[0].members) > FEW:
            fewer = displaced(some[0], search.without_one(some[0]), discrepancies)
            queue += [search.fine(members, search.fitted(members)) for members in fewer]
        extended = set[Key]() if len(some) > 1 else None
        while queue:
            each = queue.pop(0)
            elsewhere = not each.refitted and any(each is one for one in added)  # a tone's own frequency
            if each.key not in done or elsewhere:
                done.add(each.key)
                self.enter_common(self.alone(each, state))
                if not self._hopeless(each, state):
                    self.enter_nameless(each, state, discrepancies)
            if queue:
                continue
            nameless = [one for one in self.hypotheses.values() if one.terms and one.state is state]
            leading = max(nameless, key=lambda one: one.log_mass, default=None)
            if leading is None or leading.log_mass < self.best - NEAR:
                continue
            # what was needed without a discrepancy may do a part of what that does
            queue += [rest for rest in search.without_one(leading.explanation) if rest.key not in done]
            if queue or extended is None or leading.explanation.key in extended or len(extended) >= _OUTWARDS:
                continue
            extended.add(leading.explanation.key)
            new = list(further_effects(leading, nameless, search, self.asked_for(leading), self.best - NEAR))
            added += new
            queue += new
            for one in new:
                self.enter(self.alone(one, state))
        return added

    def _hopeless(self, each: Explanation, state: NoiseState) -> bool:
        """Whether a set beside a discrepancy is far from likely: that gains no more beside a set than beside less, and
        other noise makes little of what is far behind without it."""
        elsewhere = [
            one.log_mass
            for one in self.hypotheses.values()
            if one.terms and one.state is not state and one.explanation.key == each.key
        ]
        if elsewhere and max(elsewhere) < self.best - NEAR - FAR:
            return True
        held, own = Counter(each.key), dict[Key, float]()
        for under, fewer, gain in self.gains:
            if under is state and Counter(fewer) < held:
                own[fewer] = max(gain, own.get(fewer, gain))
        return bool(own) and self.known(each, state) + min(own.values()) < self.best - NEAR


def of_all_channels(state: NoiseState) -> bool:
    """Whether its noise is one that all channels share."""
    return bool(state.fitted) and state.fitted[-1].part == EVERY


def nothing_else(state: NoiseState) -> float:
    """log probability that beside a state of the noise there is nothing without a name; noise without one says it."""
    return 0.0 if state.other else float(np.log1p(-OTHER))


def _leading_and_less(leading: Sequence[Explanation], found: Sequence[Explanation]) -> list[Explanation]:
    """Explanations, then those found that the first is with one effect more, and that without any."""
    drops = {key_of(rest) for rest in without_one(leading[0].members)}
    return [*leading, *(each for each in found if not each.members or each.key in drops)]


def near_leading(found: Sequence[Explanation]) -> list[Explanation]:
    """The leading explanation and those nearly as likely: other noise and discrepancies are weighed beside them all."""
    return [each for each in found if each.log_mass > found[0].log_mass - NEAR][:_BESIDE]
