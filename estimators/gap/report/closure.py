"""How far the gap closes with the causes of the leading explanation, and what could still be hidden.

The gap that is left is drawn from the posterior over all explanations: parameters, other sets of causes, and
discrepancies. The gap that the causes took is measured on blocks of the recording that did not fit their strengths.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import ESTABLISHED, Closed
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.prior import OTHER, OTHER_NOISE
from rig.arrays import Array

#: Twice the log odds at which causes are not there, those at which one is established.
_ABSENT: Final = 2.0 * float(np.log(ESTABLISHED / (1.0 - ESTABLISHED)))
#: Draws from the posterior. Folds and blocks of held-out data; the share of each block's ends that is guard.
_DRAWS: Final = 4000
_FOLDS, _BLOCKS, _GUARD = 4, 64, 0.08
#: The chance to escape that counts for what could be hidden, the draws that tell it, and the terms that are asked.
_ESCAPES: Final = 0.05
_TRIALS: Final = 64
_ANY_SIZE: Final = 1e6  # signal-to-noise: what escapes then does so at any


@dataclass(frozen=True)
class Way:
    """One hypothesis, as far as its gap is concerned; under the floor as it was learned.

    Attributes:
        probability: of it.
        change: (m,) whitened change of its causes, the calibration projected out.
        linear: it, linearised. moments: of its parameters, as of ``estimators.gap.search.posterior.Hypothesis``.
        nameless: squares that noise without a name adds.
        terms: of its discrepancy; empty without one.
        apart: for each shape that the fit keeps, what its change would be at equally likely values, less what it is:
            (k, m) each.
    """

    probability: float
    change: Array
    linear: Linear
    moments: tuple[Array, Array]
    nameless: float = 0.0
    terms: Sequence[Weighed] = ()
    apart: Sequence[Array] = ()


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
        deltas = of_parameters(way.moments, rng, count)
        every = [deltas, *(np.eye(len(each))[rng.integers(len(each), size=count)] for each in way.apart)]
        whole = replace(way.linear, tangent=np.column_stack([way.linear.tangent, *(each.T for each in way.apart)]))
        left = moved(whole, way.change - fitted, np.hstack(every)) + way.nameless
        there = moved(whole, way.change, np.hstack(every)) + way.nameless
        if way.terms:
            for rows, energy, off, change in _of_terms(way, way.change - fitted, deltas, rng):
                left[rows] += energy + off
                there[rows] += energy + change
        after.append(np.maximum(left, 0.0))
        before.append(np.maximum(there, 1e-12))
    return np.concatenate(after), np.concatenate(before)


def of_parameters(moments: tuple[Array, Array], rng: np.random.Generator, count: int = _DRAWS) -> Array:
    """(count, p) draws of parameters less their fitted values.

    By the symmetric root of their correlations: that is the same whatever signs, and directions among equals, the
    eigenvectors were given.
    """
    mean, covariance = moments
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(mean + rng.standard_normal((count, len(mean))) @ root * scale)


def moved(linear: Linear, change: Array, deltas: Array) -> Array:
    """(d,) squares of a whitened change (m,) once its parameters are moved by deltas (d, p)."""
    along = linear.tangent.T @ change
    return np.asarray(change @ change + 2.0 * deltas @ along + np.einsum("di,ij,dj->d", deltas, linear.gram, deltas))


def _of_terms(
    way: Way, off: Array, deltas: Array, rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.bool_], Array, Array, Array]]:
    """Draws of a discrepancy: of which rows, their squares, and their products with two changes, twice: what is off in
    the reported causes, and the change of a hypothesis' own."""
    terms, linear, change = way.terms, way.linear, way.change
    masses = np.array([term.log_mass for term in terms])
    chosen = rng.choice(len(masses), len(deltas), p=np.exp(masses - np.logaddexp.reduce(masses)))
    side = rng.standard_normal(len(change))  # an eigenvector has no sign of its own: that in which it points here
    columns = np.column_stack([linear.left, linear.tangent, off, change, side])
    for index in np.unique(chosen):
        rows = chosen == index
        term = terms[index].term
        along = term.along(columns)
        along *= np.where(along[:, -1:] < 0.0, -1.0, 1.0)
        variance = float(term.variances[int(np.argmax(terms[index].gains))])
        spread = variance / (1.0 + variance * term.values)
        shift = deltas[rows] @ along[:, 1:-3].T
        residual = along[:, :1].T - shift
        size = spread * residual + np.sqrt(spread) * rng.standard_normal(residual.shape)
        energy = (size**2) @ term.values + 2.0 * np.einsum("dr,dr->d", size, shift)
        yield rows, energy, 2.0 * size @ along[:, -3], 2.0 * size @ along[:, -2]


