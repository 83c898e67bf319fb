"""Explanations: sets of mean effects, fitted together."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import combinations
from typing import Final
from weakref import ref

import numpy as np

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear, linearised
from estimators.gap.evidence.refine import Fitted, Refit, at, refit
from estimators.gap.hypotheses.prior import Drawn
from rig.arrays import Array
from rig.effects import Effect

Key = tuple[str, ...]

#: Log odds within which rivals of the leading set are fitted themselves.
_CLOSE: Final = 6.0
#: Log posterior that straight on from a fit is gained, from which on that is no approximation; gained where a refit is
#: near enough, and refits at most.
_ELSEWHERE: Final = 3.0
_THERE, _ANEW = 1.0, 3
#: Linearised explanations are kept of so many numbers, 64 MB; others are linearised again where they are asked for.
_NUMBERS: Final = 8_000_000
#: What is gained by moving, beyond which first order may be wrong by as much.
STRAIGHT: Final = 0.1


@dataclass(frozen=True)
class Member:
    """An effect in a set.

    Attributes:
        fit: what was fitted. searched: the price of what was searched.
        labels: of the places at which it does the same, its own first.
        widths: standard deviations of shapes that a fit keeps.
    """

    fit: Fitted
    searched: float
    labels: tuple[str, ...]
    widths: Mapping[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Effect and place in one word."""
        return self.fit.candidate.label

    @property
    def drawn(self) -> Drawn:
        """As the prior knows it."""
        return self.fit.candidate.effect.name, self.labels


def key_of(members: Sequence[Member]) -> Key:
    """The labels of a set, sorted."""
    return tuple(sorted(member.label for member in members))


def without_one(members: tuple[Member, ...]) -> list[tuple[Member, ...]]:
    """A set without each of its members."""
    return [kept for _, kept in parted(members, 1)]


def parted(members: tuple[Member, ...], count: int) -> Iterator[tuple[tuple[Member, ...], tuple[Member, ...]]]:
    """Each so many of a set's members, and the others."""
    for out in combinations(range(len(members)), count):
        kept = (member for index, member in enumerate(members) if index not in out)
        yield tuple(members[index] for index in out), tuple(kept)


def distinct(found: Iterable[Explanation]) -> list[Explanation]:
    """Of explanations with the same set the first."""
    first: dict[Key, Explanation] = {}
    for each in found:
        first.setdefault(each.key, each)
    return list(first.values())


def to_refit(found: Sequence[Explanation]) -> list[Explanation]:
    """The leading set, and those that may be nearly as likely: first order may be wrong by all that it gains."""
    best = max(found, key=lambda each: each.log_mass)
    if not best.refitted:
        return [best]
    within = best.log_mass - _CLOSE
    return [
        each
        for each in found
        if not each.refitted and each.felt
        if each.ahead > STRAIGHT and each.log_mass + each.ahead > within
    ]


def as_fitted(members: Sequence[Member], refitted: Refit) -> tuple[Member, ...]:
    """Members as they were fitted together."""
    return tuple(replace(member, fit=fit) for member, fit in zip(members, refitted.fits, strict=True))


