"""The candidates: every mean effect of the catalogue at every place, and what it would do to this recording.

To first order a candidate is linear in its strengths for any fixed shape: spanned shapes add columns, searched shapes
are tried one by one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from estimators.gap.data.projection import Columns
from estimators.gap.data.stack import only_in, part_of
from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.effects.parameters import Parameter, Value

Shape = Mapping[str, Value]

#: A recording, of several, with fewer samples shows no course in time: a few still poses, say.
_COURSE = 100


def split(label: str) -> tuple[str, str]:
    """Effect and place of a candidate's label."""
    effect, where = label.split("/")[0].split("@")
    return effect, where


@dataclass(frozen=True)
class Candidate:
    """An effect at a place.

    Attributes:
        effect: the effect's class.
        where: its place.
        names: values of its fields that are names, such as the source of a crosstalk.
    """

    effect: type[Effect]
    where: str
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Effect and place in one word, unique among candidates."""
        part = part_of(self.effect)
        recording = [] if part is None else [f"#{part + 1}"]
        return "/".join([f"{self.effect.name}@{self.where}", *self.names.values(), *recording])

    @property
    def smooth(self) -> bool:
        """Whether the effect changes little from sample to sample, and needs no single ones."""
        return not self.effect.tone and not self.effect.rapid and "nodes" not in self.effect.requires

    @property
    def strengths(self) -> tuple[Parameter, ...]:
        """The parameters at whose neutral value the effect vanishes."""
        return tuple(item for item in self.effect.parameters() if item.strength)

    @property
    def size(self) -> int:
        """The number of strengths."""
        return sum(item.size for item in self.strengths)

    @property
    def steps(self) -> Array:
        """(size,) strengths at which derivatives are taken."""
        return np.concatenate([np.full(item.size, item.step) for item in self.strengths])

    def make(self, strengths: Sequence[float] | Array, shape: Shape) -> Effect:
        """The effect with these strengths, one number each, and this shape."""
        values: dict[str, object] = {}
        numbers = iter(float(number) for number in strengths)
        for item in self.strengths:
            taken = tuple(itertools.islice(numbers, item.size))
            values[item.name] = taken[0] if item.size == 1 else taken
        return self.effect.from_mapping({"where": self.where, **self.names, **shape, **values})

    def columns(self, data: WhitenedData, shape: Shape) -> Columns:
        """Derivatives with respect to the strengths, at zero, for every spanning shape, span after span.

        Before them comes the change of an effect that acts by being there: it has no strength.
        """
        still = data.change([self.make(np.zeros(self.size), {})]) if self.effect.acts_at_zero else None
        spans = [self.derivatives(data, {**span, **shape}, still) for span in self.effect.spanning()]
        return data.whiten_changes(itertools.chain([] if still is None else [still], *spans))

    def derivatives(self, data: WhitenedData, shape: Shape, still: Array | None = None) -> Iterator[Array]:
        """(n, 6) [recorded unit] for each strength: the derivative at zero, for one full shape.

        Args:
            still: the change with all strengths at zero, where the effect acts by being there.
        """
        if still is None and self.effect.acts_at_zero:
            still = data.change([self.make(np.zeros(self.size), {})])
        for row, step in zip(np.diag(self.steps), self.steps, strict=True):
            change = data.change([self.make(row, shape)])
            yield (change if still is None else change - still) / step


def all_candidates(data: WhitenedData, without: Sequence[str] = ()) -> list[Candidate]:
    """Every mean effect at every place that this recording can show.

    Args:
        without: effects to leave out, as if the catalogue did not have them.
    """
    found = []
    for effect in EFFECTS.values():
        if effect.kind is not Kind.MEAN or effect.name in without or data.lacking(effect):
            continue
        choices = effect.choices()
        kinds = [effect]
        if effect.of_recording and len(data.parts) > 1:
            kinds = [only_in(effect, number) for number, part in enumerate(data.parts) if part.count >= _COURSE]
        for where, *names in itertools.product(effect.places_on(data.base), *choices.values()):
            for kind in kinds:
                candidate = Candidate(kind, where, dict(zip(choices, names, strict=True)))
                if where not in names and present(candidate, data):
                    found.append(candidate)
    return found


def present(candidate: Candidate, data: WhitenedData) -> bool:
    """Whether the sensor that the candidate acts on was recorded, and the frame that it names is known."""
    here = range(6)[candidate.make(np.zeros(candidate.size), {}).columns]
    joints = 0 if data.base.q_encoder is None else data.base.q_encoder.shape[1]
    if not set(here) & set(data.columns):
        return False
    # what a name asks for is not in the effect's requirements: a frame fixed in a link, a source that is not recorded
    return joints > 0 or not any(name.startswith("link") for name in candidate.names.values())


def still(candidate: Candidate, data: WhitenedData) -> bool:
    """Whether a candidate is an error of a joint that does not move."""
    if not candidate.where.startswith("joint") or data.base.q_encoder is None:
        return False
    return bool(np.ptp(data.base.q_encoder[:, int(candidate.where.removeprefix("joint")) - 1]) < 1e-3)
