"""Explanations: sets of mean effects, fitted together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear, linearised
from estimators.gap.evidence.refine import Fitted, Refit, at, refit
from estimators.gap.hypotheses.prior import Drawn
from rig.arrays import Array
from rig.effects import Effect

Key = tuple[str, ...]

#: Log posterior that straight on from a fit is gained, from which on that is no approximation; gained where a refit is
#: near enough, and refits at most.
_ELSEWHERE: Final = 10.0
_THERE, _ANEW = 1.0, 3
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
    return [members[:index] + members[index + 1 :] for index in range(len(members))]


def distinct(found: Iterable[Explanation]) -> list[Explanation]:
    """Of explanations with the same set the first."""
    first: dict[Key, Explanation] = {}
    for each in found:
        first.setdefault(each.key, each)
    return list(first.values())


def as_fitted(members: Sequence[Member], refitted: Refit) -> tuple[Member, ...]:
    """Members as they were fitted together."""
    return tuple(replace(member, fit=fit) for member, fit in zip(members, refitted.fits, strict=True))


@dataclass(frozen=True)
class Explanation:
    """A set of mean effects, fitted together in whitened data.

    Attributes:
        members: the effects. data: whitened around the calibration that fits best with them.
        log_prior: of the set. fine: whether it was fitted sample by sample.
        refitted: the fit on these very data, where there was one.
    """

    members: tuple[Member, ...]
    data: WhitenedData
    log_prior: float
    fine: bool
    refitted: Refit | None = None

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
        return replace(self, data=data.around(self.data.pipeline), refitted=None)

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
        if not each.members or not each.linear.felt or each.linear.ahead < _ELSEWHERE:
            return each
        for _ in range(_ANEW):
            linear = each.linear
            held = np.where(linear.strength, linear.precision(linear.averaged[1]), 0.0)
            refitted = refit(each.fits, each.data, held=held)
            each = replace(each, members=as_fitted(each.members, refitted), refitted=refitted)
            if not each.linear.felt or each.linear.ahead < _THERE:
                break
        return each

    def own_change(self, index: int, data: WhitenedData) -> Array:
        """(n, 6) change of one effect in some data, beside the others."""
        effects = [fit.effect for fit in self.fits]
        return data.change(effects) - data.change(effects[:index] + effects[index + 1 :])

    def whitened_change(self, index: int) -> tuple[Array, Array]:
        """(c n,) the same in its own data, and (c n, p) its derivatives by the effect's parameters."""
        return self.data.whiten(self.own_change(index, self.data)), self.linear.tangent[:, self.linear.owner == index]

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

    def moved(self, by: float) -> list[list[Effect]]:
        """The effects with one shape that a fit keeps moved by so many standard deviations, for each such shape."""
        effects, found = [fit.effect for fit in self.fits], []
        for index, member in enumerate(self.members):
            kept = member.fit.kept
            for name, width in member.widths.items():
                fit = replace(member.fit, kept={**kept, name: float(np.asarray(kept[name])) + by * width})
                found.append([*effects[:index], fit.effect, *effects[index + 1 :]])
        return found

    @cached_property
    def linear(self) -> Linear:
        """Linearised where it was fitted."""
        refitted = self.refitted or at(self.fits, self.data)
        return linearised(refitted, sum(member.searched for member in self.members))

    @cached_property
    def log_mass(self) -> float:
        """Log evidence and log prior; none where an effect does nothing at the fitted values."""
        if not self.linear.felt:
            return -np.inf
        return self.linear.averaged[0] + self.log_prior
