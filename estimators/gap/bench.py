"""The recording on the bench: base fit, whitened residuals, and what the calibration absorbs.

Everything the diagnosis asks of the data is asked in whitened coordinates, channel after channel in one long vector,
with the tangent space of the calibration projected out: r -> M r, columns Z -> M Z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.linalg import qr

from estimators.gap.colour import Whitener
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF
from rig.directions import tangent_basis
from rig.effects import Effect
from rig.pipeline import Pipeline
from rig.signals import Signals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bench:
    """A recording beside its base fit.

    Attributes:
        base: the recording's angles or poses after all stages of the fitted pipeline, without effects.
        pipeline: the fitted pipeline, without effects.
        readings: (n, 6) [recorded unit]; channels that are not there are NaN.
        whiteners: one for each channel.
        weights: (n, 6) factor of each whitened reading: zero where it is left out, less than one where it is noisier.
        floor_samples: (6,) how many of the recording's samples tell as much of the noise as the floor was learned from.
        gains: for each channel None, or (n,) further gains at the frequencies of a cosine transform (DCT-II).
    """

    base: Signals
    pipeline: Pipeline
    readings: Array
    whiteners: tuple[Whitener, ...]
    weights: Array
    floor_samples: Array
    gains: tuple[Array | None, ...] = (None,) * len(CHANNELS)

    @property
    def columns(self) -> list[int]:
        """The channels that are there."""
        return self.pipeline.columns

    @property
    def size(self) -> int:
        """c n, the number of whitened readings."""
        return len(self.columns) * len(self.base)

    @property
    def interval_s(self) -> float:
        """Between samples [s]."""
        return float(np.median(np.diff(self.base.t)))

    @cached_property
    def residual(self) -> Array:
        """(n, 6) [recorded unit] reading minus base fit."""
        return self.readings - self.base.volts

    def whiten_channel(self, column: int, values: Array) -> Array:
        """One channel's values (n,) or (n, m) in whitened coordinates."""
        if (bridge := self._bridges[column]) is not None:  # the filter must not carry on what is left out
            gap, before, after, share = bridge
            values = values.copy()
            share = share[:, None] if values.ndim == 2 else share
            values[gap] = (1.0 - share) * values[before] + share * values[after]
        white = self.whiteners[column](values)
        gain = self.gains[column]
        weight = self.weights[:, column]
        if values.ndim == 2:
            weight = weight[:, None]
            gain = None if gain is None else gain[:, None]
        if gain is not None:
            white = idct(dct(white, axis=0, norm="ortho") * gain, axis=0, norm="ortho")
        return np.asarray(white * weight)

    def whiten(self, volts: Array) -> Array:
        """Readings (n, 6) or (n, 6, m) in whitened coordinates: (c n,) or (c n, m), c the channels that are there."""
        return np.concatenate([self.whiten_channel(column, volts[:, column]) for column in self.columns])

    @cached_property
    def _bridges(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], Array] | None]:
        """Of each coloured channel with readings left out: these, their neighbours, and the way between."""
        found: list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], Array] | None] = []
        for whitener, weights in zip(self.whiteners, self.weights.T, strict=True):
            gap, kept = np.flatnonzero(weights == 0.0), np.flatnonzero(weights > 0.0)
            if whitener.phi == 0.0 or not gap.size or not kept.size:
                found.append(None)
                continue
            right = np.searchsorted(kept, gap)
            before, after = kept[np.maximum(right - 1, 0)], kept[np.minimum(right, len(kept) - 1)]
            share = np.clip((gap - before) / np.maximum(after - before, 1), 0.0, 1.0)
            found.append((gap, before, after, share))
        return found

    def channel(self, white: Array, column: int) -> Array:
        """The part of a whitened vector that belongs to a channel."""
        count = len(self.base)
        first = self.columns.index(column) * count
        return white[first : first + count]

    @cached_property
    def raw_tangent(self) -> Array:
        """(n, 6, p) [recorded unit]: what the calibration's parameters do to the readings.

        For each sensor: sensitivity, offset and two tangent coordinates of the axis for each channel, and two tangent
        coordinates of the field that its channels share.
        """
        blocks = []
        for name, sensor in self.pipeline.sensors.items():
            environment = self.pipeline.environment
            field = environment.gravity if name == ACCELEROMETER else environment.magnetic
            in_tool = np.matmul(field, self.base.R_base_tool)  # (n, 3)
            turned = np.einsum("ai,nij->naj", tangent_basis(field / np.linalg.norm(field)), self.base.R_base_tool)
            columns = range(*COLUMNS_OF[name].indices(len(CHANNELS)))
            shared = np.zeros((len(self.base), len(CHANNELS), 2))
            for column, axis, sensitivity in zip(columns, sensor.axes, sensor.sensitivity, strict=True):
                own = np.zeros((len(self.base), len(CHANNELS), 4))
                own[:, column, 0] = in_tool @ axis
                own[:, column, 1] = 1.0
                own[:, column, 2:] = sensitivity * in_tool @ tangent_basis(axis).T
                shared[:, column] = sensitivity * np.linalg.norm(field) * turned @ axis
                blocks.append(own)
            blocks.append(shared)
        return np.concatenate(blocks, axis=2)

    @cached_property
    def tangent(self) -> Array:
        """(c n, p): what the calibration's parameters do to the whitened readings."""
        return self.whiten(self.raw_tangent)

    def left_over(self, change: Array) -> Array:
        """(n, 6) [recorded unit] what the calibration cannot absorb of a change (n, 6)."""
        absorbed, *_ = np.linalg.lstsq(self.tangent, self.whiten(change), rcond=1e-9)
        return change - self.raw_tangent @ absorbed

    @cached_property
    def absorbed(self) -> Array:
        """(c n, rank) orthonormal basis of the tangent."""
        return orthonormal(self.tangent)

    @cached_property
    def whitened(self) -> Array:
        """(c n,) the whitened residual with the tangent projected out."""
        return project(self.absorbed, self.whiten(self.residual))

    def change(self, effects: Sequence[Effect]) -> Array:
        """(n, 6) [recorded unit] what mean effects change, with the calibration held."""
        if not effects:
            return np.zeros_like(self.base.volts)
        rng = np.random.default_rng(0)  # mean effects draw nothing
        first = min(effect.stage for effect in effects)
        return replace(self.pipeline, effects=tuple(effects)).expected(self.base, rng, first).volts - self.base.volts

    def replayed(self, effects: Sequence[Effect]) -> Array:
        """(n, 6) [recorded unit] as ``change``, with every pose computed anew by MuJoCo."""
        if self.base.q_encoder is None or not effects:
            return self.change(effects)
        start = replace(self.base, position=np.empty((0, 0)))
        simulator = replace(self.pipeline, effects=tuple(effects))
        return simulator.expected(start, np.random.default_rng(0)).volts - self.base.volts

    def without(self, left_out: NDArray[np.bool_]) -> Bench:
        """The bench with some readings (n, 6) left out."""
        return replace(self, weights=np.where(left_out, 0.0, self.weights))


def orthonormal(columns: Array, tolerance: float = 1e-7) -> Array:
    """An orthonormal basis (rows, rank) of columns (rows, m), scaled alike before their rank is judged."""
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > 0] / length[length > 0]
    if columns.shape[1] == 0:
        return columns
    q, r, _ = qr(columns, mode="economic", pivoting=True, check_finite=False)
    rank = int(np.sum(np.abs(np.diag(r)) > tolerance))
    return np.ascontiguousarray(q[:, :rank])


def project(basis: Array, values: Array) -> Array:
    """Values (rows,) or (rows, m) with an orthonormal basis (rows, rank) projected out."""
    return values - basis @ (basis.T @ values)
