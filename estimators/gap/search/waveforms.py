"""An effect with a waveform over the recording is a source along time, and a slow course of that source is no unknown
thing: a supply that sags, or swings at one frequency, is told by jumps or by a spectrum better than by cosines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import project
from estimators.gap.evidence.discrepancy import total
from estimators.gap.evidence.states import NoiseState
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.candidates import split
from estimators.gap.hypotheses.courses import half_waves, in_time
from estimators.gap.hypotheses.prior import PROCESS
from estimators.gap.hypotheses.sources import STRENGTH
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.further_unknowns import SECOND, without_common
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.weighing import FAR, NEAR, UNKNOWN, Weighing, nothing_else
from rig.arrays import Array

#: Of a slow course the effect's cosines take most.
_SLOW: Final = 0.5
#: Squared cosine from which on an effect is one source along time.
_SAME: Final = 0.99


@dataclass(frozen=True)
class _Waveform:
    """An effect of a hypothesis whose strengths are those of cosines.

    Attributes:
        explanation: that holds it. state: of the noise. index: its number there.
    """

    explanation: Explanation
    state: NoiseState
    index: int

    @property
    def label(self) -> str:
        return self.explanation.members[self.index].label

    @property
    def cosines(self) -> NDArray[np.bool_]:
        """(p,) which parameters are strengths of its cosines."""
        linear = self.explanation.linear
        assert linear.orders is not None
        return np.asarray((linear.owner == self.index) & (linear.orders > 0))

    @property
    def others(self) -> tuple[str, ...]:
        """The labels of the other effects."""
        return tuple((Counter(self.explanation.key) - Counter([self.label])).elements())

    def acts_as(self, term: Weighed) -> bool:
        """Whether a term is of the source that the effect is, along time."""
        if not in_time(term.term.course):
            return False
        if term.term.source.startswith(STRENGTH):
            effect, where = split(self.label)
            return term.term.source == f"{STRENGTH}{effect} at {where}"
        series = _series(term)
        data = self.explanation.data
        if series is None or series.size != data.size:
            return False
        linear = self.explanation.linear
        assert linear.orders is not None
        first = linear.tangent[:, (linear.owner == self.index) & (linear.orders == 1)][:, 0]
        slowest = half_waves(data.count, np.ones(1, dtype=int))[:, 0]
        along = project(data.absorbed, np.ravel(series * slowest))
        return float(first @ along) ** 2 > _SAME * float(first @ first) * float(along @ along)

    def is_slow(self, term: Weighed, beside: Explanation) -> bool:
        """Whether its cosines take most of what a term beside a set of effects is most likely to be."""
        made = term.term.of_every_sample(beside.linear.left, int(np.argmax(term.gains)))
        made = project(beside.data.absorbed, made)
        if beside is self.explanation:
            made = made + self.explanation.changes[self.index]
        columns = self.explanation.linear.tangent[:, self.cosines]
        left = made - columns @ np.linalg.lstsq(columns, made, rcond=1e-9)[0]
        return float(left @ left) < (1.0 - _SLOW) * float(made @ made)


def weigh_other_waveforms(work: Weighing) -> None:
    """Every likely set that has an effect with a waveform, without it beside discrepancies: one of them may be its
    waveform, of this set as well as of another."""
    alone = [one for one in work.hypotheses.values() if not one.terms and one.log_mass > work.best - FAR - NEAR]
    waveforms = [(one, each) for one in alone for each in _waveforms([one])]
    near = max((one.log_mass for one, _ in waveforms), default=np.inf) - NEAR
    for one, each in waveforms:
        weighed = (other for other in work.hypotheses.values() if other.terms and other.state.kind == one.state.kind)
        known = any(Counter(other.explanation.key) == Counter(each.others) for other in weighed)
        if known or one.log_mass < near:
            continue
        members = each.explanation.members
        rest = members[: each.index] + members[each.index + 1 :]
        state = without_common(work, one)
        scanner = work.scanner.stepped(state.steps)
        search = work.search(state, scanner)
        work.enter_nameless(search.fine(rest, search.fitted(rest)), state, work.discrepancies_under(state, scanner))


def with_own_courses(hypotheses: Iterable[Hypothesis], sources: int) -> list[Hypothesis]:
    """The hypotheses, with slow courses in time of what an effect with a waveform acts on as that effect.

    Args:
        hypotheses: all that were weighed. sources: how many sources a discrepancy may be of.
    """
    every = list(hypotheses)
    waveforms = list(_waveforms(every))
    if not waveforms:
        return every
    labels = {each.label for each in waveforms}
    likely = max(each.log_mass for each in every) - FAR
    found, moved = list[Hypothesis](), list[Hypothesis]()
    for one in every:
        left: Hypothesis | None = one
        if one.log_mass > likely and one.terms:
            left, also = _divided(one, [each for each in waveforms if each.state.kind == one.state.kind], sources)
            moved += also
        if left is not None:
            copies = sum(label in labels for label in one.explanation.key)
            found.append(replace(left, log_mass=left.log_mass + copies * float(np.log(PROCESS))))
    return _merged([*found, *moved])


def _waveforms(every: Sequence[Hypothesis]) -> Iterator[_Waveform]:
    """Effects with a waveform, of each set under each noise where it is likeliest."""
    known: set[tuple[object, ...]] = set()
    for one in sorted(every, key=lambda each: -each.log_mass):
        explanation = one.explanation
        key = explanation.key, one.state.kind
        if key in known:
            continue
        known.add(key)
        for index, member in enumerate(explanation.members):
            if any(item.of_cosines for item in member.fit.free):
                yield _Waveform(explanation, one.state, index)


def _divided(
    one: Hypothesis, waveforms: Sequence[_Waveform], sources: int
) -> tuple[Hypothesis | None, list[Hypothesis]]:
    """What is left of a hypothesis, and what part of it is an effect with another waveform."""
    before, key = one.explanation, one.explanation.key
    for each in waveforms:
        if Counter(each.explanation.key if each.label in key else each.others) != Counter(key):
            continue
        if each.label in key:  # as it was fitted in this very hypothesis
            each = _Waveform(before, one.state, [own.label for own in before.members].index(each.label))
        own = [term for term in one.terms if each.acts_as(term) and each.is_slow(term, before)]
        if not own:
            continue
        rest = [term for term in one.terms if not any(term is other for other in own)]
        whole = total([term.log_mass for term in one.terms])
        # the effect's prior for the unknown's: one source, not one of all
        taken = total([term.log_mass - term.log_share for term in own]) + float(np.log(sources * (1.0 - PROCESS)))
        taken += each.explanation.log_prior - before.log_prior - whole
        if one.further:
            terms, further, price = one.further[0], one.further[1:], -SECOND
        else:
            terms, further, price = (), (), nothing_else(one.state) - UNKNOWN
        part = Hypothesis(each.explanation, each.state, terms, one.log_mass + taken + price, further)
        if not rest:
            return None, [part]
        left = one.log_mass - whole + total([term.log_mass for term in rest])
        return replace(one, terms=tuple(rest), log_mass=left), [part]
    return one, []


def _series(term: Weighed) -> Array | None:
    """(c, n) what one source does to whitened readings; None of one with several freedoms."""
    source = term.term.of_samples or term.term.alone
    several = term.term.errors.of_channels(term.term.freedoms) if source is None else source.series
    return several[0] if len(several) == 1 else None


def _merged(every: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of the same set, noise and unknown things as one."""
    found: dict[tuple[object, ...], Hypothesis] = {}
    for one in every:
        known = found.get(one.kind)
        if known is None:
            found[one.kind] = one
        else:
            likelier = max(known, one, key=lambda each: each.log_mass)
            found[one.kind] = replace(likelier, log_mass=float(np.logaddexp(known.log_mass, one.log_mass)))
    return list(found.values())