def held_out(linear: Linear, change: Array, data: WhitenedData) -> float:
    """Squared gap that causes take on blocks that did not fit their strengths: sum of 2 r m - m m.

    Args:
        linear: the causes where they were fitted. change: (m,) theirs, whitened, the calibration projected out.
    """
    count, channels = data.count, len(data.columns)
    block = np.arange(count) * _BLOCKS // count
    within = np.arange(count) * _BLOCKS / count - block
    guard = (within < _GUARD) | (within > 1.0 - _GUARD)
    residual, total, used = linear.left + change, 0.0, 0
    for fold in range(_FOLDS):
        train = np.tile((block % _FOLDS != fold) & ~guard, channels)
        test = np.tile((block % _FOLDS == fold) & ~guard, channels)
        gram = linear.tangent[train].T @ linear.tangent[train]
        size = 1e-6 * np.trace(gram) / max(len(gram), 1)
        moment = linear.tangent[train].T @ linear.left[train]
        move = np.linalg.lstsq(gram + size * np.eye(len(gram)), moment)[0]  # 0 of what acts in no block that fits
        fitted = change[test] + linear.tangent[test] @ move
        total += float(2.0 * residual[test] @ fitted - fitted @ fitted)
        used += int(test.sum())
    return max(total * data.size / max(used, 1), 0.0)


def share(after: Array, before: Array) -> Closed:
    """One less the ratio of draws of squared gaps, with its 95 % interval: the shortest, as all may be closed.

    That all is closed is one of its points: between the last of n draws and it lies as much as between any two.
    """
    closed = np.append(np.sort(1.0 - after / np.maximum(before, 1e-12)), 1.0)
    held = int(np.ceil(0.95 * len(closed)))
    first = int(np.argmin(closed[held - 1 :] - closed[: len(closed) - held + 1]))
    low, value, high = closed[first], float(np.median(closed[:-1])), closed[first + held - 1]
    return Closed(float(max(value, -1.0)), float(max(low, -1.0)), float(max(high, -1.0)))


def could_hide(discrepancies: Discrepancies, rng: np.random.Generator) -> float:
    """The largest signal-to-noise at which an error source along a course escapes with a chance above 5 %.

    It escapes where its own Bayes factor, averaged over its amplitudes, leaves "nothing else" the likelier. Its form is
    drawn from its prior and its size is given: of a random size, small ones escape however large it is in the mean.
    """
    largest = 0.0
    odds = float(np.log(OTHER * (1.0 - OTHER_NOISE) / (1.0 - OTHER)))
    count = max(len(term.values) for term in discrepancies.terms)
    forms, noise = rng.standard_normal((2, _TRIALS, count))
    for term in discrepancies.terms:
        if not term.values.any():
            continue
        of = slice(len(term.values))
        form = forms[:, of] * np.sqrt(term.values)
        form /= np.linalg.norm(form, axis=1, keepdims=True)
        ratio = np.outer(term.variances, term.values)
        weight, spread = (ratio / (1.0 + ratio)).T, 0.5 * np.log1p(ratio).sum(axis=1)
        against = np.log(len(ratio)) - term.log_prior - odds

        def escapes(snr: float) -> bool:
            logs = 0.5 * (snr * form + noise[:, of]) ** 2 @ weight - spread  # noqa: B023
            return bool(np.mean(np.logaddexp.reduce(logs, axis=1) < against) > _ESCAPES)  # noqa: B023

        if escapes(largest):
            low, high = largest, max(2.0 * largest, 1.0)
            while high < _ANY_SIZE and escapes(high):
                low, high = high, 2.0 * high
            while high - low > 0.05 * high:
                middle = 0.5 * (low + high)
                low, high = (middle, high) if escapes(middle) else (low, middle)
            largest = high
    return largest


def of_noise(value: float, spread: float, rng: np.random.Generator) -> Array:
    """(d,) share of a variance that stays wrong when it is known to a standard deviation."""
    return np.abs(rng.standard_normal(_DRAWS)) * spread / max(value, 1e-300)


def elsewhere(data: WhitenedData, change: Array) -> float | None:
    """The share of the gap of another maneuver that the causes' change (n, 6) closes there, -1 where they make one.

    The gain is twice the log likelihood ratio of causes that are there to none: below zero only where they are as
    surely not there as an established cause is there. None where they hardly show, and nothing is to be closed.
    """
    fitted = project(data.absorbed, data.whiten(change))
    gain = float(2.0 * data.whitened @ fitted - fitted @ fitted)
    gain = 0.0 if -_ABSENT < gain < 0.0 else gain
    floor = data.size - data.absorbed.rank
    noise = float(np.sqrt(2.0 * floor)) * float(ndtri(0.975))
    gap = float(data.whitened @ data.whitened) - floor
    gap = max(gap if gap > noise else 0.0, abs(gain))
    return gain / gap if gap > 1.0 else None
