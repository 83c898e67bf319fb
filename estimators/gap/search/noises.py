"""States of the noise beside an explanation: what each promises before anything is refitted under it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimators.gap.data.projection import project
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.named_noise import again, named
from estimators.gap.evidence.refine import Refit
from estimators.gap.evidence.reweighted import left_by_weights
from estimators.gap.evidence.states import (
    UNSEEN,
    NoiseState,
    as_floor,
    left_of,
    moved_floor,
    pieces_of,
    refined,
    under_steps,
    unnamed,
    unseen_floor,
)
from estimators.gap.evidence.unsteady_floor import unsteady_floor
from estimators.gap.evidence.varying_noise import varying
from estimators.gap.hypotheses.prior import Prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import FittedNoise, Left
from estimators.gap.search.explanation import STRAIGHT, Explanation, Member, without_one
from rig.arrays import Array

#: Log odds by which one more part of a floor must be better.
_BETTER: Final = 1.0
#: The floor is moved beside so many noise effects, the likeliest of those that could be there.
_MOVED: Final = 2
#: Beside so many explanations the parts of a floor that nothing shows are learned.
_BESIDE: Final = 4

#: A state of the noise, and the scanner under it.
Given = tuple[NoiseState, Scanner]


@dataclass(frozen=True)
class Promise:
    """What a state of the noise promises.

    Attributes:
        log_mass: of the explanation that it was learned beside, without a discrepancy. state: the noise.
        given: the state that it goes beyond. explanation: that it was learned beside.
        determinant: the part of the state's log weight that is its steps'.
        ahead: log likelihood and prior that its effects are to gain by moving, as if they were linear.
    """

    log_mass: float
    state: NoiseState
    given: Given
    explanation: Explanation
    determinant: float = 0.0
    ahead: float = 0.0


@dataclass(frozen=True)
class Noises:
    """What the noise may be.

    Attributes:
        prior: of sets. without: effects left out of the catalogue. at_rest: whether the floor was learned at rest.
        _known: states beyond a given one beside an explanation, of which only the likeliest was asked for so far.
    """

    prior: Prior
    without: Sequence[str]
    at_rest: bool
    _known: dict[tuple[int, int], tuple[Given, Explanation, list[Promise]]] = field(default_factory=dict)

    def log_prior(self, state: NoiseState, members: Sequence[Member]) -> float:
        """Of a set of effects and the noise effects of a state."""
        return self.prior.log_set([*state.drawn, *(member.drawn for member in members)])

    def beyond(self, given: Given, each: Explanation) -> list[Promise]:
        """States beyond a given one, beside an explanation under that."""
        if (known := self._known.pop((id(given[0]), id(each)), None)) is not None:
            return known[2]
        found = self.beside(given, each, each.linear)
        return found if given[0].name else found + self.as_floor(given, each)

    def beside(self, given: Given, each: Explanation, linear: Linear) -> list[Promise]:
        """The same, learned from what is left, as it is linearised: with it, or beside something else."""
        data = _around(given, each)
        lefts = left_of(data, Explained(data.absorbed, linear.left))
        states = named(lefts, self.without, given[0])
        if not given[0].name:
            states += [*varying(states, given[0], lefts), *self._unnamed(given[0], lefts)]
        return self._promised(given, each, data, linear, states)

    def _with_more(self, given: Given, each: Explanation, promises: Sequence[Promise]) -> list[Promise]:
        """Ever one more noise effect beside the likeliest, where that is evident: noise without a name takes that of
        all channels at once, and would leave each of several far behind."""
        here, found = each.on(given[1].fine.data), []
        least = here.log_mass + given[0].log_weight
        while promises and (best := max(promises, key=lambda one: one.log_mass)).log_mass > least + _BETTER:
            found.append(best)
            least = best.log_mass
            lefts = _left_after(here.data, best.state.steps[len(given[0].steps) :], _unexplained(here))
            bare = replace(best.state, log_weight=best.state.log_weight - best.determinant)
            parts = named(lefts, self.without, bare)
            promises = self._promised(given, each, here.data, here.linear, parts)
        return found[1:]

    def beyond_each(self, given: Given, every: Sequence[Explanation], least: float) -> list[Promise]:
        """The same beside each of some explanations, with further noise effects where any noise makes these likely; but
        not where it is hopeless: noise gains no more beside a set than beside less.

        Args:
            least: log mass below which nothing is worth telling.
        """
        found: list[Promise] = []
        gains: list[tuple[Counter[str], float]] = []
        for each in sorted(every, key=lambda one: len(one.members)):
            alone, held = each.log_mass + given[0].log_weight, Counter(each.key)
            most = min((gain for fewer, gain in gains if fewer <= held), default=np.inf)
            if alone + most >= least:
                own = self.beyond(given, each)
                gains.append((held, _best(own) - alone))
                found += own
                if _best(own) > least:  # also by noise without a name, which several with names may be instead
                    found += self._with_more(given, each, [one for one in own if one.state.fitted != given[0].fitted])
        return found

    def best_beside(self, given: Given, each: Explanation) -> float:
        """Log mass, without a discrepancy, of an explanation under the likeliest state with a floor moved or one more
        noise effect."""
        found = self.beyond(given, each)
        # until they are asked for; with both, so that no other has their identity
        self._known[id(given[0]), id(each)] = given, each, found
        # neither noise without a name nor a floor that nothing shows: these may be as large as what is left
        own = [one.log_mass for one in found if not one.state.other and one.state.name != UNSEEN]
        return max(own, default=-np.inf)

    def moved_beside(self, promises: Sequence[Promise]) -> list[Promise]:
        """The floor moved beside the likeliest named noise: alone that explains little where the floor is not quite
        what was learned. Beside the explanation that each is likeliest beside, and the smallest; further noise then may
        be what the floor is."""
        every: dict[tuple[str, ...], list[Promise]] = {}
        for one in sorted(promises, key=lambda one: -one.log_mass):
            if not one.state.name and len(one.state.fitted) == len(one.given[0].fitted) + 1:
                every.setdefault(one.state.labels, []).append(one)
        found = []
        for likeliest, *others in list(every.values())[:_MOVED]:
            fewest = min((likeliest, *others), key=lambda one: len(one.explanation.members))
            for one in (likeliest,) if fewest is likeliest else (likeliest, fewest):
                here = one.explanation.on(one.given[1].fine.data)
                bare = replace(one.state, log_weight=one.state.log_weight - one.determinant)
                floors = self.floors_under(here, bare.steps[len(one.given[0].steps) :])
                moved = [bare.beyond(floor) for floor in floors]
                found += self._promised(one.given, one.explanation, here.data, here.linear, moved)
        return found

    def moved_under(self, given: Given, each: Explanation, common: FittedNoise) -> list[NoiseState]:
        """The floor moved where there is noise that all channels share, taken as if each had that by itself.

        Args:
            given: state, and its scanner. each: explanation under it.
        """
        here = each.on(given[1].fine.data)
        floors = self.floors_under(here, common.steps(here.data))
        return [one.state for one in self._promised(given, each, here.data, here.linear, floors)]

    def floors_under(self, here: Explanation, steps: Sequence[Step]) -> list[NoiseState]:
        """The floor moved, and one that goes on below what the poses at rest show, where further noise is known.

        Args:
            here: an explanation. steps: that whiten the noise beyond its data's.
        """
        return self._floors(_left_after(here.data, steps, _unexplained(here)))

    def again(self, every: Sequence[tuple[Given, Explanation]]) -> list[Promise]:
        """Floors, and noise without a name, beyond given states: beside explanations found under other ones.

        Of floors that nothing shows the parts are learned beside those that leave least to noise without a name.
        """
        found = [self._again(given, each) for given, each in every]
        likeliest = sorted(range(len(found)), key=lambda index: -_best(found[index]))[:_BESIDE]
        return [promise for own in found for promise in own] + [
            promise for index in likeliest for promise in self.as_floor(*every[index])
        ]

    def _again(self, given: Given, each: Explanation) -> list[Promise]:
        here = each.on(given[1].fine.data)
        lefts = left_of(here.data, Explained(here.data.absorbed, here.linear.left))
        return self._promised(given, each, here.data, here.linear, self._unnamed(given[0], lefts))

    def beside_fewer(self, one: Promise) -> list[Promise]:
        """The same state, learned anew beside ever fewer causes as long as that is likelier: beside a cause that does
        what the noise does, it was learned as if the noise were not there."""
        found: list[Promise] = []
        while one.explanation.members:
            name = one.state.name
            less = self._likeliest([self._beside(one, each) for each in without_one(one.explanation.members)], name)
            if less is None or less.log_mass <= one.log_mass:
                break
            refitted = converged(less.explanation.fits, one.given[1].fine.data)
            again = self._beside(one, less.explanation.members, refitted)
            fresh = self._likeliest([again], name)
            if fresh is None or fresh.log_mass <= one.log_mass:
                break
            one = fresh
            found.append(one)
        return found

    def _beside(
        self, one: Promise, members: tuple[Member, ...], refitted: Refit | None = None
    ) -> tuple[Given, Explanation]:
        """Other causes, as they are or as they were refitted, beside what a state goes beyond."""
        prior = self.log_prior(one.given[0], members)
        if refitted is not None:
            return one.given, Explanation.of(members, refitted, prior, fine=True)
        return one.given, Explanation(members, one.explanation.data, prior, fine=True)

    def _likeliest(self, every: Sequence[tuple[Given, Explanation]], name: str) -> Promise | None:
        """The likeliest state of that name beside any of these."""
        found = [[one for one in self._again(*each) if one.state.name == name] for each in every]
        if name == UNSEEN:
            likeliest = max(range(len(found)), key=lambda index: _best(found[index]))
            found.append(self.as_floor(*every[likeliest]))
        return max((one for own in found for one in own), key=lambda one: one.log_mass, default=None)

    def nameless(self, given: Given, here: Explanation) -> list[Promise]:
        """Noise without a name beside an explanation in the data of the given state."""
        lefts = left_of(here.data, Explained(here.data.absorbed, here.linear.left))
        states = [given[0].beyond(state) for state in self._nameless(lefts)]
        return self._promised(given, here, here.data, here.linear, states)

    def _unnamed(self, given: NoiseState, lefts: Sequence[Left]) -> list[NoiseState]:
        return [given.beyond(state) for state in (*self._floors(lefts), *self._nameless(lefts))]

    def _floors(self, lefts: Sequence[Left]) -> list[NoiseState]:
        """The floor moved, and one that goes on below what the poses at rest show."""
        floors = [moved_floor(lefts, self.at_rest, slower) for slower in (False, True)]
        floors.append(unsteady_floor(lefts))
        return [floor for floor in floors if floor is not None]

    def _nameless(self, lefts: Sequence[Left]) -> list[NoiseState]:
        """Noise without a name; where nothing shows the floor, it may be that."""
        steady = None if self.at_rest else unnamed(lefts, steady=True)
        states = [unnamed(lefts), None if steady is None else unseen_floor(steady)]
        return [state for state in states if state is not None]

    def as_floor(self, given: Given, each: Explanation) -> list[Promise]:
        """Where nothing shows the floor, ever one more of the noise effects, as a part of that."""
        if self.at_rest:
            return []
        found: list[Promise] = []
        state, here = given[0], each.on(given[1].fine.data)
        data, linear = here.data, here.linear
        lefts, unexplained = left_of(data, Explained(data.absorbed, linear.left)), _unexplained(here)
        moved = True
        while True:
            parts = named(lefts, self.without, state)
            if not moved:  # twice in a row, it would go as far as it likes at less than that costs
                parts.append(refined(state, lefts))
            promised = self._promised(given, each, data, linear, [as_floor(part, given[0]) for part in parts])
            likeliest = max(range(len(parts)), key=lambda index: promised[index].log_mass, default=-1)
            if likeliest < 0 or (found and promised[likeliest].log_mass < found[-1].log_mass + _BETTER):
                break
            found.append(promised[likeliest])
            moved = len(parts[likeliest].fitted) == len(state.fitted)
            state = parts[likeliest]
            lefts = _left_after(data, state.steps[len(given[0].steps) :], unexplained)
        return found

    def _promised(
        self, given: Given, each: Explanation, data: WhitenedData, linear: Linear, states: Sequence[NoiseState]
    ) -> list[Promise]:
        """What states are worth beside an explanation that was linearised under the given one."""
        pieces, taken = pieces_of(data, linear), len(given[0].steps)
        found = []
        for state in states:
            prior = self.log_prior(state, each.members)
            under, determinant = under_steps(pieces, linear, state.steps[taken:])
            weight = state.log_weight + determinant
            own = replace(state, log_weight=weight)
            mass = under.averaged[0] + prior + weight
            found.append(Promise(mass, own, given, each, determinant, under.ahead if each.members else 0.0))
        return found

    def worth(self, state: NoiseState, given: Given, each: Explanation, linear: Linear) -> float:
        """Log mass of a state that was learned beside something else, beside an explanation as it is linearised."""
        pieces = pieces_of(_around(given, each), linear)
        under, _ = under_steps(pieces, linear, state.steps[len(given[0].steps) :])
        return under.averaged[0] + self.log_prior(state, each.members) + state.log_weight

    def learned_again(self, one: Promise) -> Promise:
        """The same, its last noise effect learned anew from what calibration and causes leave by its weights."""
        given, each = one.given, one.explanation
        more = one.state.fitted[len(given[0].fitted) :]
        if len(more) != 1 or one.state.name != given[0].name:
            return one
        here = each.on(given[1].fine.data)
        left = left_by_weights(here.data, here.linear, one.state.steps[len(given[0].steps) :])
        lefts = left_of(here.data, Explained(here.data.absorbed, left))
        fresh = again(lefts, more[0].effect, given[0])
        return one if fresh is None else self._promised(given, each, here.data, here.linear, [fresh])[0]

    def kept(self, promises: Sequence[Promise]) -> list[Promise]:
        """The same, until the likeliest keeps what it promises: refitted under its state, where its effects have so far
        to go that they may not be linear."""
        kept = sorted(promises, key=lambda one: -one.log_mass)
        while kept and kept[0].ahead > STRAIGHT:
            first = kept.pop(0)
            fresh = first.given[1].stepped(first.state.steps[len(first.given[0].steps) :])
            refitted = converged(first.explanation.fits, fresh.fine.data)
            members = first.explanation.members
            own = Explanation.of(members, refitted, self.log_prior(first.state, members), fine=True)
            kept.append(replace(first, log_mass=own.log_mass + first.state.log_weight, ahead=0.0))
            kept.sort(key=lambda one: -one.log_mass)
        return kept


def _around(given: Given, each: Explanation) -> WhitenedData:
    """The data under a state, around an explanation's calibration."""
    data = given[1].fine.data
    return data.like(each.data) if each.members else data


def _unexplained(here: Explanation) -> Array:
    """(n, 6) [recorded unit] what an explanation leaves of the residual."""
    return here.data.residual - here.data.change([fit.effect for fit in here.fits])


def _left_after(data: WhitenedData, steps: Sequence[Step], unexplained: Array) -> list[Left]:
    """What is left of each recording after further steps of whitening."""
    own = data.stepped(steps)
    return left_of(own, Explained(own.absorbed, project(own.absorbed, own.whiten(unexplained))))


def _best(found: Sequence[Promise]) -> float:
    return max((one.log_mass for one in found), default=-np.inf)
