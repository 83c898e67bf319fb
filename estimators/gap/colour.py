"""The colour of a channel's noise: white plus first-order Gauss-Markov, learned at rest, used to whiten a sweep.

White noise plus an exponentially correlated part is the two-term model behind an Allan deviation's slope and hump
(IEEE Std 952, annex C). Sampled at any rate it is an ARMA(1, 1) process, so what a locked recording at one rate
teaches holds at the sweep's rate: the model carries autocovariances over, never filter coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import chi2

from estimators.gap.periodogram import Periodogram

Array = NDArray[np.float64]

#: Twice the gain in log likelihood that two more parameters must bring before a floor counts as coloured. The null
#: distribution lies below chi-square with two degrees of freedom, whose tail here is 1e-4.
COLOUR_THRESHOLD = 18.4
#: p-value below which channels do not share the shape of their noise.
SHARED_AT = 1e-3
#: Innovations are taken once the filter's memory of its start is below this share.
_FORGOTTEN = 0.01
#: The first steps of the search: a factor of e in the odds of the coloured share and in the correlation time.
_SIMPLEX = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True)
class ChannelNoise:
    """A channel's noise.

    Attributes:
        white: variance of the white part [V^2].
        coloured: variance of the exponentially correlated part [V^2]; zero for white noise.
        tau_s: its correlation time [s].
        samples: how many samples it was learned from.
        duration_s: how long these lasted [s].
        folded: of the coloured part, what means over blocks of samples make look white [V^2]; may be below zero.
        sharing: how many channels told the coloured part's share and time.
    """

    white: float
    coloured: float = 0.0
    tau_s: float = 1.0
    samples: int = 0
    duration_s: float = 0.0
    folded: float = 0.0
    sharing: int = 1

    def samples_at(self, interval_s: float) -> float:
        """How many samples at another rate tell as much of the noise as those it was learned from.

        Of white noise every sample tells alike; of coloured noise only what lies within the other rate's band.
        """
        return float(self.samples) if self.coloured == 0.0 else min(float(self.samples), self.duration_s / interval_s)

    @property
    def variance(self) -> float:
        """[V^2]."""
        return self.white + self.folded + self.coloured

    def autocovariance(self, lag_s: Array) -> Array:
        """[V^2] at lags [s]."""
        lag = np.abs(np.asarray(lag_s, dtype=float))
        return np.asarray(self.coloured * np.exp(-lag / self.tau_s) + np.where(lag == 0.0, self.white, 0.0))

    def averaged(self, block: int, interval_s: float) -> ChannelNoise:
        """The noise of means over blocks of so many samples.

        Means of an exponentially correlated process keep its correlation from block to block; what their variance has
        beyond that of such a process, or lacks, looks white.
        """
        decay = float(np.exp(-interval_s / self.tau_s))
        if block == 1 or self.coloured == 0.0:
            return replace(self, white=self.white / block)
        lags = np.arange(1, block)
        own = (block + 2.0 * float(np.sum((block - lags) * decay**lags))) / block**2
        across = float(np.sum(decay ** np.arange(block)) * np.sum(decay ** -np.arange(block))) / block**2
        return replace(
            self,
            white=self.white / block,
            folded=self.folded / block + self.coloured * (own - across),
            coloured=self.coloured * across,
        )

    def whitener(self, interval_s: float) -> Whitener:
        """The filter that turns this noise, sampled every ``interval_s`` [s], into white noise of variance one."""
        phi = float(np.exp(-interval_s / self.tau_s)) if self.coloured > 0 else 0.0
        # (1 - phi L) y is a first-order moving average: match its two autocovariances (Hamilton 1994, section 4.7)
        flat = self.white + self.folded
        lag0 = flat * (1.0 + phi**2) + self.coloured * (1.0 - phi**2)
        lag1 = -flat * phi
        ratio = lag1 / lag0
        theta = 0.0 if ratio == 0.0 else (1.0 - np.sqrt(max(1.0 - 4.0 * ratio**2, 0.0))) / (2.0 * ratio)
        return Whitener(phi=phi, theta=float(theta), sigma=float(np.sqrt(lag0 / (1.0 + theta**2))))


@dataclass(frozen=True)
class Whitener:
    """(1 - phi L) y = sigma (1 + theta L) e: from noise y to white noise e of variance one."""

    phi: float
    theta: float
    sigma: float

    def __call__(self, values: Array) -> Array:
        """Whiten along the last axis; the samples in which the filter still remembers its start become zero."""
        if self.phi == 0.0 and self.theta == 0.0:
            return values / self.sigma
        white = lfilter([1.0 / self.sigma, -self.phi / self.sigma], [1.0, self.theta], values)
        white[..., : self.start] = 0.0
        return np.asarray(white)

    @property
    def start(self) -> int:
        """The first sample whose innovation counts."""
        memory = max(abs(self.theta), 1e-12)
        return 0 if self.phi == 0.0 else 1 + int(np.ceil(np.log(_FORGOTTEN) / np.log(memory)))


@dataclass(frozen=True)
class Held:
    """Readings of one channel at rest: segments (n,), each about a mean of its own, and the interval between samples
    [s]."""

    segments: tuple[Array, ...]
    interval_s: float

    @property
    def count(self) -> int:
        """Degrees of freedom: samples less means."""
        return sum(len(segment) - 1 for segment in self.segments)

    @property
    def shortest(self) -> int:
        """Samples of the shortest segment."""
        return min(len(segment) for segment in self.segments)

    @property
    def variance(self) -> float:
        """About the means of the segments."""
        return sum(float(np.sum((segment - segment.mean()) ** 2)) for segment in self.segments) / self.count

    @cached_property
    def periodogram(self) -> Periodogram:
        """Of its segments."""
        return Periodogram.of(self.segments)

    def rough_loss(self, point: Array) -> float:
        """Minus twice the log likelihood of the periodogram, at a point as in ``loss``; up to a constant."""
        noise = _shaped(point, 1.0, self)
        if noise.whitener(self.interval_s).start > self.shortest // 4:
            return np.inf
        return self.periodogram.loss(noise.coloured, float(np.exp(-self.interval_s / noise.tau_s)))

    def loss(self, point: Array) -> tuple[float, float]:
        """Minus twice the log likelihood at (logit of the coloured share, log of its time), and the variance there."""
        whiten = _shaped(point, 1.0, self).whitener(self.interval_s)
        if whiten.start > self.shortest // 4:  # all but a random walk: a segment is too short to tell
            return np.inf, self.variance
        squares, innovations = 0.0, 0
        for segment in self.segments:
            inside = slice(whiten.start, None)
            centred = segment - segment.mean()
            y, one = whiten(centred)[inside], whiten(np.ones(len(segment)))[inside]
            squares += float(y @ y - (y @ one) ** 2 / np.maximum(one @ one, 1e-300))
            squares += float(
                np.sum(centred[: whiten.start] ** 2)
            )  # before the filter has started, by their own variance
            innovations += len(y) - 1
        scale = squares / self.count
        return float(self.count * np.log(scale) + 2.0 * innovations * np.log(whiten.sigma)), scale

    @property
    def white(self) -> ChannelNoise:
        """All of it white."""
        return ChannelNoise(self.variance, samples=self.count, duration_s=self.count * self.interval_s)

    def at(self, point: Array) -> ChannelNoise:
        """The noise of this shape that is most likely."""
        return _shaped(point, self.loss(point)[1], self)


def held(segments: Sequence[Array], interval_s: float) -> Held:
    """Segments (n,) at rest; those of a single sample tell nothing."""
    return Held(tuple(np.asarray(each, dtype=float) for each in segments if len(each) > 1), interval_s)


def fit_floor(channels: Sequence[Held]) -> list[ChannelNoise]:
    """The most likely noise of each channel: white where the coloured part does not pay for its two parameters.

    Coloured channels of one board share the shape of their spectrum unless the data speak against it: then each keeps
    its own. A shared shape is known better by the number of channels.
    """
    points: dict[int, Array] = {}
    for index, channel in enumerate(channels):
        if channel.variance > 0.0:
            point = _best([channel])
            if channel.count * float(np.log(channel.variance)) - channel.loss(point)[0] >= COLOUR_THRESHOLD:
                points[index] = point
    if len(points) > 1:
        common = _best([channels[index] for index in points])
        lost = sum(channels[index].loss(common)[0] - channels[index].loss(point)[0] for index, point in points.items())
        if lost < chi2.isf(SHARED_AT, 2 * (len(points) - 1)):
            points = dict.fromkeys(points, common)
    sharing = len(points) if len({id(point) for point in points.values()}) < len(points) else 1
    return [
        replace(channel.at(points[index]), sharing=sharing) if index in points else channel.white
        for index, channel in enumerate(channels)
    ]


def _best(channels: Sequence[Held]) -> Array:
    """The shape that is most likely for all these channels."""
    interval = channels[0].interval_s
    longest = max(len(segment) for channel in channels for segment in channel.segments) * interval

    def loss(point: Array) -> float:
        return sum(channel.rough_loss(point) for channel in channels) + _outside(point, interval, longest)

    starts = [(share, np.log(tau)) for share in (-2.0, 0.0, 2.0) for tau in np.geomspace(interval, longest / 10.0, 5)]
    start = np.array(min(starts, key=lambda point: loss(np.array(point))))
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxfev": 200, "initial_simplex": start + _SIMPLEX}
    return np.asarray(minimize(loss, start, method="Nelder-Mead", options=options).x)


def _shaped(point: Array, variance: float, source: Held) -> ChannelNoise:
    share, tau = 1.0 / (1.0 + np.exp(-point[0])), float(np.exp(point[1]))
    duration = source.count * source.interval_s
    return ChannelNoise(variance * (1.0 - share), variance * share, tau, source.count, duration)


def _outside(point: Array, interval_s: float, longest_s: float) -> float:
    """A wall around what segments of this length and rate can tell."""
    low, high = np.log(interval_s / 3.0), np.log(longest_s)
    return float(1e3 * (max(0.0, low - point[1]) + max(0.0, point[1] - high) + max(0.0, abs(point[0]) - 12.0)))