@dataclass(frozen=True)
class Explanation:
    """A set of mean effects, fitted together in whitened data.

    Attributes:
        members: the effects. data: whitened around the calibration that fits best with them.
        log_prior: of the set. fine: whether it was fitted sample by sample.
        refitted: whether it was fitted on these very data. short: as of ``Refit``.
    """

    members: tuple[Member, ...]
    data: WhitenedData
    log_prior: float
    fine: bool
    refitted: bool = False
    short: float = 0.0

    @classmethod
    def of(cls, members: Sequence[Member], refitted: Refit, log_prior: float, fine: bool) -> Explanation:
        """Of members as they were fitted together."""
        own = as_fitted(members, refitted)
        found = cls(own, refitted.data, log_prior, fine, refitted=True, short=refitted.short)
        found._linearise(refitted)
        return found

    @property
    def key(self) -> Key:
        """The labels, sorted."""
        return key_of(self.members)

    @property
    def fits(self) -> list[Fitted]:
        """What was fitted."""
        return [member.fit for member in self.members]

    def on(self, data: WhitenedData) -> Explanation:
        """The same set as it was fitted, in other data, or under other noise."""
        found = replace(self, data=data.like(self.data), refitted=False, short=0.0)
        if not self.short:
            return found
        own, other = (float(each.linear.left @ each.linear.left) for each in (self, found))
        return replace(found, short=self.short * other / own)

    @property
    def seeds(self) -> list[tuple[Member, ...]]:
        """Where another search may start: the set, and what is left of it when one or all but one of its members go."""
        found = [self.members, *without_one(self.members), *((member,) for member in self.members)]
        return [seed for seed in found if seed]

    def where_likeliest(self) -> Explanation:
        """The set refitted under the prior of its own strengths, where that is far from where it was fitted.

        Laplace's approximation is about the likeliest values. Of effects that nearly do the same, such as two warm-ups,
        a fit that leaves least has large ones against each other, and straight on from there lie any number of others.
        """
        each = self
        if not each.members or not each.felt or each.short or each.ahead < _ELSEWHERE:
            return each
        for _ in range(_ANEW):
            linear = each.linear
            held = np.where(linear.strength, linear.likeliest, 0.0)
            each = Explanation.of(each.members, refit(each.fits, each.data, held=held), each.log_prior, each.fine)
            if not each.felt or each.ahead < _THERE:
                break
        return each

    def own_change(self, index: int, data: WhitenedData) -> Array:
        """(n, 6) change of one effect in some data, beside the others."""
        effects = [fit.effect for fit in self.fits]
        return data.change(effects) - data.change(effects[:index] + effects[index + 1 :])

    def change_and_slopes(self, index: int) -> tuple[Array, Array]:
        """(n, 6) the same in its own data, and (c n, p) its whitened derivatives by the effect's parameters."""
        return self.own_change(index, self.data), self.linear.tangent[:, self.linear.owner == index]

    @cached_property
    def changes(self) -> list[Array]:
        """(c n,) what each effect does to whitened readings beside the others, less what the calibration takes."""
        every = range(len(self.members))
        return [project(self.data.absorbed, self.data.whiten(self.own_change(index, self.data))) for index in every]

    @cached_property
    def own_columns(self) -> list[Array]:
        """The same, less what the other effects can do."""
        found = []
        for index, along in enumerate(self.changes):
            beside = self.linear.tangent[:, self.linear.owner != index]
            found.append(along - beside @ np.linalg.lstsq(beside, along, rcond=1e-9)[0] if beside.shape[1] else along)
        return found

    def let_go(self) -> None:
        """Keep what is asked for of every set, without the arrays that it was made of."""
        for name in ("_linear", "changes", "own_columns"):
            vars(self).pop(name, None)
        if self.data.moved:
            own = {each.name for each in fields(self.data)}
            for name in [name for name in vars(self.data) if name not in own]:
                del vars(self.data)[name]

    def moved(self, by: float) -> list[list[Effect]]:
        """The effects with one shape that a fit keeps moved by so many standard deviations, for each such shape."""
        effects, found = [fit.effect for fit in self.fits], []
        for index, member in enumerate(self.members):
            kept = member.fit.kept
            for name, width in member.widths.items():
                fit = replace(member.fit, kept={**kept, name: float(np.asarray(kept[name])) + by * width})
                found.append([*effects[:index], fit.effect, *effects[index + 1 :]])
        return found

    @property
    def linear(self) -> Linear:
        """Linearised where it was fitted."""
        return vars(self).get("_linear") or self._linearise(at(self.fits, self.data))

    def _linearise(self, refitted: Refit) -> Linear:
        found = linearised(refitted, sum(member.searched for member in self.members) + 0.5 * self.short)
        vars(self)["_linear"] = found
        _keep(self, found.tangent.size)
        return found

    @cached_property
    def felt(self) -> bool:
        """Whether every effect does something at the fitted values."""
        return self.linear.felt

    @cached_property
    def ahead(self) -> float:
        """Log likelihood and prior that moving on from there gains, to first order."""
        return self.linear.ahead

    @cached_property
    def log_mass(self) -> float:
        """Log evidence and log prior; none where an effect does nothing at the fitted values."""
        return self.linear.averaged[0] + self.log_prior if self.felt else -np.inf


#: Those that are linearised, each once, in the order in which they were, and of how many numbers that is.
_kept: Final[deque[tuple[ref[Explanation], int]]] = deque()


def _keep(each: Explanation, numbers: int) -> None:
    """Let the first ones go where all are more than fits."""
    _kept.append((ref(each), numbers))
    alive = [(own, size) for own, size in _kept if own() is not None]
    _kept.clear()
    _kept.extend(alive)
    total = sum(size for _, size in alive)
    while total > _NUMBERS and len(_kept) > 1:
        own, size = _kept.popleft()
        total -= size
        if (gone := own()) is not None:
            gone.let_go()
