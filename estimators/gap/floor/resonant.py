"""Noise at rest of another spectrum than one that falls: a resonance, or neighbours that are unlike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log
from typing import Final

import numpy as np

from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.noise.spectrum import Autoregression, autoregression
from rig.arrays import Array
from rig.effects._numerics import exponential_spectrum

#: Share of the sweep's interval that a number of intervals at rest may miss it by.
_OFF: Final = 0.02
#: Highest order of its autoregression, and lags over which its autocovariance is kept.
_HIGHEST, _LAGS = 120, 256
#: So many intervals a part lasts, at least, that an autoregression is beside.
_SLOW: Final = 10.0
#: Frequencies of its spectrum.
_GRID: Final = 4096
#: Samples of a pose at rest, at least, and series of samples as far apart as those of the sweep, at most.
_SHORTEST, _SERIES = 20, 4
#: Of an autoregression: on the safe side, as it leaks into an empty band; and with such a band as empty as it is.
_METHODS: Final = ("yule-walker", "burg")
#: Floors whose spectrum falls for each other one: noise of electronics does (Keshner, "1/f noise", Proceedings of the
#: IEEE 70, 1982).
_RARE: Final = 20.0


def resonant(segments: Sequence[Array], rate_Hz: float, interval_s: float, known: ChannelNoise) -> ChannelNoise:
    """A channel's noise as an autoregression, by itself or of what a spectrum that falls leaves, where readings at rest
    speak for one against that spectrum; else as it is known.

    The Bayesian information criterion tells (Schwarz, Annals of Statistics 6, 1978), with one part more against it:
    slow parts, which go on below what is seen, are none of an autoregression's. Readings that are taken less often at
    rest than in the sweep do not tell.

    Args:
        segments: (n,) readings, one a pose. rate_Hz: of these. interval_s: between samples of the sweep.
        known: white and exponentially correlated parts.
    """
    stride = round(interval_s * rate_Hz)
    if stride < 1 or abs(stride / (interval_s * rate_Hz) - 1.0) > _OFF:
        return known
    series = [
        [
            segment[first::stride] - segment[first::stride].mean()
            for segment in segments
            if len(segment) > first + stride
        ]
        for first in range(min(stride, _SERIES))
    ]
    if not series[0] or max(map(len, series[0])) < _SHORTEST:
        return known
    before = [_log_likelihood(known, each, interval_s) for each in series]
    slow = [part for part in known.parts if part[1] > _SLOW * interval_s]
    fast = known.variance - sum(size for size, _ in slow)
    best, likeliest = log(_RARE), known
    for base in (
        replace(known, white=1.0, parts=(), folded=0.0, spare=False),
        replace(known, white=fast, parts=tuple(slow), folded=0.0),
    )[: 1 + any(part in slow for part in known.seen)]:
        whiten = base.whitener(interval_s)
        white = [whiten(segment) for each in series for segment in each]
        for method in _METHODS:
            found = autoregression(white, highest=_HIGHEST, method=method)
            if not found.order:
                continue
            noise = _times(base, found, interval_s)
            try:
                gains = [
                    _log_likelihood(noise, each, interval_s) - own for each, own in zip(series, before, strict=True)
                ]
            except np.linalg.LinAlgError:  # of what lasts for longer, lags that are cut off are no autocovariance
                continue
            # parts that hardly pay are no reason for other noise
            more = max(found.order - 2 * (len(known.seen) - len(base.seen)), 0) + 2
            cost = 0.5 * more * log(sum(map(len, series[0])))
            gained = float(np.mean(gains)) - cost
            # twice as much for what is not on the safe side
            if gained - (cost if method == "burg" else 0.0) >= best:
                best, likeliest = gained, noise
    if likeliest is known:
        return known
    lags = np.array(likeliest.lags)
    told = 2.0 * float(np.sum((lags / lags[0]) ** 2)) - 1.0  # samples that tell as much as one of white noise
    return replace(likeliest, samples=max(int(known.samples / told), 2))


def _times(slow: ChannelNoise, fast: Autoregression, interval_s: float) -> ChannelNoise:
    """Noise of the spectrum of one times that of an autoregression: the slow parts of the first, as the second leaves
    what is slowest, and an autocovariance of the rest."""
    frequency = np.arange(_GRID + 1) / (2.0 * _GRID)
    lag = np.exp(-2j * np.pi * frequency)
    factor = (fast.sigma / np.abs(1.0 - lag * np.polyval(fast.coefficients[::-1], lag))) ** 2
    spectrum = (slow.white + slow.folded) * factor
    for size, tau_s in slow.parts:
        spectrum = spectrum + size * exponential_spectrum(frequency, interval_s, tau_s) * (factor - factor[0])
    lags = np.fft.irfft(spectrum)[:_LAGS]
    parts = tuple((size * float(factor[0]), tau_s) for size, tau_s in slow.parts)
    every = tuple(lags.tolist())
    return replace(slow, white=every[0], parts=parts, folded=0.0, lags=every, every_s=interval_s)


def _log_likelihood(noise: ChannelNoise, segments: Sequence[Array], interval_s: float) -> float:
    """Up to a constant, the mean of each segment integrated out (Harville, Biometrika 61, 1974): of slow parts most is
    in these."""
    whiten, found = noise.whitener(interval_s), 0.0
    for segment in segments:
        y, one = whiten(np.stack([segment, np.ones(len(segment))]))
        known = float(one @ one)
        found -= 0.5 * (float(y @ y) - float(y @ one) ** 2 / known + log(known)) + whiten.log_scale(len(segment))
    return found
