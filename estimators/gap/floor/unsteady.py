"""Noise that is louder at some times than at others, at rest already: a machine nearby that runs now and then."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Final

import numpy as np
from scipy.fft import rfft
from scipy.linalg import cho_factor, cho_solve

from estimators.gap.floor.normal_scores import normal_scores
from estimators.gap.floor.two_levels import forward, smoothed
from rig.arrays import Array, Rows
from rig.effects.tails import student

#: Readings from which each next one is predicted, so that what is left remembers nothing.
_MEMORY: Final = 8
#: Variance of the logarithm of the square of a normal variable: pi^2 / 2.
_OF_A_SQUARE: Final = np.pi**2 / 2.0
#: Shares of the sizes' variance that are the level's, and correlation times as shares of a recording, that are tried.
_SHARES: Final = np.geomspace(0.01, 0.7, 8)
_TIMES: Final = 9
#: A recording at rest tells a memory as long as a quarter of itself; the level may be so many times slower, or drift
#: steadily.
_SLOWER: Final = (1.0, 4.0, 16.0, np.inf)
#: A level is followed over this many readings at least.
_SHORTEST: Final = 3.0
#: Of noise of two levels: variance of the louder over the other, share of the time, and how many lengths of a stay.
_RATIOS: Final = (2.0, 4.0, 8.0, 16.0, 32.0)
_LOUD: Final = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5)
_STAYS: Final = 8
#: Times of which two levels are told, at most.
_TIMES_OF_LEVELS: Final = 2**15
#: Frequencies that are used each by itself; beyond, those within this share of one are one.
_EACH, _WITHIN = 1024, 0.01
#: Pieces of time with a level each: so many in a correlation time, of so many readings at least, and so many in all.
_PIECES, _LONG, _FEWEST, _MOST = 3.0, 2, 48, 600
#: Steps to the likeliest level, and one that is none.
_STEPS, _NO_STEP = 50, 1e-4


@dataclass(frozen=True)
class TwoLevels:
    """A noise's variance that switches between two levels; one on average.

    Attributes:
        ratio: of the louder to the other. share: of the time that it is loud. rate_Hz: of switches.
    """

    ratio: float
    share: float
    rate_Hz: float

    def gain(self, squares: Array, many: Array, interval_s: float) -> tuple[float, Array]:
        """Gain in log likelihood over a variance of one, averaged over all instants; (n,) mean inverse variance.

        Args:
            squares: (n,) sums of squares of the noise at a time. many: (n,) of how many readings.
        """
        rate = min(self.rate_Hz * interval_s, 0.5)
        own = (np.array([each]) for each in (self.ratio, self.share, rate))
        gains, filtered, lower = _of_levels(squares, many, *own)
        loud = smoothed(filtered[:, 0], self.share, rate)
        return float(gains[0]), (loud / self.ratio + 1.0 - loud) / float(lower[0])


@dataclass(frozen=True)
class Unsteady:
    """The logarithm of a noise's variance, a first-order Gauss-Markov process in time (Taylor's stochastic volatility:
    Harvey, Ruiz and Shephard, Review of Economic Studies 61, 1994).

    Attributes:
        spread: its standard deviation. memory_s: its correlation time [s].
        unsure: standard deviation of its mean, as the recording at rest tells it.
        columns: numbers of the channels that have it in common.
        levels: the same noise as one of two levels; None where it is hardly that.
        normal: whether noise of one level is normal, and all of its tails are louder times.
    """

    spread: float
    memory_s: float
    unsure: float
    columns: tuple[int, ...]
    levels: TwoLevels | None = None
    normal: bool = True

    def inverse_variance(self, squares: Array, many: Array, interval_s: float) -> tuple[Array, float, float]:
        """(n,) inverse of the variance at each time; log weight of what is known of that; its gain in log evidence over
        a variance of one: of a level that wanders, maybe slower than a recording at rest can show, or of two, whichever
        is likelier.

        Args:
            squares: (n,) sums of squares of noise of variance one on average. many: (n,) of how many readings.
        """
        ways = [self._slower(times)._wandering(squares, many, interval_s) for times in _SLOWER]
        if self.levels is not None:
            gained, inverse = self.levels.gain(squares, many, interval_s)
            of_it = 0.5 * float(many @ np.log(inverse) - squares @ (inverse - 1.0))
            ways.append((inverse, gained - of_it, gained))
        inverse, weight, gained = max(ways, key=lambda way: way[2])
        return inverse, weight - log(len(ways)), gained - log(len(ways))

    def _slower(self, times: float) -> Unsteady:
        """The same with so many times the memory, of which the recording at rest saw as much less."""
        unsure = min(self.spread, self.unsure * float(np.sqrt(times)))
        return replace(self, memory_s=times * self.memory_s, unsure=unsure)

    def _wandering(self, every: Array, there: Array, interval_s: float) -> tuple[Array, float, float]:
        """Laplace's approximation, about the mode that Newton's steps find (Rue, Martino and Chopin, Journal of the
        Royal Statistical Society B 71, 2009)."""
        length = max(min(self.memory_s / (_PIECES * interval_s), len(every) / _FEWEST), _LONG, len(every) / _MOST)
        piece = (np.arange(len(every)) / length).astype(int)
        many, squares = np.bincount(piece, there), np.bincount(piece, every)
        time_s = length * interval_s * np.arange(len(many))
        apart_s = np.abs(time_s[:, None] - time_s)
        if np.isinf(self.memory_s):
            drift = (time_s - time_s.mean()) / max(float(time_s.std()), 1e-300)
            covariance = self.spread**2 * np.outer(drift, drift) + self.unsure**2
        else:
            covariance = self.spread**2 * np.exp(-apart_s / self.memory_s) + self.unsure**2
        mean = -0.5 * self.spread**2  # so that the variance is one on average
        level = np.full(len(many), mean)
        for _ in range(_STEPS):
            curved = 0.5 * squares * np.exp(-level)
            root = np.sqrt(curved)
            factor = cho_factor(np.eye(len(many)) + root[:, None] * covariance * root)
            aim = curved * (level - mean) + curved - 0.5 * many
            weights = aim - root * cho_solve(factor, root * (covariance @ aim))
            step = mean + covariance @ weights - level
            level = level + np.clip(step, -1.0, 1.0)
            if np.abs(step).max() < _NO_STEP:
                break
        weight = -0.5 * float(weights @ (level - mean)) - float(np.sum(np.log(np.diag(factor[0]))))
        gained = -0.5 * float(many @ level + squares @ np.expm1(-level)) + weight
        return np.exp(-level)[piece], weight, gained


def unsteadiness(readings: Array, labels: Rows, interval_s: float, boards: Sequence[Sequence[int]]) -> list[Unsteady]:
    """Of channels whose readings at rest show it.

    By the normal scores of the sizes of what neighbours do not predict: long tails, which are anywhere, are nothing
    then. Steady noise, and a level of each channel, of each sensor or of all are models, of which the Bayesian
    information criterion tells (Schwarz, Annals of Statistics 6, 1978); their likelihood is Whittle's.

    Args:
        readings: (n, 6) [recorded unit]. labels: (n,) number of the pose at rest, -1 where the arm moves.
        interval_s: between readings. boards: numbers of the channels that are there, of each sensor.
    """
    every = [column for board in boards for column in board]
    left = [_unpredicted(readings[labels == label][:, every]) for label in np.unique(labels) if label >= 0]
    whole = np.concatenate(left) if left else np.zeros((0, len(every)))
    if len(whole) < 2 * _MEMORY or not np.all(np.ptp(np.abs(whole), axis=0) > 0.0):
        return []
    whole = whole / whole.std(axis=0)
    scores = normal_scores(np.abs(whole))
    scores /= scores.std(axis=0)

    def of(columns: Sequence[int]) -> tuple[float, list[Unsteady]]:
        own = [every.index(column) for column in columns]
        return _level(whole[:, own], scores[:, own], interval_s, columns)

    by_board = []
    for board in boards:
        ways = [_joined(of([column]) for column in board), *([of(board)] if len(board) > 1 else [])]
        by_board.append(max(ways, key=lambda way: way[0]))
    ways = [_joined(by_board), *([of(every)] if len(boards) > 1 else [])]
    return max(ways, key=lambda way: way[0])[1]


def _joined(ways: Iterable[tuple[float, list[Unsteady]]]) -> tuple[float, list[Unsteady]]:
    several = list(ways)
    return sum(gain for gain, _ in several), [each for _, found in several for each in found]


def _level(noise: Array, scores: Array, interval_s: float, columns: Sequence[int]) -> tuple[float, list[Unsteady]]:
    """Gain of a level that channels have in common, and it; neither where a steady one is likelier.

    Args:
        noise: (n, c) of variance one. scores: (n, c) normal ones of its size.
    """
    channels = len(columns)
    times = np.geomspace(_SHORTEST, max(len(scores) / 4.0, _SHORTEST), _TIMES)
    gains, steady = _gains(scores, times)
    gain = float(gains.max() - np.log(len(scores)))
    if gain < steady:
        return 0.0, []
    share, time = (int(index) for index in np.unravel_index(np.argmax(gains), gains.shape))
    spread = float(np.sqrt(_OF_A_SQUARE * _SHARES[share] / (1.0 - _SHARES[share])))
    unsure = spread / float(np.sqrt(max(len(scores) / (2.0 * times[time]), 1.0)))
    squares, many = np.sum(noise**2, axis=1), np.full(len(noise), float(channels))
    levels = _two_levels(squares, many, interval_s)
    found = Unsteady(spread, float(times[time]) * interval_s, unsure, tuple(columns), levels)
    inverse, _, _ = found.inverse_variance(squares, many, interval_s)
    normal = all(np.isinf(student(own * np.sqrt(inverse))[0]) for own in noise.T)
    return gain, [replace(found, normal=normal)]


def _of_levels(squares: Array, many: Array, ratio: Array, share: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Log likelihoods (k,) of two levels against a variance of one, (n, k) the probability of the louder given all
    samples so far, and (k,) the variance at the other; arguments as of ``TwoLevels``, ``rate`` a sample."""
    lower = 1.0 / (1.0 + share * (ratio - 1.0))
    odds = 0.5 * (np.outer(squares, (1.0 - 1.0 / ratio) / lower) - np.outer(many, np.log(ratio)))
    gains, filtered = forward(odds, share, rate)
    return gains - 0.5 * (many.sum() * np.log(lower) + squares.sum() * (1.0 / lower - 1.0)), filtered, lower


