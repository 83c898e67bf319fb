"""Several recordings as one: the same calibration and the same effects, each with its own noise and sampling.

Whitened readings of different recordings are independent, and every one has variance one: put one after another in each
channel they are one whitened problem, of which nothing needs to know how many recordings it has. What an effect does to
a recording is found recording by recording, as effects look at the samples before. The clock runs on from one to the
next, in the order in which they were made: what jumps stays as it is from then on. A calibration from before is one of
them (``estimators.gap.data.anchor``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.anchor import Anchor
from estimators.gap.data.steps import Step
from estimators.gap.data.tangent import ChannelTangent, along, of_readings, size
from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array
from rig.effects import Effect
from rig.pipeline import Pipeline
from rig.signals import Signals, joined


@lru_cache(maxsize=1024)
def only_in(effect: type[Effect], part: int) -> type[Effect]:
    """The effect as one that acts in a single recording, by its number."""
    return type(effect.__name__, (effect,), {"part": part, "__doc__": effect.__doc__})


def part_of(effect: Effect | type[Effect]) -> int | None:
    """The number of the recording in which alone an effect acts; None: in all."""
    found: int | None = getattr(effect, "part", None)
    return found


@dataclass(frozen=True)
class Stack(WhitenedData):
    """Recordings one after another; the attributes of ``WhitenedData`` are theirs, joined.

    Attributes:
        each: recording by itself, around the same calibration.
        names: of the recordings. began: [s] what was added to the clock of each.
    """

    each: tuple[WhitenedData, ...] = ()
    names: tuple[str, ...] = ()
    began: tuple[float, ...] = ()

    @classmethod
    def of(
        cls,
        members: Sequence[WhitenedData],
        names: Sequence[str],
        pipeline: Pipeline,
        began: Sequence[float],
        steps: Sequence[Step] = (),
    ) -> Stack:
        """Of whitened whose clocks run on from one to the next.

        Args:
            members: their pipelines have the sensors that were recorded, and the calibration of ``pipeline``.
        """
        first = members[0]
        whole = joined([member.base for member in members])
        volts, inputs = np.nan_to_num(whole.volts), np.nan_to_num(whole.inputs)
        return cls(
            base=replace(whole, volts=volts, inputs=inputs),
            pipeline=pipeline,
            readings=np.nan_to_num(np.concatenate([member.readings for member in members])),
            noises=first.noises,
            weights=np.concatenate([member.weights for member in members]),
            floor=first.floor,
            block=first.block,
            samples=first.samples,
            steps=tuple(steps),
            each=tuple(members),
            names=tuple(names),
            began=tuple(began),
        )

    @property
    def parts(self) -> tuple[WhitenedData, ...]:
        """The recordings; not a calibration from before."""
        return tuple(member for member in self.each if not isinstance(member, Anchor))

    @cached_property
    def stretches(self) -> tuple[slice, ...]:
        """Where each of the members is among the means of a channel."""
        return _slices([member.count for member in self.each])

    @cached_property
    def single(self) -> tuple[slice, ...]:
        """Where each of the members is among the samples."""
        return _slices([len(member.base) for member in self.each])

    @cached_property
    def t(self) -> Array:
        """(count,) [s] of the means."""
        return np.concatenate([member.t for member in self.each])

    def means(self, column: int, values: Array) -> Array:
        """As of ``WhitenedData``, recording by recording."""
        return np.concatenate(
            [member.means(column, values[..., own]) for member, own in zip(self.each, self.single, strict=True)],
            axis=-1,
        )

    def whiten_means(self, column: int, means: Array) -> Array:
        """As of ``WhitenedData``, recording by recording; zero where a recording does not have the channel."""
        found = np.zeros_like(means)
        for member, own in zip(self.each, self.stretches, strict=True):
            if column in member.columns:
                found[..., own] = member.whiten_means(column, means[..., own])
        return found

    @property
    def calibration(self) -> dict[int, ChannelTangent]:
        """As of ``WhitenedData``, recording by recording."""
        each = [
            of_readings(member.base, self.pipeline, (*member.given, *member.in_place), member.means)
            for member in self.each
        ]
        return {
            column: ChannelTangent(
                own.numbers, np.nan_to_num(np.concatenate([one[column].values.T for one in each], axis=1)).T
            )
            for column, own in each[0].items()
        }

    def recalibrated(self, step: Array) -> Array:
        """As of ``WhitenedData``, recording by recording."""
        parts = [along(each.base, self.pipeline, (*each.given, *each.in_place), step) for each in self.each]
        return np.nan_to_num(np.concatenate(parts))

    @property
    def decorrelation(self) -> Array | None:
        """Of the first recording whose channels share noise: how each one's are is its own."""
        return next((each.decorrelation for each in self.parts if each.decorrelation is not None), None)

    def beside_each_other(self, white: Array, first: int = 0) -> Array:
        """As of ``WhitenedData``, recording by recording."""
        for member, rows in zip(self.each, self.stretches, strict=True):
            here = [index for index in range(white.shape[-2]) if self.columns[first + index] in member.columns]
            if here:
                own = slice(here[0], here[-1] + 1)
                begin = member.columns.index(self.columns[first + here[0]])
                white[..., own, rows] = member.beside_each_other(white[..., own, rows].copy(), begin)
        return white

    @cached_property
    def tangents(self) -> list[ChannelTangent]:
        """As of ``WhitenedData``; a calibration from before says of the parameters what its covariance says."""
        found = super().tangents
        for member, own in zip(self.each, self.stretches, strict=True):
            if isinstance(member, Anchor):
                every = list(range(size(found)))
                for index, column in enumerate(self.columns):
                    values = np.zeros((len(every), self.count)).T
                    values[:, found[index].numbers] = found[index].values
                    values[own] = member.of_channel(column)
                    found[index] = ChannelTangent(every, values)
        return found

    def change(self, effects: Sequence[Effect]) -> Array:
        """As of ``WhitenedData``."""
        parts = [member.change(acting(effects, number)) for number, member in enumerate(self.each)]
        return np.nan_to_num(np.concatenate(parts))

    def changes(
        self, effects: Sequence[Effect], index: int, moved: Sequence[Effect], channels: NDArray[np.bool_]
    ) -> Iterator[Array]:
        """As of ``WhitenedData``."""
        parts: list[Iterator[Array]] = []
        for number, member in enumerate(self.each):
            rest = acting(effects, number)
            place = next((place for place, effect in enumerate(rest) if effect is effects[index]), None)
            parts.append(repeat(member.change(rest)) if place is None else member.changes(rest, place, moved, channels))
        for _ in moved:
            yield np.nan_to_num(np.concatenate([next(part) for part in parts]))

    def around(self, pipeline: Pipeline, in_place: Sequence[Effect] = ()) -> Stack:
        """As of ``WhitenedData``."""
        members = [
            member.around(pipeline.restricted(member.pipeline.sensors), acting(in_place, number))
            for number, member in enumerate(self.each)
        ]
        found = Stack.of(members, self.names, pipeline, self.began, self.steps)
        return replace(found, moved=True, in_place=tuple(in_place))

    def having(self, effects: Sequence[Effect]) -> Stack:
        """As of ``WhitenedData``."""
        return self._made([member.having(acting(effects, number)) for number, member in enumerate(self.each)])

    def without(self, left_out: NDArray[np.bool_]) -> Stack:
        """As of ``WhitenedData``."""
        return self._made([member.without(left_out[rows]) for member, rows in zip(self.each, self.single, strict=True)])

    def averaged(self, block: int) -> Stack:
        """As of ``WhitenedData``."""
        return self._made([member.averaged(block) for member in self.each])

    def coarse(self) -> WhitenedData:
        """As of ``WhitenedData``, each recording over as many samples as it turns little in."""
        found = [member.coarse() for member in self.each]
        return self if all(one is other for one, other in zip(found, self.each, strict=True)) else self._made(found)

    def pointwise(self, points: int = 1) -> Stack:
        """As of ``WhitenedData``."""
        return self._made([member.pointwise(points) for member in self.each])

    def stepped(self, steps: Sequence[Step]) -> Stack:
        """As of ``WhitenedData``."""
        members = [
            member.stepped([step for step in steps if step.part == number]) for number, member in enumerate(self.each)
        ]
        return Stack.of(members, self.names, self.pipeline, self.began, (*self.steps, *steps))

    def _made(self, members: Sequence[WhitenedData]) -> Stack:
        return Stack.of(members, self.names, self.pipeline, self.began, self.steps)


def acting(effects: Sequence[Effect], number: int) -> list[Effect]:
    """Those that act in a recording."""
    return [effect for effect in effects if part_of(effect) in (None, number)]


def running_on(signals: Sequence[Signals]) -> list[Signals]:
    """With clocks that run on from one recording to the next; where they do already, as they are."""
    found: list[Signals] = []
    end = -np.inf
    for each in signals:
        pause = float(np.median(np.diff(each.t))) if len(each) > 1 else 1.0
        shift = 0.0 if each.t[0] > end else end + pause - float(each.t[0])
        found.append(replace(each, t=each.t + shift, known_nodes=None))
        end = float(found[-1].t[-1])
    return found


def _slices(lengths: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum(lengths).tolist()
    return tuple(slice(end - length, end) for end, length in zip(ends, lengths, strict=True))
