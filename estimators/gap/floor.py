"""How well the floor is known: the likelihood of a sweep's spectrum under a floor that was learned at rest.

A floor has a white part, a coloured part and the coloured part's time. The recording at rest tells each of them as well
as its periodogram does; a spectrum of the sweep is judged with these three free, weighed by that likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from estimators.gap.colour import ChannelNoise

Array = NDArray[np.float64]

#: Frequencies whose logarithms differ by less are added up.
_ALIKE: Final = 0.03
#: Step in the logarithm of the time, for a derivative.
_STEP: Final = 0.05
#: Bounds of the logarithms of white part, coloured part and time, about what was learned.
_WHITE, _COLOURED, _TIME = (-2.0, 5.0), (-4.0, 5.0), (-1.5, 1.5)
#: Bounds of an added spectrum's logarithm, as a share of the floor at its largest.
_ADDED: Final = (float(np.log(1e-5)), float(np.log(1e8)))


@dataclass(frozen=True)
class Parts:
    """A floor's spectrum at some frequencies, as shares of a reference.

    Attributes:
        white, coloured: (b,) of the two parts.
        slope: (b,) derivative of the coloured part's logarithm with respect to that of its time.
        fixed: what noise that was named already adds.
    """

    white: Array
    coloured: Array
    slope: Array
    fixed: Array | float = 0.0

    def at(self, point: Array) -> Array:
        """(b,) with the logarithms of white part, coloured part and time moved by ``point`` (3,)."""
        own = np.exp(point[0]) * self.white + np.exp(point[1] + point[2] * self.slope) * self.coloured
        return np.asarray(own + self.fixed)

    def gradient(self, point: Array) -> Array:
        """(3, b) derivatives of ``at``."""
        coloured = np.exp(point[1] + point[2] * self.slope) * self.coloured
        return np.stack([np.exp(point[0]) * self.white, coloured, coloured * self.slope])


def parts(noise: ChannelNoise, frequency: Array, interval_s: float) -> Parts:
    """The spectrum of a channel's noise [recorded unit^2] at frequencies (b,) [cycles a sample]."""
    white = np.full_like(frequency, noise.white)
    if noise.coloured == 0.0:
        return Parts(white, np.zeros_like(white), np.zeros_like(white))
    low, middle, high = (
        noise.folded + noise.coloured * _exponential(frequency, np.exp(-interval_s / (noise.tau_s * np.exp(step))))
        for step in (-_STEP, 0.0, _STEP)
    )
    tiny = 1e-9 * noise.coloured
    slope = (np.log(np.maximum(high, tiny)) - np.log(np.maximum(low, tiny))) / (2.0 * _STEP)
    return Parts(white, np.maximum(middle, tiny), slope)


def _exponential(frequency: Array, decay: float) -> Array:
    return np.asarray((1.0 - decay**2) / (1.0 - 2.0 * decay * np.cos(2.0 * np.pi * frequency) + decay**2))


