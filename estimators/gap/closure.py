"""How far the gap closes: the causes go into the simulator, and are judged on data that did not fit them.

The recording is cut into blocks; each fold of blocks is predicted by strengths fitted on the others, with guard gaps
between. A gap is measured by the cross product 2 r m - m m of residual r and fitted change m, as a difference of
squared residual and squared floor drowns in its own noise where the gap is under a third of the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench, project
from estimators.gap.refine import Fitted, tangents
from rig.channels import CHANNELS

Array = NDArray[np.float64]

FOLDS = 4
#: Blocks, folds taking turns; of each block's ends this share is guard.
_BLOCKS, _GUARD = 64, 0.08
_RESAMPLES = 400


@dataclass(frozen=True)
class Closure:
    """Gap before and after, on held-out blocks.

    Attributes:
        before, after: (6,) [recorded unit] root mean square of the gap of each channel, as the fitted causes make it;
            NaN where the channel is not there.
        closed: share of the squared, whitened gap that is gone.
        low, high: its 95 % interval, by a bootstrap over blocks.
        by_channel: (6,) the same share for each channel.
        rms_before, rms_after: (6,) [recorded unit] of the residuals.
    """

    before: Array
    after: Array
    closed: float
    low: float
    high: float
    by_channel: Array
    rms_before: Array
    rms_after: Array


def close(bench: Bench, misfit: Array, fits: Sequence[Fitted], remainder: float, rng: np.random.Generator) -> Closure:
    """Cross-validated closure of a set of mean causes.

    Args:
        bench: base fit, around the calibration with the causes in place.
        misfit: (n, 6) [recorded unit] residual of the base fit without them.
        fits: the causes.
        remainder: whitened square of what is left that is not noise, over all readings.
        rng: of the bootstrap.
    """
    count, channels = bench.count, len(bench.columns)
    effects = [fit.effect for fit in fits]
    columns = tangents(fits, bench)
    change = bench.replayed(effects)
    target = bench.whiten(change)
    residual = bench.whiten(bench.residual)
    design = np.hstack([bench.tangent, *columns])
    scale = np.maximum(np.linalg.norm(design, axis=0), 1e-100)
    design = design / scale
    base_size = bench.tangent.shape[1]
    fold, guard = _folds(count)
    predicted, base_only, removed = np.zeros(len(residual)), np.zeros(len(residual)), np.zeros(len(residual))
    for number in range(FOLDS):
        train = np.tile((fold != number) & ~guard, channels)
        test = np.tile(fold == number, channels)
        full = _solve(design[train], residual[train] - target[train])
        only = _solve(design[train][:, :base_size], residual[train])
        predicted[test] = design[test] @ full + target[test]
        base_only[test] = design[test][:, :base_size] @ only
        removed[test] = predicted[test] - base_only[test]
    use = np.tile(~guard, channels) & (bench.weights[:, bench.columns].T.ravel() > 0)
    left = residual - base_only
    gain = np.where(use, 2.0 * left * removed - removed**2, 0.0).reshape(channels, count)
    blocks = np.array_split(np.arange(count), _BLOCKS)
    gains = np.array([gain[:, block].sum() for block in blocks])
    kept = use.reshape(channels, count)
    gap = bench.left_over(change) if effects else np.zeros_like(bench.residual)
    after_all = bench.left_over(bench.residual - change) if effects else misfit
    strengths = base_noise(design.shape[1] - base_size)
    size = float(np.sum(project(bench.absorbed, target) ** 2))
    rest = max(remainder, 0.0) + strengths
    real = max(size - strengths, 0.0) / max(size, 1e-12)  # noise in the strengths makes the fitted gap too large

    def share(chosen: NDArray[np.intp]) -> float:
        closed = float(gains[chosen].sum())
        return float(np.clip(closed / max(closed + rest, 1e-12), 0.0, 1.0))

    samples = [share(rng.integers(0, _BLOCKS, _BLOCKS)) for _ in range(_RESAMPLES)]
    before, after, by_channel = (np.full(len(CHANNELS), np.nan) for _ in range(3))
    rms_before, rms_after = np.full(len(CHANNELS), np.nan), np.full(len(CHANNELS), np.nan)
    for index, column in enumerate(bench.columns):
        sigma = bench.whiteners[column].sigma * np.sqrt(bench.samples)
        own = real * float(np.mean(gap[:, column] ** 2))
        part = own * rest / max(size, 1e-12) if size else sigma**2 * remainder / bench.size
        before[column] = np.sqrt(own + part * (remainder > 0))
        after[column] = np.sqrt(part)
        by_channel[column] = own / max(own + part, 1e-300)
        seen = kept[index]
        recorded = np.flatnonzero(np.repeat(seen, bench.block))
        rms_before[column] = np.sqrt(np.mean(misfit[recorded, column] ** 2))
        rms_after[column] = np.sqrt(np.mean(after_all[recorded, column] ** 2))
    whole = np.arange(_BLOCKS)
    low, high = np.percentile(samples, [2.5, 97.5])
    return Closure(before, after, share(whole), float(low), float(high), by_channel, rms_before, rms_after)


def base_noise(strengths: int) -> float:
    """Whitened square that estimated strengths themselves leave: one for each."""
    return float(strengths)


def _folds(count: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    block = np.arange(count) * _BLOCKS // count
    within = np.arange(count) * _BLOCKS / count - block
    return block % FOLDS, (within < _GUARD) | (within > 1.0 - _GUARD)


def _solve(design: Array, values: Array) -> Array:
    gram = design.T @ design
    return np.asarray(np.linalg.pinv(gram, rcond=1e-10, hermitian=True) @ (design.T @ values))