def _two_levels(squares: Array, many: Array, interval_s: float) -> TwoLevels | None:
    """The likeliest, None where a steady level is; arguments as of ``TwoLevels.gain``.

    In a long recording short stays are told by a stretch of it, long ones by sums over several readings.
    """
    several = -(-len(squares) // _TIMES_OF_LEVELS)
    ways = [_likeliest_levels(squares[:_TIMES_OF_LEVELS], many[:_TIMES_OF_LEVELS], interval_s)]
    if several > 1:
        starts = np.arange(0, len(squares), several)
        summed, numbers = np.add.reduceat(squares, starts), np.add.reduceat(many, starts)
        gain, levels = _likeliest_levels(summed, numbers, several * interval_s)
        ways.append((gain * _TIMES_OF_LEVELS / len(squares), levels))  # as much of the recording as the stretch
    return max(ways, key=lambda way: way[0])[1]


def _likeliest_levels(squares: Array, many: Array, interval_s: float) -> tuple[float, TwoLevels | None]:
    """What two levels gain in log likelihood, and they; neither where a steady one is likelier."""
    stays = np.geomspace(_SHORTEST, max(0.25 * len(squares), _SHORTEST), _STAYS)
    ratio, share, rate = (each.ravel() for each in np.meshgrid(_RATIOS, _LOUD, 0.5 / stays, indexing="ij"))
    gains, _, _ = _of_levels(squares, many, ratio, share, rate)
    best = int(np.argmax(gains))
    if gains[best] < 1.5 * np.log(len(squares)):
        return 0.0, None
    return float(gains[best]), TwoLevels(float(ratio[best]), float(share[best]), float(rate[best]) / interval_s)


def _mean_first(channels: int) -> Array:
    """(c, c) orthogonal; its first column takes the mean."""
    return np.asarray(np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0])