@dataclass(frozen=True)
class Learned:
    """What the recording at rest tells of one channel's floor."""

    noise: ChannelNoise

    @property
    def free(self) -> int:
        """How many of white part, coloured part and time there are."""
        return 1 if self.noise.coloured == 0.0 else 3

    @cached_property
    def _at_rest(self) -> tuple[Array, Parts]:
        """Ordinates of each group of the periodogram at rest, and the spectrum there in shares of itself."""
        ordinates = max(2, self.noise.samples // 2)
        edges = np.unique(np.concatenate([[0.5], np.geomspace(1.0, ordinates, 64), [ordinates]]).round().astype(int))
        counts = np.diff(edges).astype(float)
        middles = np.asarray(0.5 * (edges[1:] + edges[:-1]) / (2.0 * ordinates), dtype=float)
        interval_s = max(self.noise.duration_s, 1e-12) / self.noise.samples
        found = parts(self.noise, middles, interval_s)
        total = found.white + found.coloured
        return counts, Parts(found.white / total, found.coloured / total, found.slope)

    def penalty(self, point: Array) -> tuple[float, Array]:
        """Minus twice the log likelihood of the recording at rest, from its largest; and its gradient (3,).

        Channels that share the shape of their noise tell of it together; each tells of its own size alone.
        """
        if self.free == 1:
            samples = float(self.noise.samples)
            value = samples * (point[0] + np.exp(-point[0]) - 1.0)
            return float(value), np.array([samples * (1.0 - np.exp(-point[0])), 0.0, 0.0])
        counts, shares = self._at_rest
        total, slopes = shares.at(point), shares.gradient(point)
        value = 2.0 * float(counts @ (np.log(total) + 1.0 / total - 1.0))
        gradient = 2.0 * slopes @ (counts * (1.0 - 1.0 / total) / total)
        if (others := self.noise.sharing - 1) > 0:
            many = float(counts.sum())
            scale = float(counts @ (1.0 / total)) / many
            value += 2.0 * others * (many * float(np.log(scale)) + float(counts @ np.log(total)))
            gradient += 2.0 * others * slopes @ (counts * (1.0 / total - 1.0 / (scale * total**2)))
        return value, np.asarray(gradient)


@dataclass(frozen=True)
class Spectrum:
    """Squared cosine coefficients of a sweep's whitened residual, added up over neighbouring frequencies.

    Attributes:
        learned: the floor at rest.
        floor: its spectrum, whitened.
        power: (b,) sums of squares. counts: (b,) how many.
    """

    learned: Learned
    floor: Parts
    power: Array
    counts: Array

    def alone(self) -> tuple[Array, float]:
        """The floor (3,) that is likeliest without anything added, and minus twice the log likelihood."""
        return self._likeliest(np.zeros_like(self.power), np.zeros(3))

    def added(self, unit: Array) -> tuple[float, float, float]:
        """The variance x that makes the squares likeliest under floor + x unit: x, twice the gain, its deviation.

        Args:
            unit: (b,) what variance one adds.
        """
        largest = float(unit.max()) if unit.size else 0.0
        if largest <= 0.0:
            return 0.0, 0.0, np.inf
        relative = unit / largest
        start, nothing = self.alone()
        best, least = np.array([*start, 0.0]), np.inf
        for exponent in (-3.0, 2.0, 7.0):
            value = self._loss(np.array([*start, exponent]), relative)[0]
            if value < least:
                best, least = np.array([*start, exponent]), value
        bounds = [*self._bounds, _ADDED]
        found = minimize(self._loss, best, args=(relative,), jac=True, method="L-BFGS-B", bounds=bounds)
        gain = nothing - float(found.fun)
        if gain <= 0.0:
            return 0.0, 0.0, np.inf
        point, ratio = found.x[:3], float(np.exp(found.x[3]))
        total = self.floor.at(point) + ratio * relative
        slopes = np.vstack([self.floor.gradient(point), relative]) / total
        information = 0.5 * (slopes * self.counts) @ slopes.T
        for index in range(self.learned.free):
            step = np.zeros(3)
            step[index] = 1e-3
            ahead, behind = self.learned.penalty(point + step)[1], self.learned.penalty(point - step)[1]
            information[:3, index] += 0.25 * (ahead - behind) / 1e-3
        kept = [*range(self.learned.free), 3]
        spread = float(np.sqrt(np.linalg.pinv(information[np.ix_(kept, kept)], hermitian=True)[-1, -1]))
        return ratio / largest, gain, spread / largest

    def misfit(self, bands: int, fewest: float) -> tuple[float, int]:
        """How far the squares are from the likeliest floor, and it from what was learned: chi-square and its degrees.

        Args:
            bands: of frequency, of equal ratio. fewest: squares that a band must hold to be looked at.
        """
        point, _ = self.alone()
        penalty = self.learned.penalty(point)[0]
        edges = np.geomspace(1.0, float(self.counts.sum()) + 1.0, bands + 1)
        band = np.searchsorted(edges, np.cumsum(self.counts), side="left")
        many = np.bincount(band, self.counts, bands + 2)
        ratio = np.bincount(band, self.power / self.floor.at(point), bands + 2) / np.maximum(many, 1.0)
        kept = many >= fewest
        deviance = many * (ratio - 1.0 - np.log(np.maximum(ratio, 1e-12)))
        return float(deviance[kept].sum()) + penalty, int(kept.sum())

    def _likeliest(self, unit: Array, start: Array) -> tuple[Array, float]:
        def loss(point: Array) -> tuple[float, Array]:
            value, gradient = self._loss(np.array([*point, -np.inf]), unit)
            return value, gradient[:3]

        found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=self._bounds)
        return np.asarray(found.x), float(found.fun)

    @property
    def _bounds(self) -> list[tuple[float, float]]:
        return [_WHITE, _COLOURED, _TIME] if self.learned.free == 3 else [_WHITE, (0.0, 0.0), (0.0, 0.0)]

    def _loss(self, point: Array, unit: Array) -> tuple[float, Array]:
        added = float(np.exp(point[3]))
        total = self.floor.at(point[:3]) + added * unit
        penalty, pull = self.learned.penalty(point[:3])
        slope = (self.counts - self.power / total) / total
        value = float(self.counts @ np.log(total) + np.sum(self.power / total)) + penalty
        return value, np.array([*(self.floor.gradient(point[:3]) @ slope + pull), added * float(unit @ slope)])


def groups(count: int, first: int) -> NDArray[np.intp]:
    """The group of each of the cosine coefficients ``first`` to ``count`` - 1, from zero on."""
    number = np.arange(first, count, dtype=float)
    return np.asarray(np.unique((np.log(number) / _ALIKE).astype(int), return_inverse=True)[1])
