"""Noise at rest of another spectrum than one that falls: a resonance, or neighbours that are unlike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log
from typing import Final

import numpy as np
from scipy.signal import lfilter

from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.noise.spectrum import autoregression
from rig.arrays import Array

#: Share of the sweep's interval that a number of intervals at rest may miss it by.
_OFF: Final = 0.02
#: Highest order of its autoregression, and lags over which its autocovariance is kept.
_HIGHEST, _LAGS = 120, 256
#: Samples of a pose at rest, at least, and series of samples as far apart as those of the sweep, at most.
_SHORTEST, _SERIES = 20, 4
#: Floors whose spectrum falls for each other one: noise of electronics does (Keshner, "1/f noise", Proceedings of the
#: IEEE 70, 1982).
_RARE: Final = 20.0


def resonant(segments: Sequence[Array], rate_Hz: float, interval_s: float, known: ChannelNoise) -> ChannelNoise:
    """A channel's noise as an autoregression, where readings at rest speak for one against a spectrum that falls; else
    as it is known.

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
    found = autoregression([segment for each in series for segment in each], highest=_HIGHEST)
    if not found.order:
        return known
    lags = _autocovariance(found.coefficients, found.sigma)
    noise = replace(
        known, white=float(lags[0]), parts=(), folded=0.0, spare=False, lags=tuple(lags.tolist()), every_s=interval_s
    )
    gains = [_log_likelihood(noise, each, interval_s) - _log_likelihood(known, each, interval_s) for each in series]
    more = max(found.order - 2 * len(known.seen), 0) + 2  # parts that hardly pay are no reason for other noise
    if np.mean(gains) < 0.5 * more * np.log(sum(map(len, series[0]))) + log(_RARE):
        return known
    told = 2.0 * float(np.sum((lags / lags[0]) ** 2)) - 1.0  # samples that tell as much as one of white noise
    return replace(noise, samples=max(int(known.samples / told), 2))


def _autocovariance(coefficients: Array, sigma: float) -> Array:
    """(lags,) of an autoregression, by its response to impulses."""
    impulse = np.zeros(8 * _LAGS)
    impulse[0] = sigma
    response = lfilter([1.0], np.concatenate([[1.0], -coefficients]), impulse)
    return np.array([float(response[lag:] @ response[: len(response) - lag]) for lag in range(_LAGS)])


def _log_likelihood(noise: ChannelNoise, segments: Sequence[Array], interval_s: float) -> float:
    """Up to a constant, the mean of each segment integrated out (Harville, Biometrika 61, 1974): of slow parts most is
    in these."""
    whiten, found = noise.whitener(interval_s), 0.0
    for segment in segments:
        y, one = whiten(np.stack([segment, np.ones(len(segment))]))
        known = float(one @ one)
        found -= 0.5 * (float(y @ y) - float(y @ one) ** 2 / known + log(known)) + whiten.log_scale(len(segment))
    return found