def _unpredicted(readings: Array) -> Array:
    """(m, c) what the readings just before do not predict of each, by least squares."""
    if len(readings) < 4 * _MEMORY:
        return readings[:0]
    left = readings - readings.mean(axis=0)
    found = []
    for values in left.T:
        before = np.column_stack([values[_MEMORY - lag - 1 : len(values) - lag - 1] for lag in range(_MEMORY)])
        now = values[_MEMORY:]
        found.append(now - before @ np.linalg.lstsq(before, now, rcond=None)[0])
    return np.column_stack(found)


def _bands(count: int) -> Rows:
    """Numbers of the first of each band of so many frequencies: every one of the lowest, then geometric bands."""
    if count <= _EACH:
        return np.arange(count)
    beyond = np.geomspace(_EACH, count, int(log(count / _EACH) / _WITHIN) + 2)[:-1]
    return np.concatenate([np.arange(_EACH), np.unique(beyond.astype(np.intp))])


def _gains(scores: Array, times: Array) -> tuple[Array, float]:
    """(s, t) gain in log likelihood of each share and correlation time of a common level; that of one that remembers
    nothing.

    The mean of the channels has all of the level, what they differ by has none.

    Args:
        scores: (n, c).
    """
    count, channels = scores.shape
    power = np.abs(rfft(scores @ _mean_first(channels), axis=0)[1 : count // 2]) ** 2 / count
    rest = float(power[:, 1:].sum())
    starts = _bands(len(power))
    weight = np.diff(starts, append=len(power))
    mean = np.add.reduceat(power[:, 0], starts) / weight
    angle = 2.0 * np.pi * (starts + 0.5 * (weight + 1.0)) / count

    def likelihood(share: float, decay: float) -> float:
        shape = (1.0 - decay**2) / (1.0 - 2.0 * decay * np.cos(angle) + decay**2)
        spectrum = channels * share * shape + 1.0 - share
        of_rest = (channels - 1) * len(power) * log(1.0 - share) + rest / (1.0 - share)
        return -float(weight @ (np.log(spectrum) + mean / spectrum) + of_rest)

    none = likelihood(0.0, 0.0)
    gains = np.array([[likelihood(share, decay) for decay in np.exp(-1.0 / times)] for share in _SHARES]) - none
    return gains, max(0.0, *(likelihood(share, 0.0) - none for share in _SHARES))
