"""What Allan variances of given noises are, and how they scatter: expectation and covariance under a spectrum.

Everything here is per sample: frequency in cycles per sample, the noise by four coefficients

    S(f) = 4 q sin^2(pi f) + s + b / (2 sin(pi f)) + k / (4 sin^2(pi f)),

of differenced rounding, white noise, flicker (fractional differencing of order one half, which is b / (2 pi f) well
below the sampling rate) and random walk. A difference of neighbouring means of m samples over sqrt(2) is the noise
through

    |H(f)|^2 = 2 sin^4(pi f m) / (m sin(pi f))^2,

its mean square is the Allan variance, and for Gaussian noise the mean square of M overlapping ones has the variance
2 / M^2 sum over lags l of (M - |l|) c(l)^2 with c their autocovariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from scipy.fft import dct, next_fast_len

from rig.arrays import Array, Rows
from rig.threads import one_blas_thread

#: Autocovariances are summed up to this many times m; beyond 2 m only flicker has any, falling with the square.
_LAGS = 8
#: Fewest frequencies.
_SMALLEST = 1024
_NOISES = 4


@dataclass(frozen=True, eq=False)
class AllanModel:
    """The statistics of pooled Allan variances at averages m of the four noises.

    Attributes:
        variances: (k, 4) the Allan variance for each coefficient being one.
        spread: (k, 4, 4) such that c . spread . c is the variance of an Allan variance for coefficients c.
        overlap: (4, 4, k, k) integrals of |H_i|^2 |H_j|^2 S_a S_b, for the correlation between averages.
    """

    variances: Array
    spread: Array
    overlap: Array

    def covariance(self, coefficients: Array) -> Array:
        """(k, k) of the measured Allan variances for noise of coefficients (4,)."""
        c = np.asarray(coefficients, dtype=float)
        variance = np.einsum("a,b,iab->i", c, c, self.spread)
        mixed = np.einsum("a,b,abij->ij", c, c, self.overlap)
        size = np.sqrt(np.maximum(mixed.diagonal(), 1e-300))
        std = np.sqrt(variance)
        return np.asarray(mixed / np.outer(size, size) * np.outer(std, std))


@cache
def allan_model(samples: tuple[int, ...], averaged: tuple[int, ...]) -> AllanModel:
    """For records of so many samples and averages m.

    Args:
        samples: (s,) of each record.
        averaged: (k,) m; each at most a third of the longest record.
    """
    k = len(averaged)
    longest = max(samples)
    variances, spread = np.empty((k, _NOISES)), np.empty((k, _NOISES, _NOISES))
    for i, m in enumerate(averaged):
        frequency = _grid(min((longest + 1) // 2, max(_LAGS * m, _SMALLEST)))
        # A sum of cosines over frequencies half a step off zero is a discrete cosine transform.
        autocovariance = dct(_passed(frequency, m) * _spectra(frequency), type=2) / (2.0 * len(frequency))
        variances[i] = autocovariance[:, 0]
        differences = np.array([max(n - 2 * m + 1, 0) for n in samples])
        spread[i] = _spread(autocovariance[:, : _LAGS * m], differences)
    frequency = _grid((longest + 1) // 2)
    passed, spectra = np.stack([_passed(frequency, m) for m in averaged]), _spectra(frequency)
    overlap = np.empty((_NOISES, _NOISES, k, k))
    with one_blas_thread():
        for a, b in combinations_with_replacement(range(_NOISES), 2):
            overlap[a, b] = overlap[b, a] = (passed * (spectra[a] * spectra[b])) @ passed.T
    return AllanModel(variances, spread, overlap)


def _grid(count: int) -> Array:
    """At least so many frequencies, half a step off zero, where the random walk's spectrum is infinite."""
    size = next_fast_len(count, real=True)
    return np.asarray((np.arange(size) + 0.5) / (2.0 * size))


def _passed(frequency: Array, m: int) -> Array:
    """|H|^2."""
    wave = np.square(np.sin(np.pi * m * frequency))
    return np.asarray(2.0 * np.square(wave / (m * np.sin(np.pi * frequency))))


def _spectra(frequency: Array) -> Array:
    """(4, f) of the four noises, each of coefficient one."""
    sine = np.sin(np.pi * frequency)
    square = sine * sine
    return np.stack([4.0 * square, np.ones_like(sine), 0.5 / sine, 0.25 / square])


def _spread(autocovariance: Array, differences: Rows) -> Array:
    """(4, 4) 2 / M^2 sum of (M_s - |l|) c_a(l) c_b(l) over lags and records; M all differences together."""
    lags = autocovariance.shape[1]
    number = np.arange(lags)
    result = np.empty((_NOISES, _NOISES))
    last = np.minimum(differences, lags) - 1
    used = differences > 0
    for a, b in combinations_with_replacement(range(_NOISES), 2):
        product = autocovariance[a] * autocovariance[b]
        product[1:] *= 2.0  # both signs of the lag
        plain, weighted = np.cumsum(product), np.cumsum(product * number)
        total = (differences * plain[last] - weighted[last])[used].sum()
        result[a, b] = result[b, a] = 2.0 * total / float(differences.sum()) ** 2
    return result
