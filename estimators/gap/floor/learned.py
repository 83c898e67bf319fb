"""How well the floor is known: the likelihood of a sweep's spectrum under a floor that was learned at rest.

A floor has a white part, and coloured parts each with a time. The recording at rest tells all of these as well as its
periodogram does; a spectrum of the sweep is judged with them free, weighed by that likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arrays import Array
from rig.channels import COLUMNS_OF
from rig.effects._numerics import exponential_spectrum

#: Frequencies whose logarithms differ by less are added up.
_ALIKE: Final = 0.03
#: Step in the logarithm of the time, for a derivative.
_STEP: Final = 0.05
#: Bounds of the logarithms of white part, coloured part and time, about what was learned; for the size of a part that
#: was not seen, in standard deviations.
_WHITE, _COLOURED, _TIME, _FARTHEST = (-2.0, 5.0), (-4.0, 5.0), (-1.5, 1.5), 4.0
#: Prior standard deviations of the logarithms of a coloured part's size and time about what was learned.
_SIZES, _TIMES = 1.5, 0.7
#: The same, and the bounds, of the time of a part that is as slow as half the time for which a pose was held: readings
#: at rest tell how its spectrum falls, but hardly from where.
_ANY_TIME, _FROM_THERE = 2.0, (-4.0, 4.0)
#: A floor may go on below what the poses at rest show: parts so many times slower than each other, each as large as
#: those that were seen, give or take a factor of exp(2); of a white one as large as just stays unseen, give or take
#: exp(4), as nothing tells. Noise of electronics falls with one over the frequency for as long as anyone has looked
#: (Keshner, "1/f noise", Proceedings of the IEEE 70, 1982).
_SLOWER, _UNSEEN, _UNTOLD = 4.0, 2.0, 4.0
#: The share of its expected size that such a part has in the floor as it was learned.
_NEXT_TO_NOTHING: Final = 1e-6
#: Logarithm of how much larger the slowest part may turn out, to start from.
_LARGER: Final = 3.0
#: Twice a gain below which it is not worth a search.
_NOTHING: Final = 4.0
#: Bounds of an added spectrum's logarithm, as a share of the floor at its largest.
_ADDED: Final = (float(np.log(1e-5)), float(np.log(1e8)))


@dataclass(frozen=True)
class Parts:
    """A floor's spectrum at some frequencies, as shares of a reference.

    A point (1 + 2 k,) moves it: the logarithm of the white part, then for each of k coloured parts that of its size and
    that of its time.

    Attributes:
        white: (b,). coloured: (k, b).
        slopes: (k, b) derivative of a coloured part's logarithm with respect to that of its time.
        fixed: what noise that was named already adds.
    """

    white: Array
    coloured: Array
    slopes: Array
    fixed: Array | float = 0.0

    def at(self, point: Array) -> Array:
        """(b,)."""
        return np.asarray(np.exp(point[0]) * self.white + self._moved(point).sum(axis=0) + self.fixed)

    def gradient(self, point: Array) -> Array:
        """(1 + 2 k, b) derivatives of ``at``."""
        return self.both(point)[1]

    def both(self, point: Array) -> tuple[Array, Array]:
        """``at`` and ``gradient``."""
        gradient = np.empty((len(point), len(self.white)))
        np.multiply(self.white, np.exp(point[0]), out=gradient[0])
        gradient[1::2] = self._moved(point)
        np.multiply(gradient[1::2], self.slopes, out=gradient[2::2])
        return gradient[0] + gradient[1::2].sum(axis=0) + self.fixed, gradient

    def times(self, factor: Array, fixed: Array | float = 0.0) -> Parts:
        """Times a factor (b,)."""
        return Parts(self.white * factor, self.coloured * factor, self.slopes, fixed)

    def _moved(self, point: Array) -> Array:
        return np.asarray(np.exp(point[1::2, None] + point[2::2, None] * self.slopes) * self.coloured)


def parts(noise: ChannelNoise, frequency: Array, interval_s: float) -> Parts:
    """The spectrum of a channel's noise [recorded unit^2] at frequencies (b,) [cycles a sample]."""
    coloured, slopes = [], []
    total = sum(size for size, _ in noise.parts)
    for size, tau_s in noise.parts:
        low, middle, high = (
            np.maximum(
                size / total * noise.folded + size * exponential_spectrum(frequency, interval_s, tau_s * np.exp(step)),
                1e-9 * size,
            )
            for step in (-_STEP, 0.0, _STEP)
        )
        coloured.append(middle)
        slopes.append((np.log(high) - np.log(low)) / (2.0 * _STEP))
    shape = (len(coloured), len(frequency))
    white = noise.uncoloured(frequency / interval_s)
    return Parts(white, np.reshape(coloured, shape), np.reshape(slopes, shape))


