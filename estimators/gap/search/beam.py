"""The search for sets of mean effects that may explain a recording: a beam of growing sets, then drops and swaps.

Sets are fitted on means over neighbouring samples first; the leading ones are fitted sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.means import Means
from estimators.gap.evidence.refine import Refit, explained_by, started
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.prior import Drawn, Prior
from estimators.gap.hypotheses.same_places import alike
from estimators.gap.hypotheses.scan import Scanner, ScoreTest
from estimators.gap.hypotheses.score import Explained
from estimators.gap.search.beside_discrepancy import scores_beside
from estimators.gap.search.explanation import Explanation, Key, Member, as_fitted, key_of, parted, to_refit, without_one
from estimators.gap.search.pairs import likely_pairs
from rig.progress import Progress

#: Sets of each size that are extended, additions that are fitted to each, and causes at most.
_BEAM: Final = (3, 2, 2, 1, 1, 1, 1)
_ADDED: Final = (10, 5, 4, 4, 3, 3, 3)
#: An addition whose score test promises less than this, beside the price of its place, is not fitted.
_HOPELESS: Final = 1.0
#: Log odds against the leading set beyond which a set is followed no further.
_FAR: Final = 14.0
#: And beyond which it is not extended.
_PROMISING: Final = 5.0
#: The share of what a dropped effect gained that another must promise to be fitted in its place.
_SWAPPED: Final = 0.5
#: Sets of more than this are not extended where something without effects is far likelier.
_FOLLOWED: Final = 2
#: So many sets of each size, and of all, are fitted sample by sample; what means over neighbours change of an
#: evidence, as a share.
_FINE_EACH, _FINE, _ROUGHLY = 3, 6, 0.02
#: Of so many sets, the last that were asked for, what they leave is kept.
_LEFT: Final = 6


@dataclass
class Search:
    """A search on one recording.

    Attributes:
        scanner: of the data. candidates: what is considered. prior: their probabilities.
        given: noise effects that are there, as the prior knows them.
        wide: whether additions are tried that promise far less than the best, as where much is wrong few keep theirs.
        improved: the sets whose effects were dropped and swapped one by one.
        overtaken: the set that belongs under another state of the noise, and its log mass there, where that ended it.
        finer: by what factor single samples tell more than means of sets that outlive these, those that led.
    """

    scanner: Scanner
    candidates: Sequence[Candidate]
    prior: Prior
    progress: Progress | None = None
    given: tuple[Drawn, ...] = ()
    wide: bool = False
    found: dict[tuple[Key, bool], Explanation] = field(default_factory=dict)
    explained: dict[tuple[Key, bool, bool], Explained] = field(default_factory=dict)
    improved: set[Key] = field(default_factory=set)
    overtaken: tuple[float, Explanation] | None = None
    finer: dict[Key, float] = field(default_factory=dict)

    @property
    def data(self) -> WhitenedData:
        """Sample by sample."""
        return self.scanner.fine.data

    @property
    def rough(self) -> WhitenedData:
        """Means over neighbouring samples."""
        return self.scanner.rough.data

    def run(
        self,
        seeds: Iterable[Sequence[Member]] = (),
        deep: bool = True,
        target: float = -np.inf,
        under_others: Callable[[Explanation], float] | None = None,
    ) -> list[Explanation]:
        """The explanations worth weighing, fitted sample by sample, the likeliest first.

        Args:
            seeds: sets to look at besides.
            deep: False to extend the leading set only.
            target: log mass of the best hypothesis without effects, beyond that of nothing at all: sets far below it
                are not extended for ever.
            under_others: log mass of a set under the likeliest other state of the noise. Where that is far likelier
                than what one more effect makes of the set, and no likelier with it, the search ends: it belongs under
                that state.
        """
        elsewhere: tuple[float, Explanation] | None = None
        level = [self.fitted(())]
        for seed in seeds:
            self.fitted(seed)
        for size, (beam, added) in enumerate(zip(_BEAM, _ADDED, strict=True)):
            if not deep:
                best = self.ranked[0]
                if size < len(best.members):
                    continue
                level, beam, added = [best], 1, 3
            grown: dict[Key, Explanation] = {}
            leading = level[0]
            for parent in level[:beam]:
                for members in self.additions(parent, added):
                    each = self.fitted(members)
                    grown[each.key] = each
            grown |= {each.key: each for each in self._of_size(size + 1)}
            level = sorted(grown.values(), key=lambda each: -self.gained(each))
            if self.progress is not None:
                self.progress((size + 1) / len(_BEAM))
            best = self.ranked[0]
            if not deep and best.members and len(best.members) <= size:
                break
            level = [each for each in level if self.gained(each) > self.gained(best) - _PROMISING]
            # sample by sample, to first order where it is not fitted
            if not level or (size >= _FOLLOWED and self._far_behind(level[0], self.fine(()).log_mass + target)):
                break
            if not deep or under_others is None:
                continue
            told = self.fine(leading.members, leading)
            here = under_others(told), told
            if elsewhere is None or here[0] > elsewhere[0]:
                elsewhere = here
            if size + 1 < _FOLLOWED or not self._far_behind(level[0], elsewhere[0]):
                continue
            self._improve(3)  # two may explain together what neither does alone
            level = self._of_size(size + 1)
            if self._far_behind(self.ranked[0], elsewhere[0]):
                grown_too = [self.fine(each.members, each) for each in level[:beam]]
                likeliest = max(((under_others(each), each) for each in grown_too), key=lambda one: one[0])
                if likeliest[0] <= elsewhere[0]:
                    self.overtaken = elsewhere
                    return self._refined()
                elsewhere = likeliest
        if deep or self.wide:
            self._improve(1 if self.wide else 3)
        if deep:
            self._pair(self._refined()[0])
        found = self._refined()
        while deep and len(found[0].members) > 1 and found[0].key not in self.improved:
            self._swap(found[0])  # sample by sample another set may lead
            found = self._refined()
        return found

    def fitted(self, members: Sequence[Member]) -> Explanation:
        """A set, fitted together on means over neighbouring samples where all its effects outlive these."""
        return self._fitted(members, self.rough if _smooth(members) else self.data)

    def _fitted(self, members: Sequence[Member], data: WhitenedData) -> Explanation:
        fine = data is self.data
        key = key_of(members), fine
        if key not in self.found or not self.found[key].refitted:
            rough = self.rough if _smooth(members) else None
            refitted = converged([member.fit for member in members], data, rough)
            prior = self._log_prior(members)
            each = Explanation.of(members, refitted, prior, fine)
            own = each.members
            instants = [index for index, member in enumerate(own) if member.widths] if fine else []
            fine_ones = (one.log_mass for one in self.found.values() if one.fine)
            if instants and each.log_mass > max(fine_ones, default=-np.inf) - _FAR:
                for index in instants:
                    own, refitted = self._at_its_instant(own, index, refitted)
                each = Explanation.of(own, refitted, prior, fine)
            self.found[key] = each.where_likeliest()
        return self.found[key]

    def _log_prior(self, members: Sequence[Member]) -> float:
        return self.prior.log_set([*self.given, *(member.drawn for member in members)])

    def _at_its_instant(
        self, members: tuple[Member, ...], index: int, refitted: Refit
    ) -> tuple[tuple[Member, ...], Refit]:
        """The set with one effect at the instant that is likeliest beside the others: it was found without these."""
        member, others = members[index], [*refitted.fits[:index], *refitted.fits[index + 1 :]]
        look = self.scanner.beside([fit.effect for fit in others], refitted.data.pipeline).fine
        explained = explained_by(others, refitted.data)
        tested = look.best(member.fit.candidate, explained)[0]
        fit, same = member.fit, all(member.fit.kept[name] == tested.shape[name] for name in tested.widths)
        again = refitted
        if not same and tested.score.strengths.size:
            fit = started(tested, look.data, explained)
            again = converged([*refitted.fits[:index], fit, *refitted.fits[index + 1 :]], refitted.data)
            if again.attained > refitted.attained:
                return members, refitted
        own = list(as_fitted(members, again))
        own[index] = replace(own[index], searched=tested.spread, widths=tested.widths)
        return tuple(own), again

    def additions(self, parent: Explanation, most: int, floor: float = -np.inf) -> list[tuple[Member, ...]]:
        """The set with one more effect each: the most promising ones, of those that promise more than ``floor``."""
        grouped = [(0.5 * group[0].score.evidence + price, group) for price, group in self._priced(parent)]
        grouped.sort(key=lambda pair: -pair[0])
        least = -np.inf if self.wide or not grouped else grouped[0][0] - max(_FAR, 0.3 * abs(grouped[0][0]))
        least = max(least, floor)
        hopeful = [group for promise, group in grouped if promise > least and 0.5 * group[0].score.evidence > _HOPELESS]
        return [(*parent.members, self._member(group, parent)) for group in hopeful[:most]]

    def _priced(self, parent: Explanation) -> list[tuple[float, list[ScoreTest]]]:
        """Score tests of what may be added to a set, places that do the same together, and the price of each."""
        held = {label for member in parent.members for label in member.labels}
        found = []
        for group in alike(self.score_tests(parent), self.prior):
            tested = group[0]
            searched = tested.candidate.effect.searched(self.rough.base) != [{}]
            if tested.score.rank and tested.score.strengths.size and (searched or tested.candidate.label not in held):
                labels = tuple(each.candidate.label for each in group)
                price = self.prior.log_single((tested.candidate.effect.name, labels)) - max(tested.spread, 0.0)
                found.append((price, group))
        return found

    def _pair(self, best: Explanation) -> None:
        """A set with two effects in the place of each, and two others in the place of each two."""
        for out, kept in (*parted(best.members, 1), *parted(best.members, 2)):
            rest, gone = self.fitted(kept), {label for member in out for label in member.labels}
            priced = [each for each in self._priced(rest) if each[1][0].candidate.label not in gone]
            least = _SWAPPED * (self.gained(best) - self.gained(rest))
            for both in likely_pairs(priced, least, self._scanner(rest).rough, self._left(rest, self.rough)):
                self.fitted((*rest.members, *(self._member(group, rest) for group in both)))

    def score_tests(self, parent: Explanation) -> list[ScoreTest]:
        """Every candidate's score beside a set."""
        explained = self._left(parent, self.data)
        roughly = explained if self.rough is self.data else self._left(parent, self.rough)
        return self._scanner(parent).scan(self.candidates, explained, roughly)

    def _scanner(self, parent: Explanation) -> Scanner:
        """With derivatives where a set holds, as a score test asks for."""
        return self.scanner.beside([fit.effect for fit in parent.fits], parent.data.pipeline)

    def _left(self, parent: Explanation, data: WhitenedData) -> Explained:
        key = parent.key, parent.fine, data is self.data
        if key not in self.explained:
            if data is self.data or _smooth(parent.members):
                moved = data if not parent.members else data.like(parent.data)
                self.explained[key] = explained_by(parent.fits, moved)
            else:  # what needs single samples is not to be seen on means: it is summed up from these
                means, fine = Means(self.data, self.rough), self._left(parent, self.data)
                left = project(self.rough.absorbed, means(fine.residual[:, None]))[:, 0]
                own = Explained(self.rough.absorbed, left)
                self.explained[key] = own if fine.added is None else own.extended(means(fine.added))
            if len(self.explained) > _LEFT:
                del self.explained[next(iter(self.explained))]
        return self.explained[key]

    def _member(self, group: Sequence[ScoreTest], parent: Explanation) -> Member:
        tested = group[0]
        smooth = tested.candidate.smooth and _smooth(parent.members)
        scanner, labels = self._scanner(parent), tuple(each.candidate.label for each in group)
        look, data = (scanner.rough, self.rough) if smooth else (scanner.fine, self.data)
        return Member(started(tested, look.data, self._left(parent, data)), tested.spread, labels, tested.widths)

    def beside(self, parent: Explanation, weighed: Weighed) -> list[Explanation]:
        """The set with one more effect each, by their scores beside a discrepancy."""
        held, scanner = {member.label for member in parent.members}, self._scanner(parent)
        others = [each for each in self.candidates if each.label not in held]
        of_means = weighed.term.errors.means is not None
        on_means = [each for each in others if of_means and each.smooth]
        on_samples = [each for each in others if not (of_means and each.smooth)]
        scored = scores_beside(on_means, weighed, scanner, scanner.rough, self._left(parent, self.rough))
        scored += scores_beside(on_samples, weighed, scanner, scanner.fine, self._left(parent, self.data))
        prices = [self.prior.log_single((one.candidate.effect.name, (one.candidate.label,))) for _, one in scored]
        promises = sorted(zip(scored, prices, strict=True), key=lambda each: -each[0][0] - each[1])
        found = []
        for (gained, tested), price in promises[:3]:
            if gained + price > -_FAR and tested.score.strengths.size:
                members = (*parent.members, self._member([tested], parent))
                found.append(self._fitted(members, self.data))
                if tested.candidate.effect.tone:  # a fit that knows nothing of the discrepancy moves its frequency
                    found.append(Explanation(members, parent.data, self._log_prior(members), True))
        return found

    def without_one(self, each: Explanation) -> list[Explanation]:
        """The set without each of its effects, sample by sample."""
        rests = {rest.key: rest for rest in (self.fitted(rest) for rest in without_one(each.members))}
        return [self.fine(rest.members, rest) for rest in rests.values()]

    def _improve(self, rounds: int) -> None:
        """Drops and swaps of the leading set, until nothing is better."""
        for _ in range(rounds):
            best = self.ranked[0]
            if len(best.members) < 2:
                return
            self._swap(best)
            if self.ranked[0] is best:
                return

    def _swap(self, best: Explanation) -> None:
        """A set without each of its effects, and with others in its place."""
        self.improved.add(best.key)
        for rest in map(self.fitted, without_one(best.members)):
            # what promises far less than was dropped is no better: a score is about what a fit gains
            for members in self.additions(rest, 3, _SWAPPED * (self.gained(best) - self.gained(rest))):
                self.fitted(members)

    def gained(self, each: Explanation) -> float:
        """Log mass beyond that of the set without effects, the same for all sets: as means over neighbouring samples
        tell it, and what needs single samples for what it adds on them."""
        if self.rough is self.data:
            return each.log_mass - self.fine(()).log_mass
        slow = tuple(member for member in each.members if member.fit.candidate.smooth)
        alone = len(slow) == len(each.members)
        rough = each if not each.fine and alone else self.fitted(slow)
        own = (rough.log_mass - self._fitted((), self.rough).log_mass) * self._finer()
        without = 0.0 if alone else self.fine(slow, rough).log_mass
        if not np.isfinite(without):  # an effect does nothing without the others
            return each.log_mass - self.fine(()).log_mass
        return own if alone else own + each.log_mass - without

    def _finer(self) -> float:
        """Beside sets that need single samples: by what factor these tell more than means of the likeliest that does
        not. A hundredth of what a strong cause gains is more than what tells it from a tone."""
        if all(_smooth(each.members) for each in self.found.values()):
            return 1.0
        nothing = self._fitted((), self.rough)
        best = max((each for each in self.found.values() if not each.fine), key=lambda each: each.log_mass)
        own = best.log_mass - nothing.log_mass
        if own <= _FAR:
            return 1.0
        if best.key not in self.finer:
            told = self.fine(best.members, best).log_mass - self.fine(()).log_mass
            self.finer[best.key] = max(told / own, 1.0)
        return self.finer[best.key]

    def _far_behind(self, each: Explanation, log_mass: float) -> bool:
        """Whether a set is far less likely, sample by sample."""
        return self.fine(each.members, each).log_mass < log_mass - _FAR

    @property
    def ranked(self) -> list[Explanation]:
        """The sets as they were searched, those that lead first."""
        found = [each for each in self.found.values() if each.fine != _smooth(each.members) or self.rough is self.data]
        return sorted(found, key=lambda each: -self.gained(each))

    def _of_size(self, size: int) -> list[Explanation]:
        return [each for each in self.ranked if len(each.members) == size]

    def _refined(self) -> list[Explanation]:
        """The leading sets, fitted sample by sample."""
        ranked = self.ranked
        if self.rough is self.data:
            return ranked
        margin = _FAR + _ROUGHLY * max(self.gained(ranked[0]), 0.0)
        near = [each for each in ranked if self.gained(each) > self.gained(ranked[0]) - margin]
        of_size: dict[int, list[Explanation]] = {}
        for each in near:
            of_size.setdefault(len(each.members), []).append(each)
        chosen = near[:_FINE] + [each for own in of_size.values() for each in own[:_FINE_EACH]]
        leading = self._fitted(chosen[0].members, self.data)
        keys = {key_of(subset) for subset in without_one(chosen[0].members) if subset}
        sizes = {len(each.members): each for each in reversed(ranked)}  # the best of each size, for other noise
        wanted = (
            chosen[1:]
            + [each for each in sizes.values() if each.members and not each.fine]
            + [each for each in ranked if each.key in keys and not each.fine and not any(each is one for one in chosen)]
        )
        found = {each.key: each for each in (self._near(each, leading) for each in wanted)}
        found |= {key: each for (key, fine), each in self.found.items() if fine and each.refitted}
        found |= {(): self.fine(()), leading.key: leading}
        while rough_ones := to_refit(list(found.values())):
            for each in rough_ones:
                found[each.key] = self._fitted(each.members, self.data)
        return sorted(found.values(), key=lambda each: -each.log_mass)

    def _near(self, each: Explanation, leading: Explanation) -> Explanation:
        """A set sample by sample, to first order: about the leading set, where that has all but one of its effects."""
        shared = {member.label: member for member in leading.members}
        known = [member.label in shared for member in each.members]
        alone = len(shared) == len(leading.members) and len(each.key) == len(set(each.key))
        if alone and each.members and sum(known) >= max(len(known) - 1, 1) and (each.key, True) not in self.found:
            members = tuple(shared.get(member.label, member) for member in each.members)
            each = replace(each, members=members, data=leading.data)
        return self.fine(each.members, each)

    def fine(self, members: Sequence[Member], rough: Explanation | None = None) -> Explanation:
        """A set sample by sample, where it was fitted on means: the evidence takes what is left to first order."""
        key = key_of(members), True
        if key not in self.found:
            if rough is None or rough.fine:
                return self._fitted(members, self.data)
            moved = self.data.like(rough.data)
            self.found[key] = replace(rough, data=moved, fine=True, refitted=False)
        return self.found[key]


def _smooth(members: Sequence[Member]) -> bool:
    """Whether all effects outlive means over neighbouring samples."""
    return all(member.fit.candidate.smooth for member in members)
