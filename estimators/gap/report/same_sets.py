"""Sets of effects that differ by one and do the same to a recording, so that nothing tells them apart.

Mostly one effect does what another does. Of three that are of one piece, such as latencies of both sensors and of each,
any two do what any other two do, and none is another: then the sets stand for each other, not the effects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Final

import numpy as np

from estimators.gap.data.projection import project
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array

#: Squared distance between what two sets change, in noise, below which no data of this maneuver tell them apart.
_SAME: Final = 0.02
#: Log odds against the likeliest with and without an unknown thing within which sets are compared for that.
_COMPARED: Final = 6.0


@dataclass(frozen=True)
class Pair:
    """Two hypotheses whose sets differ by one effect.

    Attributes:
        one, two: the likelier first. mine, theirs: the label that each has alone.
        moved: of a set, by what the change of its likeliest values differs from that of those it was fitted at.
    """

    one: Hypothesis
    two: Hypothesis
    mine: str
    theirs: str
    moved: Callable[[Explanation], Array]

    @cached_property
    def same(self) -> bool:
        """Whether both do the same, whitened, the calibration projected out: one of them may not have been fitted under
        this noise itself."""
        one, two = self.one.explanation, self.two.explanation
        if one.data.size != two.data.size:
            return False
        data, other = one.data, two.data
        apart = data.change([fit.effect for fit in one.fits]) + data.modelled
        apart = apart - other.modelled - other.change([fit.effect for fit in two.fits])
        left = project(data.absorbed, data.whiten(apart)) + self.moved(one) - self.moved(two)
        return float(left @ left) < _SAME


def but_for_one(posterior: Posterior) -> Iterator[Pair]:
    """Pairs of likely sets under the same noise, with or without an unknown thing, that differ by one effect."""
    known: dict[int, Array] = {}

    def moved(each: Explanation) -> Array:
        if id(each) not in known:
            known[id(each)] = np.asarray(each.linear.tangent @ each.linear.posterior(each.linear.likeliest)[0])
        return known[id(each)]

    for own in _compared(posterior):
        for one, two in combinations(own, 2):
            mine = set(one.explanation.key) - set(two.explanation.key)
            theirs = set(two.explanation.key) - set(one.explanation.key)
            if one.state.kind == two.state.kind and len(mine) == 1 == len(theirs):
                yield Pair(one, two, mine.pop(), theirs.pop(), moved)


def _compared(posterior: Posterior) -> Iterator[list[Hypothesis]]:
    """The likely hypotheses without an unknown thing, and those with one."""
    for beside in (False, True):
        own = [each for each in posterior.hypotheses if bool(each.terms) == beside]
        yield [each for each in own if each.log_mass > own[0].log_mass - _COMPARED]


def merged(posterior: Posterior) -> Posterior:
    """The posterior with sets that do the same as one, where effects that they differ by are in one set elsewhere: the
    one whose effects have the fewest channels in common stands for all."""
    together = {
        frozenset(two) for own in _compared(posterior) for each in own for two in combinations(each.explanation.key, 2)
    }
    group = {id(each): [each] for each in posterior.hypotheses}
    for pair in but_for_one(posterior):
        first, second = group[id(pair.one)], group[id(pair.two)]
        if first is not second and frozenset((pair.mine, pair.theirs)) in together and pair.same:
            first += second
            group |= {id(each): first for each in second}
    found, told = list[Hypothesis](), set[int]()
    for each in posterior.hypotheses:
        if id(alike := group[id(each)]) not in told:
            told.add(id(alike))
            found.append(each if len(alike) == 1 else _as_one(alike))
    return replace(posterior, hypotheses=tuple(sorted(found, key=lambda one: -one.log_mass)))


def _as_one(alike: Sequence[Hypothesis]) -> Hypothesis:
    clearest = min(alike, key=lambda one: (_touched(one.explanation), -one.log_mass))
    return replace(clearest, log_mass=float(np.logaddexp.reduce([one.log_mass for one in alike])))


def _touched(explanation: Explanation) -> int:
    """How many channels its effects act on, each channel once for every effect."""
    return sum(int(np.count_nonzero(fit.touched(explanation.data))) for fit in explanation.fits)