def going_on(floor: Sequence[ChannelNoise], column: int, until_s: float) -> tuple[tuple[float, float], ...]:
    """Sizes [V^2] and times [s] of parts that a channel's floor may have below what the poses at rest show.

    None where there were no such poses.

    Args:
        floor: of the six channels. until_s: the slowest worth looking at [s].
    """
    coloured = [floor[index] for index in board_of(column) if floor[index].seen]
    own = [floor[column]] if floor[column].seen or not coloured else coloured
    held_s = own[0].duration_s / own[0].holds
    if not held_s:
        return ()
    if coloured:
        share = float(np.mean([np.mean([size for size, _ in noise.seen]) / noise.white for noise in own]))
        first = max(_SLOWER * max(tau_s for noise in own for _, tau_s in noise.seen), held_s)
    else:  # where the two spectra meet at one cycle a pose
        share, first = own[0].holds / max(own[0].samples, 1), held_s
    many = 1 + max(0, int(np.floor(np.log(max(until_s / first, 1.0)) / np.log(_SLOWER))))
    size = _NEXT_TO_NOTHING * share * floor[column].white
    return tuple((size, first * _SLOWER**number) for number in range(many))


def remembers(floor: Sequence[ChannelNoise], column: int) -> bool:
    """Whether any channel of a channel's sensor was seen to be coloured at rest."""
    return any(floor[index].seen for index in board_of(column))


def board_of(column: int) -> range:
    """The channels of a channel's sensor."""
    (own,) = [range(6)[of] for of in COLUMNS_OF.values() if column in range(6)[of]]
    return own


