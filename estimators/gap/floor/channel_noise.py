"""A channel's noise: white plus first-order Gauss-Markov parts, at any sampling, and the filter that whitens it.

White noise plus an exponentially correlated part is the two-term model behind an Allan deviation's slope and hump
(IEEE Std 952, annex C); further, slower parts follow a spectrum that falls less steeply. Sampled at any rate the sum
is an autoregressive moving average, so what a locked recording at one rate teaches holds at the sweep's rate: the model
carries autocovariances over, never filter coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_toeplitz, solve_triangular, toeplitz
from scipy.signal import lfilter

from estimators.gap.floor.unsteady import Unsteady
from rig.arrays import Array
from rig.effects._numerics import exponential_spectrum

#: The filter has forgotten its start once its memory is below this share.
_FORGOTTEN = 0.01
#: Correlation between neighbouring means below which a part looks white.
_TOLD = 1e-6
#: What is left of a part from mean to mean below which its second neighbours may be this much alike.
_DECAYED = 1e-5
#: Samples from which an autoregression predicts the next one, at most: of a band that is missing, seconds tell.
_PREDICTED = 120
#: Frequencies of a spectrum that samples are predicted by; no less than this share of the variance is at any.
_GRID, _LEAST = 2048, 1e-3
#: Share by which a sample tells of the next one that is nothing.
_UNTOLD = 1e-6
#: So many samples at most are predicted exactly.
_LONGEST = 512
#: A part as slow as this share of the time for which a pose was held shows at rest how its spectrum falls, but hardly
#: from where: it may be so many times slower, and larger; two standard deviations of what is believed of its time.
_LONG, _SLOWER = 0.5, 55.0


@dataclass(frozen=True)
class ChannelNoise:
    """A channel's noise.

    Attributes:
        white: variance of the white part [V^2].
        parts: variance [V^2] and correlation time [s] of each exponentially correlated part; none for white noise.
        samples: how many samples it was learned from.
        duration_s: how long these lasted [s].
        holds: in how many poses, each about a mean of its own.
        spare: whether the last part was not seen there, and is only not excluded.
        folded: of the coloured parts, what means over blocks of samples make look white [V^2]; may be below zero.
        degrees: of Student's distribution where single readings have long tails, infinite where they are normal; None
            where no recording at rest tells.
        tails: variance of the tails that readings are relieved of, beyond the rest of it [V^2].
        spread: how many times the variance of its level, as readings at rest show it, is that of normal noise.
        unsteady: how its level changes in time; None where it is steady.
        tones_Hz: of tones at rest, without which it was learned.
        hums: frequency [Hz] and amplitude [V] of those that no effect of the catalogue makes: they are noise.
        lags: autocovariance [V^2] of noise whose spectrum does not fall, of none to ever more intervals; empty where it
            does. white: then its variance. every_s: such an interval [s].
        shared: correlation with the noise of each channel, as far as neighbouring readings show; empty where none is.
        shared_slow: the same of the coloured parts.
    """

    white: float
    parts: tuple[tuple[float, float], ...] = ()
    samples: int = 0
    duration_s: float = 0.0
    folded: float = 0.0
    holds: int = 1
    spare: bool = False
    degrees: float | None = np.inf
    tails: float = 0.0
    spread: float = 1.0
    unsteady: Unsteady | None = None
    tones_Hz: tuple[float, ...] = ()
    hums: tuple[tuple[float, float], ...] = ()
    lags: tuple[float, ...] = ()
    every_s: float = 0.0
    shared: tuple[float, ...] = ()
    shared_slow: tuple[float, ...] = ()

    @property
    def relieved(self) -> bool:
        """Whether readings are relieved of its long tails: those of louder times go with these."""
        return (self.degrees is None or np.isfinite(self.degrees)) and not (self.unsteady and self.unsteady.normal)

    @property
    def coloured(self) -> float:
        """Variance of all coloured parts [V^2]."""
        return sum(size for size, _ in self.parts)

    @property
    def slow(self) -> tuple[bool, ...]:
        """Of each coloured part, whether it was seen, but is as slow as a pose was held."""
        long_s = _LONG * self.duration_s / self.holds
        return tuple(index < len(self.seen) and tau_s >= long_s > 0.0 for index, (_, tau_s) in enumerate(self.parts))

    @property
    def from_anywhere(self) -> ChannelNoise:
        """The same noise, but for the level that slow parts are about: that may be any."""
        if not any(self.slow):
            return self
        grown = [_SLOWER if slow else 1.0 for slow in self.slow]
        parts = zip(grown, self.parts, strict=True)
        return replace(self, parts=tuple((times * size, times * tau_s) for times, (size, tau_s) in parts))

    @property
    def seen(self) -> tuple[tuple[float, float], ...]:
        """The coloured parts that were seen."""
        return self.parts[:-1] if self.spare else self.parts

    def samples_at(self, interval_s: float) -> float:
        """How many samples at another rate tell as much of the noise as those it was learned from.

        Of white noise every sample tells alike; of coloured noise only what lies within the other rate's band.
        """
        return min(float(self.samples), self.duration_s / interval_s) if self.parts else float(self.samples)

    def told(self, judged: int) -> float:
        """What a sample tells of the level, as a share of what one of steady normal noise does: long tails tell less,
        and a level that changes, where the floor is learned and in so many readings that are judged by it."""
        spread = self.spread
        if self.unsteady is not None:
            spread += 0.5 * self.samples * self.unsteady.unsure**2
        return 1.0 / (spread + (spread - 1.0) * self.samples / max(judged, 1))

    def shortened(self, share: float) -> ChannelNoise:
        """As known as by this share of the recording that it was learned from."""
        if share >= 1.0:
            return self
        return replace(self, samples=max(int(share * self.samples), 2), duration_s=share * self.duration_s)

    @property
    def variance(self) -> float:
        """[V^2]."""
        return self.white + self.folded + self.coloured

    def autocovariance(self, lag_s: Array) -> Array:
        """[V^2] at lags [s]; of noise whose spectrum does not fall at intervals of its own."""
        lag = np.abs(np.asarray(lag_s, dtype=float))
        coloured = sum((size * np.exp(-lag / tau_s) for size, tau_s in self.parts), start=np.zeros_like(lag))
        if self.lags:
            known = np.append(self.lags, 0.0)
            return np.asarray(coloured + known[np.minimum(np.rint(lag / self.every_s).astype(int), len(self.lags))])
        return np.asarray(coloured + np.where(lag == 0.0, self.white + self.folded, 0.0))

    def uncoloured(self, frequency_Hz: Array) -> Array:
        """[V^2] the spectrum of all but the coloured parts at frequencies (m,); of white noise its variance."""
        if not self.lags:
            return np.full_like(frequency_Hz, self.white)
        turns = np.outer(frequency_Hz * self.every_s, 2.0 * np.pi * np.arange(1, len(self.lags)))
        return np.maximum(self.lags[0] + 2.0 * np.cos(turns) @ self.lags[1:], _LEAST * self.lags[0])

    def averaged(self, block: int, interval_s: float) -> ChannelNoise:
        """The noise of means over blocks of so many samples.

        Means of an exponentially correlated process keep its correlation from block to block; what their variance has
        beyond that of such a process, or lacks, looks white.
        """
        folded, parts = self.folded / block, []
        for size, tau_s in self.parts:
            decay = float(np.exp(-interval_s / tau_s))
            lags = np.arange(1, block)
            own = size * (block + 2.0 * float(np.sum((block - lags) * decay**lags))) / block**2
            next_one = size * decay * float(np.sum(decay ** np.arange(block))) ** 2 / block**2
            if (kept := decay**block) < _DECAYED:
                kept, tau_s = _DECAYED, block * interval_s / float(-np.log(_DECAYED))
            parts.append((max(next_one / kept, _TOLD * own), tau_s))
            folded += own - parts[-1][0]
        if self.lags:
            return self._of_means(block, folded, tuple(parts))
        return replace(self, white=self.white / block, folded=folded, parts=tuple(parts))

    def _of_means(self, block: int, folded: float, parts: tuple[tuple[float, float], ...]) -> ChannelNoise:
        """The same, of noise whose spectrum does not fall, with what its coloured parts are in means."""
        apart = np.arange(1 - block, block)
        each = (block - np.abs(apart)) / block**2
        known = np.array(self.lags)
        first = block * np.arange((len(known) - block) // block + 1)
        lags = np.array([float(each @ known[np.abs(start + apart)]) for start in first if start + block <= len(known)])
        lags[0] += folded
        every_s = block * self.every_s
        return replace(self, white=float(lags[0]), parts=parts, lags=tuple(lags.tolist()), every_s=every_s)

    def scaled(self, factor: float) -> ChannelNoise:
        """With so many times the variance of the white part."""
        return replace(self, white=factor * self.white, lags=tuple(factor * lag for lag in self.lags))

    def whitener(self, interval_s: float) -> Whitener:
        """The filter that turns this noise, sampled every ``interval_s`` [s], into white noise of variance one."""
        return _whitener(self, interval_s)


@lru_cache(maxsize=128)
def _whitener(noise: ChannelNoise, interval_s: float) -> Whitener:
    """The autoregressive polynomial is the product of the parts' own; the moving average is the spectral factor of what
    is left, the one with its roots outside the unit circle (Box and Jenkins 1976, section A4.1).

    Both as polynomials of w = (1 - z)(1 - 1/z), as (1 - d z)(1 - d/z) = (1 - d)^2 + d w: nothing cancels in these,
    however slow a part is.
    """
    if noise.lags:
        return _autoregressive(noise, interval_s)
    forgotten = [float(-np.expm1(-interval_s / tau_s)) for _, tau_s in noise.parts]
    factors = [np.array([1.0 - each, each**2]) for each in forgotten]
    left = (noise.white + noise.folded) * _product(factors)
    for index, ((size, _), each) in enumerate(zip(noise.parts, forgotten, strict=True)):
        others = _product(factors[:index] + factors[index + 1 :])
        left = left + size * each * (2.0 - each) * np.pad(others, (1, 0))
    left = left[np.argmax(np.abs(left) > 1e-15 * np.abs(left).max()) :]  # without white noise it is of one degree less
    beyond = -np.roots(left).astype(complex)
    middle, apart = 1.0 + beyond / 2.0, np.sqrt(beyond * (1.0 + beyond / 4.0))
    inside = 1.0 / np.where(np.abs(middle + apart) > np.abs(middle - apart), middle + apart, middle - apart)
    ar = np.real(_expanded([1.0 - each for each in forgotten]))
    sigma = float(np.sqrt(left[0] / np.real(np.prod(inside))))
    return Whitener(tuple(map(float, ar)), tuple(map(float, np.real(_expanded(inside)))), sigma, noise, interval_s)


def _autoregressive(noise: ChannelNoise, interval_s: float) -> Whitener:
    """What samples before a one tell of it (Yule and Walker's equations), once the coloured parts are whitened."""
    known, slow = np.array(noise.lags), Whitener((1.0,), (1.0,), 1.0, noise, interval_s)
    if noise.parts:
        level = float(noise.uncoloured(np.zeros(1))[0])
        slow = _whitener(replace(noise, white=level, folded=0.0, lags=()), interval_s)
        frequency = np.arange(_GRID + 1) / (2.0 * _GRID)
        spectrum = noise.uncoloured(frequency / interval_s) + sum(
            size * exponential_spectrum(frequency, interval_s, tau_s) for size, tau_s in noise.parts
        )
        known = np.fft.irfft(spectrum * slow.response(frequency))[: len(known)]
    order = min(len(known) - 1, _PREDICTED)
    before = solve_toeplitz(known[:order], known[1 : order + 1]) if order else np.empty(0)
    sigma = float(np.sqrt(known[0] - before @ known[1 : order + 1]))
    told = np.flatnonzero(np.abs(before) > _UNTOLD).max(initial=-1) + 1
    ar = np.convolve(slow.ar, [1.0, *-before[:told]])
    return Whitener(tuple(map(float, ar)), slow.ma, slow.sigma * sigma, noise, interval_s)


def _product(polynomials: list[Array]) -> Array:
    return reduce(np.convolve, polynomials, np.ones(1))


def _expanded(roots: Sequence[float] | Array) -> NDArray[np.complex128]:
    """The coefficients of (1 - r1 L)(1 - r2 L)..."""
    return np.asarray(
        reduce(np.convolve, [np.array([1.0, -root], dtype=complex) for root in roots], np.ones(1, complex))
    )


@dataclass(frozen=True)
class Whitener:
    """ar(L) y = sigma ma(L) e: from noise y to white noise e of variance one; L is the lag.

    Attributes:
        ar, ma: coefficients of 1, L, L^2.
        sigma: [V].
        noise, interval_s: what is whitened, and the interval between samples [s].
    """

    ar: tuple[float, ...]
    ma: tuple[float, ...]
    sigma: float
    noise: ChannelNoise
    interval_s: float

    @property
    def white(self) -> bool:
        """Whether it only scales."""
        return len(self.ar) == 1

    def __call__(self, values: Array) -> Array:
        """Whiten along the last axis; while the filter remembers its start, by the exact errors of prediction."""
        if self.white:
            return values / self.sigma
        white = lfilter(np.array(self.ar) / self.sigma, self.ma, values)
        first = min(len(self._first), values.shape[-1])
        white[..., :first] = values[..., :first] @ self._first[:first, :first].T
        return np.asarray(white)

    def from_rest(self, values: Array) -> Array:
        """The same of what was nothing before."""
        return np.asarray(lfilter(np.array(self.ar) / self.sigma, self.ma, values))

    def log_scale(self, count: int) -> float:
        """The logarithm of the determinant of what turns so many samples of white noise into this noise."""
        first = min(len(self._first), count)
        return float((count - first) * np.log(self.sigma) - np.sum(np.log(np.diag(self._first)[:first])))

    @cached_property
    def _first(self) -> Array:
        """(m, m) the inverse of the Cholesky factor of the first samples' covariance: its rows predict each sample
        from those before it, and the first from nothing, as far as that is known."""
        lags: Array = self.interval_s * np.arange(float(min(self.start, _LONGEST)))
        covariance = self.noise.from_anywhere.autocovariance(lags)
        factor = cholesky(toeplitz(covariance), lower=True) if len(lags) else np.zeros((0, 0))
        return np.asarray(solve_triangular(factor, np.eye(len(lags)), lower=True))

    def response(self, frequency: Array) -> Array:
        """What it does to a spectrum at frequencies [cycles a sample]."""
        lag = np.exp(-2j * np.pi * frequency)
        gain = np.abs(np.polyval(self.ar[::-1], lag) / np.polyval(self.ma[::-1], lag))
        return np.asarray((gain / self.sigma) ** 2)

    @property
    def start(self) -> int:
        """The first sample at which the filter has forgotten its start."""
        if self.white:
            return 0
        memory = max(np.abs(np.roots(self.ma)), default=0.0) if len(self.ma) > 1 else 0.0
        return len(self.ar) - 1 + int(np.ceil(np.log(_FORGOTTEN) / np.log(np.clip(memory, 1e-12, 1.0 - 1e-12))))


def sigmas(whiteners: Sequence[Whitener]) -> Array:
    """(c,) standard deviations of the white noise that channels' floors are made of [recorded unit]."""
    return np.array([whitener.sigma for whitener in whiteners])
