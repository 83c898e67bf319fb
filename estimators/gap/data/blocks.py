"""Means over blocks of samples: what a long recording tells of slow effects, in as many numbers as these need."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.arrays import Array
from rig.signals import Signals, sampled

#: So many means a channel are enough for every effect that turns with the arm.
_ENOUGH: Final = 8192
#: [Hz] a mean over a whole number of their periods would hide them.
_MAINS: Final = (50.0, 60.0)
#: [rad] means over a turn of this hide little of an effect that turns with a joint: 3 % of its first harmonic.
_TURN: Final = 0.8
#: [rad] over a turn of this an effect's mean is its value in the middle: to 0.4 % of a third harmonic.
_STRAIGHT: Final = 0.1
#: Neighbours averaged at most for a first look, and the means this must leave; what fewer neighbours than so many save
#: is lost again, as sets are looked at both ways.
_MOST, _FEWEST, _WORTH = 8, 500, 4


def block_size(count: int, interval_s: float) -> int:
    """Samples a mean: one up to twice the means that are enough; then about so many as leave these.

    Of sizes within a quarter, the one that leaves most of the mains' hum.
    """
    if each_used(count):
        return 1
    largest = count // _ENOUGH
    sizes = range(max(2, (3 * largest) // 4), largest + 1)
    return max(sizes, key=lambda size: min(abs(float(np.sinc(hum * size * interval_s))) for hum in _MAINS))


def each_used(count: int) -> bool:
    """Whether a recording of so many samples is used sample by sample, not as means."""
    return count < 2 * _ENOUGH


def neighbours(base: Signals) -> int:
    """How many neighbouring samples turn by no more than ``_TURN`` together, at most ``_MOST``; one of few samples."""
    few_enough = len(base) // _FEWEST
    if few_enough < _WORTH:
        return 1
    return int(min(_MOST, few_enough, max(1.0, _TURN / max(_turned(base), 1e-9))))


def bent(base: Signals, block: int) -> bool:
    """Whether so many samples turn by more than ``_STRAIGHT`` together."""
    return _turned(base) * block > _STRAIGHT


def _turned(base: Signals) -> float:
    """[rad] by which the fastest joint, or the tool, turns from sample to sample, but for a tenth of all samples."""
    if base.q_encoder is not None:
        steps = np.abs(np.diff(np.unwrap(base.q_encoder, axis=0), axis=0)).max(axis=1)
    else:
        steps = np.linalg.norm(np.diff(base.R_base_tool, axis=0), axis=(1, 2)) / np.sqrt(2.0)
    return float(np.quantile(steps, 0.9)) if len(steps) else 0.0


def block_means(values: Array, block: int, kept: NDArray[np.bool_] | None = None) -> Array:
    """Means (..., count) of values (..., n) over blocks of samples; an incomplete last block is left out.

    Args:
        kept: (n,) which samples count; a block without any has mean zero.
    """
    count = values.shape[-1] // block
    shape = (*values.shape[:-1], count, block)
    cut = values[..., : count * block].reshape(shape)
    if kept is None:
        return np.asarray(cut.mean(axis=-1))
    mask = kept[: count * block].reshape(count, block)
    return np.asarray(np.where(mask, cut, 0.0).sum(axis=-1) / np.maximum(mask.sum(axis=-1), 1))


def points_within(base: Signals, block: int, points: int) -> Signals:
    """The signals at so many samples of each block, evenly apart."""
    count, points = len(base) // block, min(points, block)
    within = ((np.arange(points) + 0.5) * block / points).astype(np.intp)
    return replace(sampled(base, np.add.outer(np.arange(count) * block, within).ravel()), known_links=None)


def block_poses(base: Signals, block: int) -> Signals:
    """The signals at the mean joint angles of the blocks; poses, temperatures and currents as in the middle."""
    count = len(base) // block
    found = replace(sampled(base, slice(block // 2, count * block, block)), known_links=None)
    if base.q_encoder is None:
        return found
    q = block_means(np.unwrap(base.q_encoder, axis=0).T, block).T
    return replace(
        found, t=block_means(base.t, block), q_encoder=q, velocity=block_means(base.joint_velocity.T, block).T
    )