@dataclass(frozen=True)
class Learned:
    """What the recording at rest tells of one channel's floor.

    Attributes:
        noise: as it was learned. unseen: how many parts, the last ones, are slower than it shows.
        told: what a sample tells, as a share of what one of normal noise does.
    """

    noise: ChannelNoise
    unseen: int = 0
    told: float = 1.0

    @property
    def free(self) -> int:
        """The length of a point."""
        return 1 + 2 * len(self.noise.parts)

    @property
    def unseen_s(self) -> tuple[float, ...]:
        """Times of the parts that it does not show [s]."""
        return tuple(tau_s for _, tau_s in self.noise.parts[len(self.noise.parts) - self.unseen :])

    @cached_property
    def _at_rest(self) -> tuple[Array, Parts]:
        """Ordinates of each group of the periodogram at rest, and the spectrum there in shares of itself."""
        ordinates = max(2, self.noise.samples // 2)
        first = min(self.noise.holds, ordinates // 2)  # slower than a pose is held, nothing is seen
        edges = np.geomspace(first, ordinates, 64)
        edges = np.unique(np.concatenate([[first - 0.5], edges, [ordinates]]).round().astype(int))
        counts = np.diff(edges).astype(float)
        middles = np.asarray(0.5 * (edges[1:] + edges[:-1]) / (2.0 * ordinates), dtype=float)
        interval_s = max(self.noise.duration_s, 1e-12) / self.noise.samples
        found = parts(self.noise, middles, interval_s)
        return self.told * counts, found.times(1.0 / found.at(np.zeros(self.free)))

    def information(self, point: Array) -> Array:
        """Fisher information of a point in the recording at rest."""
        if self.free == 1:
            return np.array([[0.5 * self.told * self.noise.samples]])
        counts, shares = self._at_rest
        slopes = shares.gradient(point) / shares.at(point)
        return np.asarray((slopes * counts) @ slopes.T)

    def penalty(self, point: Array) -> tuple[float, Array]:
        """Minus twice the log likelihood of the channel's recording at rest, from its largest; and its gradient.

        Of channels that share the shape of their noise each tells its own part: tests add up what they tell.
        """
        if self.free == 1:
            samples = self.told * self.noise.samples
            value = samples * (point[0] + np.exp(-point[0]) - 1.0)
            return float(value), np.array([samples * (1.0 - np.exp(-point[0]))])
        counts, shares = self._at_rest
        total, slopes = shares.both(point)
        value = 2.0 * float(counts @ (np.log(total) + 1.0 / total - 1.0))
        gradient = 2.0 * slopes @ (counts * (1.0 - 1.0 / total) / total)
        return value, np.asarray(gradient)


@dataclass(frozen=True)
class Spectrum:
    """Squared cosine coefficients of a sweep's whitened residual, added up over neighbouring frequencies.

    Attributes:
        learned: the floor at rest.
        floor: its spectrum, whitened.
        power: (b,) sums of squares. counts: (b,) how many.
        believed: a point's prior mean and precisions, (free,) each, where something beside this channel tells of them.
        near: (free,) a point near the likeliest one, where one is known.
    """

    learned: Learned
    floor: Parts
    power: Array
    counts: Array
    believed: tuple[Array, Array] | None = None
    near: Array | None = None

    @cached_property
    def alone(self) -> tuple[Array, float]:
        """The floor's point that is likeliest without anything added, and minus twice its log posterior."""
        nothing = np.zeros_like(self.power)

        def loss(point: Array) -> tuple[float, Array]:
            value, gradient = self._loss(np.array([*point, -np.inf]), nothing)
            return value, gradient[:-1]

        starts = [self.expected.copy() if self.near is None else self.near]
        if self.learned.free == 1 and self.near is None:  # of a white floor, where it is likeliest but for its prior
            known = self.learned.told * self.learned.noise.samples
            found = (float(np.sum(self.power / self.floor.at(np.zeros(1)))) + known) / (
                float(self.counts.sum()) + known
            )
            starts = [np.array([np.clip(np.log(max(found, 1e-300)), *_WHITE)])]
        if not self.learned.unseen and len(self.learned.noise.parts) > 1:  # the slowest may be larger than it seemed
            starts.append(np.where(np.arange(self.learned.free) == self.learned.free - 2, _LARGER, 0.0))
        ways = [minimize(loss, start, jac=True, method="L-BFGS-B", bounds=self._bounds) for start in starts]
        best = min(ways, key=lambda way: float(way.fun))
        return np.asarray(best.x), float(best.fun)

    def added(self, unit: Array) -> tuple[float, float, float]:
        """The variance x that makes the squares likeliest under floor + x unit: x, twice the gain, its deviation.

        Where the score at zero promises next to nothing it is not searched: the promise is returned.

        Args:
            unit: (b,) what variance one adds.
        """
        largest = float(unit.max()) if unit.size else 0.0
        if largest <= 0.0:
            return 0.0, 0.0, np.inf
        relative = unit / largest
        start, nothing = self.alone
        floor = self.floor.at(start)
        score = float(
            relative @ ((self.counts - self.power / floor) / floor)
        )  # of the loss: below zero where more fits
        curvature = 1.0 / self._spread(start, 0.0, relative) ** 2
        if score >= 0.0:
            return 0.0, 0.0, 1.0 / np.sqrt(curvature) / largest
        promise = 0.25 * score**2 / curvature
        if promise < _NOTHING:
            return -0.5 * score / curvature / largest, promise, 1.0 / np.sqrt(curvature) / largest
        best, least = np.array([*start, 0.0]), np.inf
        for exponent in (-3.0, 2.0, 7.0):
            value = self._loss(np.array([*start, exponent]), relative)[0]
            if value < least:
                best, least = np.array([*start, exponent]), value
        bounds = [*self._bounds, _ADDED]
        found = minimize(self._loss, best, args=(relative,), jac=True, method="L-BFGS-B", bounds=bounds)
        gain = nothing - float(found.fun)
        if gain <= 0.0:
            return 0.0, 0.0, 1.0 / np.sqrt(curvature) / largest
        ratio = float(np.exp(found.x[-1]))
        return ratio / largest, gain, self._spread(found.x[:-1], ratio, relative) / largest

    def _spread(self, point: Array, ratio: float, relative: Array) -> float:
        """Standard deviation of what is added, with the floor free."""
        total = self.floor.at(point) + ratio * relative
        slopes = np.vstack([self.floor.gradient(point), relative]) / total
        information = 0.5 * (slopes * self.counts) @ slopes.T
        free = self.learned.free
        for index in range(free):
            step = np.zeros(free)
            step[index] = 1e-3
            ahead, behind = self.learned.penalty(point + step)[1], self.learned.penalty(point - step)[1]
            information[:free, index] += 0.25 * (ahead - behind) / 1e-3
        variance = float(np.linalg.pinv(information, hermitian=True)[-1, -1])
        if variance <= 0.0:  # far from the likeliest floor the observed information need not be positive
            variance = 1.0 / float(information[-1, -1])
        return float(np.sqrt(variance))

    def information(self, point: Array) -> Array:
        """(free, free) Fisher information of a point in the sweep."""
        slopes = self.floor.gradient(point) / self.floor.at(point)
        return np.asarray(0.5 * (slopes * self.counts) @ slopes.T)

    @cached_property
    def precision(self) -> Array:
        """(free,) prior precisions of the logarithms of the white part, and of the coloured parts' sizes and times."""
        if self.believed is not None:
            return self.believed[1]
        times = np.where(self._slow, _ANY_TIME, _TIMES)
        found = np.array([1e-2, *np.column_stack([np.full(len(times), _SIZES), times]).ravel() ** -2.0])
        seen = self.learned.free > 1 + 2 * self.learned.unseen
        found[self.unseen] = 1.0 / (_UNSEEN if seen else _UNTOLD) ** 2
        return found

    @cached_property
    def expected(self) -> Array:
        """(free,) their prior means."""
        if self.believed is not None:
            return self.believed[0]
        found = np.zeros(self.learned.free)
        found[self.unseen] = -np.log(_NEXT_TO_NOTHING)
        return found

    @property
    def unseen(self) -> slice:
        """Where a point has the sizes of parts that were not seen."""
        return slice(self.learned.free - 2 * self.learned.unseen, None, 2)

    @property
    def _slow(self) -> list[bool]:
        """Of each coloured part, whether it was seen, but is as slow as a pose was held."""
        noise = self.learned.noise
        seen = len(noise.seen) - self.learned.unseen
        return [slow and index < seen for index, slow in enumerate(noise.slow)]

    @property
    def _bounds(self) -> list[tuple[float, float]]:
        found = [_WHITE]
        for slow in self._slow:
            found += [_COLOURED, _FROM_THERE if slow else _TIME]
        found[self.unseen] = [(0.0, _FARTHEST * _UNTOLD - np.log(_NEXT_TO_NOTHING))] * self.learned.unseen
        return found

    def _loss(self, point: Array, unit: Array) -> tuple[float, Array]:
        added = float(np.exp(point[-1]))
        floor, slopes = self.floor.both(point[:-1])
        total = floor + added * unit
        penalty, pull = self.learned.penalty(point[:-1])
        slope = (self.counts - self.power / total) / total
        off = point[:-1] - self.expected
        pulled = self.precision * off
        value = float(self.counts @ np.log(total) + np.sum(self.power / total) + pulled @ off) + penalty
        gradient = slopes @ slope + pull + 2.0 * pulled
        return value, np.array([*gradient, added * float(unit @ slope)])


@lru_cache(maxsize=8)
def groups(count: int, first: int) -> NDArray[np.intp]:
    """The group of each of the cosine coefficients ``first`` to ``count`` - 1, from zero on."""
    number = np.arange(first, count, dtype=float)
    found = np.asarray(np.unique((np.log(number) / _ALIKE).astype(int), return_inverse=True)[1])
    found.setflags(write=False)  # every caller has the same
    return found
