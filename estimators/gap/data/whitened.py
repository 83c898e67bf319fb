"""A recording in whitened coordinates: base fit, whitened residuals, and what the calibration absorbs.

Everything the diagnosis asks of the data is asked in whitened coordinates, channel after channel in one long vector,
with the tangent space of the calibration projected out: r -> M r, columns Z -> M Z.

A long recording is put on the data as means over blocks of samples; the rig is still evaluated at every sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from estimators.gap.data import tangent
from estimators.gap.data.blocks import bent, block_means, block_poses, neighbours, points_within
from estimators.gap.data.modelled import ModelledRig, known
from estimators.gap.data.projection import Basis, Columns, project
from estimators.gap.data.steps import Gaps, Step, after_steps
from estimators.gap.data.tangent import ChannelTangent
from estimators.gap.floor.channel_noise import ChannelNoise, Whitener
from estimators.gap.floor.shared import decorrelation
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import Effect, Stage
from rig.pipeline import Pipeline


@dataclass(frozen=True)
class WhitenedData(ModelledRig):
    """A recording of n samples beside its base fit, as ``count`` block means.

    Attributes:
        readings: (n, 6) [recorded unit]; channels that are not there are NaN.
        noises: the floor of each channel, of block means.
        weights: (count, 6) factor of each whitened mean: zero where it is left out, less than one where it is noisier.
        floor: what was learned of each channel's single readings at rest.
        kept: (n, 6) the readings that count; None: all of them.
        block: samples a mean.
        samples: how many of the recorded samples a mean is of; as ``block``, but on pointwise data.
        steps: what selected noise adds to the whitening, in this order.
        moved: whether these are around another calibration than that of the recording by itself.
    """

    readings: Array
    noises: tuple[ChannelNoise, ...]
    weights: Array
    floor: tuple[ChannelNoise, ...]
    kept: NDArray[np.bool_] | None = None
    block: int = 1
    samples: int = 1
    steps: tuple[Step, ...] = ()
    moved: bool = False

    @property
    def parts(self) -> tuple[WhitenedData, ...]:
        """The recordings, each on its own: this one; of several see ``estimators.gap.data.stack``."""
        return (self,)

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Where each of the parts is among the means of a channel."""
        return (slice(0, self.count),)

    @property
    def single(self) -> tuple[slice, ...]:
        """Where each of the parts is among the samples."""
        return (slice(0, len(self.base)),)

    def rows(self, number: int) -> NDArray[np.intp]:
        """Where one of the parts is in the whole vector, in the order of its own channels."""
        here = [index for index, column in enumerate(self.columns) if column in self.parts[number].columns]
        return np.concatenate([index * self.count + np.arange(self.count)[self.stretches[number]] for index in here])

    def lacking(self, effect: type[Effect]) -> str:
        """What some recording lacks for an effect, in words; empty where all have all."""
        return next(filter(None, (effect.lacking(part.base) for part in self.parts)), "")

    def around(self, pipeline: Pipeline, in_place: Sequence[Effect] = ()) -> WhitenedData:
        """The data with another calibration, which was fitted beside mean effects."""
        base = pipeline.expected(self.base, np.random.default_rng(0), first=Stage.FIELD)  # the poses are what they were
        return replace(self, pipeline=pipeline, base=base, moved=True, in_place=tuple(in_place))

    def like(self, other: WhitenedData) -> WhitenedData:
        """The data with the calibration of other data."""
        return self.around(other.pipeline, other.in_place)

    @property
    def floor_samples(self) -> Array:
        """(6,) how many of the means, of normal noise, tell as much of the noise as the floor was learned from."""
        judged = self.count * self.samples
        return np.array([channel.samples_at(self.interval_s) * channel.told(judged) for channel in self.floor])

    @property
    def columns(self) -> list[int]:
        """The channels that are there."""
        return self.pipeline.columns

    @property
    def count(self) -> int:
        """Block means a channel."""
        return len(self.weights)

    @property
    def size(self) -> int:
        """c count, the number of whitened means."""
        return len(self.columns) * self.count

    @cached_property
    def t(self) -> Array:
        """(count,) [s] of the means."""
        return block_means(self.base.t, self.block)

    @cached_property
    def interval_s(self) -> float:
        """Between means [s]."""
        return float(np.median(np.diff(self.t)))

    @cached_property
    def residual(self) -> Array:
        """(n, 6) [recorded unit] reading minus base fit."""
        return self.readings - self.modelled

    @cached_property
    def whiteners(self) -> tuple[Whitener, ...]:
        """One for each channel."""
        return tuple(noise.whitener(self.interval_s) for noise in self.noises)

    @property
    def only_scaled(self) -> bool:
        """Whether whitening scales each mean by itself, so that a product is whitened as its factors are."""
        whiteners = [each for part in self.parts for each in part.whiteners]
        return all(each.white for each in whiteners) and all(step.scales for step in self.steps)

    @cached_property
    def decorrelation(self) -> Array | None:
        """(c, c) lower triangular: of each channel what those before it do not tell of its noise, or (count, c, c) of
        each cosine coefficient; None where the channels share none at rest."""
        return decorrelation(self.floor, tuple(self.columns), self.noises, self.interval_s, self.count)

    def whiten_means(self, column: int, means: Array) -> Array:
        """One channel's means (..., count) over the blocks of samples by the floor's own filter: (..., count).

        It begins at the first that is there, which nothing before it tells of.
        """
        whitener, gaps = self.whiteners[column], self.gaps[column]
        if whitener.white:
            return np.asarray(means * self._scales[column])
        if not gaps.at.size:
            return whitener(means) * self._scales[column]
        white = np.zeros(means.shape)
        white[..., gaps.first :] = whitener(gaps.bridged(means)[..., gaps.first :])
        return white * self._scales[column]

    @cached_property
    def _scales(self) -> dict[int, Array]:
        """(count,) of each channel: its weights, over its noise where that is white."""
        sigmas = {
            column: self.whiteners[column].sigma if self.whiteners[column].white else 1.0 for column in self.columns
        }
        return {column: np.ascontiguousarray(self.weights[:, column]) / sigma for column, sigma in sigmas.items()}

    def beside_each_other(self, white: Array, first: int = 0) -> Array:
        """Channels (..., k, count), each whitened by its floor's filter, as the others and further steps leave them.

        Args:
            first: the number of the first of them among the channels that are there. Where channels share noise, the
                last of them is the last that is there.
        """
        if (shared := self.decorrelation) is not None:
            white = self._apart(shared[..., first:, first:], white, first)
        for index, column in enumerate(self.columns[first : first + white.shape[-2]]):
            if steps := [step for step in self.steps if step.column == column]:
                white[..., index, :] = after_steps(steps, white[..., index, :], self.gaps[column])
        return white

    def _apart(self, shared: Array, white: Array, first: int) -> Array:
        """Channels (..., k, count) less what those before each tell of its noise."""
        if shared.ndim == 2:
            return np.asarray(np.einsum("ij,...jn->...in", shared, white))
        gaps = [self.gaps[column] for column in self.columns[first:]]
        filled = np.stack([own.filled(white[..., index, :]) for index, own in enumerate(gaps)], axis=-2)
        apart = idct(np.einsum("nij,...jn->...in", shared, dct(filled, norm="ortho")), norm="ortho")
        return np.stack([own.emptied(apart[..., index, :]) for index, own in enumerate(gaps)], axis=-2)

    @cached_property
    def gaps(self) -> tuple[Gaps, ...]:
        """Where the readings of each channel are left out."""
        return tuple(Gaps.of(weights) for weights in self.weights.T)

    def means(self, column: int, values: Array) -> Array:
        """One channel's values (..., n) as means over the blocks of samples, (..., count)."""
        if self.block == 1:
            return np.ascontiguousarray(values)
        return block_means(values, self.block, None if self.kept is None else self.kept[:, column])

    def whiten(self, volts: Array) -> Array:
        """Readings (n, 6) or (n, 6, m) in whitened coordinates: (c count,) or (c count, m), c of the channels."""
        own = [self.whiten_means(column, self.means(column, volts[:, column].T)) for column in self.columns]
        white = self.beside_each_other(np.stack(own, axis=-2))
        return white.reshape(*white.shape[:-2], -1).T

    def whiten_changes(self, changes: Iterable[Array]) -> Columns:
        """Changes (n, 6) of the readings, one a column; from the first channel that they touch to the last.

        Of each change its means alone are kept: of many samples, they may be made one at a time.
        """
        found = []
        for change in changes:
            found.append(np.zeros((len(self.columns), self.count)))
            for own, column in zip(found[-1], self.columns, strict=True):
                if change[:, column].any():
                    own[:] = self.means(column, change[:, column])
        means = np.array(found).reshape(len(found), len(self.columns), -1)
        touched = np.flatnonzero(means.any(axis=(0, 2)))
        if not touched.size:
            return Columns(np.zeros((0, len(found))), 0)
        low, high = int(touched[0]), int(touched[-1]) + 1
        high = high if self.decorrelation is None else len(self.columns)
        white = np.zeros((len(found), high - low, self.count))
        for index in touched:
            white[:, index - low] = self.whiten_means(self.columns[index], means[:, index])
        white = self.beside_each_other(white, low)
        return Columns(white.reshape(len(found), -1).T, low * self.count)

    def channel(self, white: Array, column: int) -> Array:
        """The part of a whitened vector that belongs to a channel."""
        first = self.columns.index(column) * self.count
        return white[first : first + self.count]

    @property
    def calibration(self) -> dict[int, ChannelTangent]:
        """What the calibration's parameters do to the means of each channel, with the effects that are in place: a
        slipped sensor has turned its gains along, a slow one follows them."""
        return tangent.of_readings(self.base, self.pipeline, (*self.given, *self.in_place), self.means)

    @cached_property
    def tangents(self) -> list[ChannelTangent]:
        """What the calibration's parameters do to the whitened readings of each channel."""
        own = self.calibration
        white = [self.whiten_means(each, own[each].values.T)[:, None] for each in self.columns]
        if self.decorrelation is None:
            white = [self.beside_each_other(values, index) for index, values in enumerate(white)]
            parts = zip(self.columns, white, strict=True)
            return [ChannelTangent(own[column].numbers, values[:, 0].T) for column, values in parts]
        every = list(range(tangent.size(list(own.values()))))
        both = np.zeros((len(every), len(self.columns), self.count))
        for index, column in enumerate(self.columns):
            both[own[column].numbers, index] = white[index][:, 0]
        both = self.beside_each_other(both)
        return [ChannelTangent(every, both[:, index].T) for index in range(len(self.columns))]

    @property
    def tangent(self) -> Array:
        """(c count, p): what the calibration's parameters do to the whitened readings."""
        return tangent.dense(self.tangents)

    def left_over(self, change: Array) -> Array:
        """(n, 6) [recorded unit] what the calibration cannot absorb of a change (n, 6)."""
        absorbed, *_ = np.linalg.lstsq(self.tangent, self.whiten(change), rcond=1e-9)
        return np.asarray(change - self.recalibrated(np.asarray(absorbed, dtype=float)))

    @cached_property
    def absorbed(self) -> Basis:
        """(c count, rank) orthonormal basis of the tangent."""
        return tangent.basis(self.tangents)

    @cached_property
    def whitened(self) -> Array:
        """(c count,) the whitened residual with the tangent projected out."""
        return project(self.absorbed, self.whiten(self.residual))

    def having(self, effects: Sequence[Effect]) -> WhitenedData:
        """The data whose model has some mean effects: what others change is asked for beside these."""
        return replace(self, given=(*self.given, *effects))

    def without(self, left_out: NDArray[np.bool_]) -> WhitenedData:
        """The data, of single samples, with some readings (n, 6) left out."""
        kept = ~left_out if self.kept is None else self.kept & ~left_out
        return replace(self, kept=kept, weights=np.where(left_out, 0.0, self.weights))

    def averaged(self, block: int) -> WhitenedData:
        """The data, of single samples, as one of means over blocks of so many."""
        if block == 1:
            return self
        kept = np.ones_like(self.readings) if self.kept is None else self.kept.astype(float)
        share = block_means(kept.T, block).T
        raised = block_means((kept * self.weights).T, block).T / np.maximum(share, 1e-12)
        noises = tuple(noise.averaged(block, self.interval_s) for noise in self.noises)
        samples = self.samples * block
        steps = tuple(step.shortened(len(share)) for step in self.steps)
        return replace(self, noises=noises, weights=raised * np.sqrt(share), block=block, samples=samples, steps=steps)

    def coarse(self) -> WhitenedData:
        """Means over as many neighbouring samples as turn little, each with the rig evaluated once."""
        return self.averaged(neighbours(self.base)).pointwise()

    def stepped(self, steps: Sequence[Step]) -> WhitenedData:
        """The data with further steps of whitening."""
        return replace(self, steps=(*self.steps, *steps))

    def after(self, steps: Sequence[Step], columns: Columns) -> Columns:
        """Whitened columns of these data as further steps make them."""
        values = columns.values
        for step in steps:
            every = self._stepped_by(step)
            own = slice(every.start - columns.first, every.stop - columns.first)
            if 0 <= own.start < len(values) and values[own].any():
                values = values if values is not columns.values else values.copy(order="F")
                values[own] = after_steps([step], values[own].T, self.parts[step.part].gaps[step.column]).T
        return Columns(values, columns.first)

    def before(self, steps: Sequence[Step], white: Array) -> Array:
        """(c n,) whitened readings of these data as they were before the last of their steps."""
        found = white.copy()
        for step in reversed(steps):
            own = self._stepped_by(step)
            found[own] = replace(step, factor=1.0 / np.maximum(step.factor, 1e-9))(found[own])
        return found

    def _stepped_by(self, step: Step) -> slice:
        """Where in the whole vector the means are that a step is of."""
        part, first = self.stretches[step.part], self.columns.index(step.column) * self.count
        return slice(first + part.start, first + part.stop)

    def pointwise(self, points: int = 1) -> WhitenedData:
        """The data with the rig evaluated once a block, at its mean pose: quick, and to first order the same.

        Args:
            points: samples of each block at which effects are evaluated that jump or vary within one; where the arm
                turns far in a block, all effects are at all of its samples.
        """
        if self.block == 1:
            return self
        rng = np.random.default_rng(0)
        base = self.pipeline.expected(block_poses(self.base, self.block), rng)
        several = points > 1 and base.q_encoder is not None
        turning = several and bent(self.base, self.block)
        within = points_within(self.base, self.block, self.block if turning else points) if several else None
        means = np.stack([self.means(column, self.residual[:, column]) for column in range(len(CHANNELS))], axis=1)
        found = replace(
            self, base=known(base), readings=base.volts + means, kept=None, block=1, within=within, bent=turning
        )
        return replace(found, readings=found.modelled + means) if self.given else found
