"""How far the gap closes with the causes of the leading explanation, and what could still be hidden.

The gap that is left is drawn from the posterior over all explanations: parameters, other sets of causes, and
discrepancies. The gap that the causes took is measured on blocks of the recording that did not fit their strengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from estimators.gap.bench import Bench, project
from estimators.gap.diagnosis import Closed
from estimators.gap.discrepancy import Discrepancies, Weighed
from estimators.gap.evidence import Linear
from estimators.gap.prior import OTHER, OTHER_NOISE

Array = NDArray[np.float64]

#: Draws from the posterior. Folds and blocks of held-out data; the share of each block's ends that is guard.
_DRAWS: Final = 400
_FOLDS, _BLOCKS, _GUARD = 4, 64, 0.08
#: The chance to escape that counts for what could be hidden, the draws that tell it, and the terms that are asked.
_ESCAPES: Final = 0.05
_TRIALS: Final = 64


@dataclass(frozen=True)
class Way:
    """One hypothesis, as far as its gap is concerned; all on one bench of means.

    Attributes:
        probability: of it.
        change: (m,) whitened change of its causes, the calibration projected out.
        linear: it, linearised. terms: of its discrepancy; empty without one.
    """

    probability: float
    change: Array
    linear: Linear
    terms: Sequence[Weighed]


def drawn(ways: Sequence[Way], fitted: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Squared gap that is left and that was there, in whitened units: (d,) each.

    Args:
        ways: the likeliest hypotheses. fitted: (m,) change of the causes that are reported.
    """
    weights = np.array([way.probability for way in ways])
    counts = rng.multinomial(_DRAWS, weights / weights.sum())
    after, before = [], []
    for way, count in zip(ways, counts, strict=True):
        if not count:
            continue
        off = way.change - fitted
        linear = way.linear
        precision = linear.precision(linear.averaged[1])
        mean, covariance = linear.posterior(precision)
        values, vectors = np.linalg.eigh(covariance) if len(mean) else (np.zeros(0), np.zeros((0, 0)))
        deltas = mean + rng.standard_normal((count, len(mean))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
        gram = linear.gram
        left = (
            float(off @ off) + 2.0 * deltas @ (linear.tangent.T @ off) + np.einsum("di,ij,dj->d", deltas, gram, deltas)
        )
        with_fit = (
            float(way.change @ way.change)
            + 2.0 * deltas @ (linear.tangent.T @ way.change)
            + np.einsum("di,ij,dj->d", deltas, gram, deltas)
        )
        if way.terms:
            masses = np.array([term.log_mass for term in way.terms])
            chosen = rng.choice(len(masses), count, p=np.exp(masses - np.logaddexp.reduce(masses)))
            columns = np.column_stack([linear.left, linear.tangent, off, way.change])
            for index in np.unique(chosen):
                own = chosen == index
                term = way.terms[index].term
                along = term.along(columns)
                variance = float(term.variances[int(np.argmax(way.terms[index].gains))])
                spread = variance / (1.0 + variance * term.values)
                residual = along[:, :1].T - deltas[own] @ along[:, 1 : 1 + len(mean)].T
                size = spread * residual + np.sqrt(spread) * rng.standard_normal(residual.shape)
                energy = (size**2) @ term.values + 2.0 * np.einsum(
                    "dr,dr->d", size, deltas[own] @ along[:, 1 : 1 + len(mean)].T
                )
                left[own] += energy + 2.0 * size @ along[:, -2]
                with_fit[own] += energy + 2.0 * size @ along[:, -1]
        after.append(np.maximum(left, 0.0))
        before.append(np.maximum(with_fit, 1e-12))
    return np.concatenate(after), np.concatenate(before)


def held_out(linear: Linear, change: Array, bench: Bench) -> float:
    """Squared gap that causes take on blocks that did not fit their strengths: sum of 2 r m - m m.

    Args:
        linear: the causes where they were fitted. change: (m,) theirs, whitened, the calibration projected out.
    """
    count, channels = bench.count, len(bench.columns)
    block = np.arange(count) * _BLOCKS // count
    within = np.arange(count) * _BLOCKS / count - block
    guard = (within < _GUARD) | (within > 1.0 - _GUARD)
    residual, total, used = linear.left + change, 0.0, 0
    for fold in range(_FOLDS):
        train = np.tile((block % _FOLDS != fold) & ~guard, channels)
        test = np.tile((block % _FOLDS == fold) & ~guard, channels)
        gram = linear.tangent[train].T @ linear.tangent[train]
        size = 1e-6 * np.trace(gram) / max(len(gram), 1)
        move = np.linalg.solve(gram + size * np.eye(len(gram)), linear.tangent[train].T @ linear.left[train])
        fitted = change[test] + linear.tangent[test] @ move
        total += float(2.0 * residual[test] @ fitted - fitted @ fitted)
        used += int(test.sum())
    return max(total * bench.size / max(used, 1), 0.0)


def share(after: Array, before: Array) -> Closed:
    """One less the ratio of draws of squared gaps, with its 95 % interval."""
    closed = 1.0 - after / np.maximum(before, 1e-12)
    low, value, high = np.percentile(closed, [2.5, 50.0, 97.5])
    return Closed(float(max(value, -1.0)), float(max(low, -1.0)), float(max(high, -1.0)))


def could_hide(discrepancies: Discrepancies, rng: np.random.Generator) -> float:
    """The largest signal-to-noise at which an error source along a course escapes with a chance above 5 %.

    It escapes where its own Bayes factor, averaged over its amplitudes, leaves "nothing else" the likelier.
    """
    largest = 0.0
    odds = float(np.log(OTHER * (1.0 - OTHER_NOISE) / (1.0 - OTHER)))
    draws = rng.standard_normal((_TRIALS, max(len(term.values) for term in discrepancies.terms)))
    for term in discrepancies.terms:
        squares = draws[:, : len(term.values)] ** 2
        ratio = np.outer(term.variances, term.values)
        for index in range(len(term.variances) - 1, -1, -1):
            snr = float(np.sqrt(term.variances[index] * term.values.sum()))
            if snr <= largest:
                break
            power = squares * (1.0 + ratio[index])  # of products with unit eigenvectors, under this amplitude
            logs = 0.5 * power @ (ratio / (1.0 + ratio)).T - 0.5 * np.log1p(ratio).sum(axis=1)
            gains = np.logaddexp.reduce(logs, axis=1) - np.log(len(ratio)) + term.log_prior + odds
            if np.mean(gains < 0.0) > _ESCAPES:
                largest = snr
                break
    return largest


def of_noise(value: float, spread: float, rng: np.random.Generator) -> Array:
    """(d,) share of a variance that stays wrong when it is known to a standard deviation."""
    return np.abs(rng.standard_normal(_DRAWS)) * spread / max(value, 1e-300)


def elsewhere(bench: Bench, change: Array) -> float | None:
    """The share of the gap of another maneuver that the causes' change (n, 6) closes there; None without a gap."""
    fitted = project(bench.absorbed, bench.whiten(change))
    gain = float(2.0 * bench.whitened @ fitted - fitted @ fitted)
    floor = bench.size - bench.absorbed.shape[1]
    noise = float(np.sqrt(2.0 * floor)) * float(ndtri(0.975))
    gap = float(bench.whitened @ bench.whitened) - floor
    gap = max(gap, gain) if gap > noise else gain
    return float(np.clip(gain / gap, -1.0, 1.0)) if gap > 1.0 else None
