"""Spectrum and whiteness of a sensor's noise at rest, and the autoregressive model that whitens it.

Records are stretches held still, each about a mean of its own; everything is pooled over them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter, welch
from scipy.special import chdtrc

from estimators._json import AsJson
from rig.arrays import Array
from rig.errors import RigError

#: Samples of a segment of the averaged periodogram, at most; a quarter of the longest record where that is less.
SEGMENT: Final = 4096
#: Lags of the test of whiteness, at most a fifth of the longest record.
LAGS: Final = 20
#: Highest order of an autoregressive model.
HIGHEST_ORDER: Final = 30


@dataclass(frozen=True, eq=False)
class PowerSpectrum:
    """Power spectral density of one channel.

    Attributes:
        frequency_Hz: (f,).
        density: (f,) one-sided [unit^2/Hz]: white noise of N unit/sqrt(Hz) has 2 N^2, and the integral is the variance.
        degrees_of_freedom: about so many of the chi-square that each value scatters by.
    """

    frequency_Hz: Array
    density: Array
    degrees_of_freedom: float

    @property
    def amplitude(self) -> Array:
        """(f,) root of the density [unit/sqrt(Hz)]."""
        return np.sqrt(self.density)


def power_spectrum(records: Sequence[ArrayLike], rate_Hz: float, segment: int | None = None) -> PowerSpectrum:
    """Welch's averaged periodogram: Hann window, half overlapping segments, each about its mean.

    Args:
        records: (n,) each, evenly sampled at rest [unit].
        rate_Hz: of the samples.
        segment: samples of one; None: ``SEGMENT``, or less for short records.

    Raises:
        RigError: no record is as long as a segment of at least 8.
    """
    values = _records(records)
    longest = max(len(record) for record in values)
    length = min(SEGMENT, longest // 4) if segment is None else segment
    used = [record for record in values if len(record) >= length]
    if length < 8 or not used:
        raise RigError(f"spectrum: found at most {longest} samples in a record, expected {max(length, 32)} or more")
    total, averages = np.zeros(length // 2 + 1), 0.0
    frequency = np.empty(0)
    for record in used:
        number = 1 + (len(record) - length) // (length - length // 2)
        frequency, density = welch(record, rate_Hz, window="hann", nperseg=length, detrend="constant")
        total += number * density
        averages += number
    # Neighbouring segments share half their samples: the squared correlation of their periodograms is 1/36.
    freedom = 2.0 * averages / (1.0 + 2.0 / 36.0 * (1.0 - 1.0 / averages))
    return PowerSpectrum(np.asarray(frequency), total / averages, float(freedom))


@dataclass(frozen=True)
class Whiteness(AsJson):
    """The test of Ljung and Box, "On a measure of lack of fit in time series models" (1978).

    Under the null hypothesis, independent samples of one distribution with a variance, the statistic n (n + 2) sum of
    r_l^2 / (n - l) over ``lags`` lags is chi-square with ``degrees_of_freedom`` = lags less fitted coefficients, for n
    large against lags.
    """

    statistic: float
    lags: int
    degrees_of_freedom: int
    p_value: float

    def to_json(self) -> dict[str, Any]:
        """The test's name and its numbers."""
        return {"test": "Ljung-Box", **super().to_json()}


def whiteness(records: Sequence[ArrayLike], lags: int | None = None, fitted: int = 0) -> Whiteness:
    """Test whether noise is white.

    Args:
        records: (n,) each, evenly sampled at rest [unit].
        lags: how many autocorrelations are looked at; None: ``LAGS``, or less for short records.
        fitted: coefficients that were fitted to these records, the order of an autoregression.

    Raises:
        RigError: fewer lags than one more than were fitted, or records shorter than that; or noise of zero.
    """
    values = _records(records)
    longest = max(len(record) for record in values)
    count = max(fitted + 1, min(LAGS + fitted, longest // 5)) if lags is None else lags
    if count <= fitted or count >= longest:
        raise RigError(f"whiteness: found {count} lags, expected more than {fitted} and fewer than {longest}")
    covariance = autocovariance(values, count)
    n = sum(len(record) for record in values)
    pairs = np.array([sum(max(len(record) - lag, 0) for record in values) for lag in range(1, count + 1)], dtype=float)
    correlation = covariance[1:] / covariance[0]
    statistic = float(n * (n + 2.0) * np.sum(correlation**2 / pairs))
    return Whiteness(statistic, count, count - fitted, float(chdtrc(count - fitted, statistic)))


@dataclass(frozen=True, eq=False)
class Autoregression:
    """x_t = sum of a_i x_{t-i} + e_t with e white: noise whose past says something about its next value.

    Attributes:
        coefficients: (p,) a; empty for white noise.
        sigma: standard deviation of e [unit].
    """

    coefficients: Array
    sigma: float

    @property
    def order(self) -> int:
        """p."""
        return len(self.coefficients)

    def whiten(self, values: ArrayLike) -> Array:
        """White noise of variance one (n - p, ..) from noise (n, ..) about zero, along the first axis."""
        table = np.asarray(values, dtype=float)
        filtered = lfilter(np.concatenate([[1.0], -self.coefficients]), [1.0], table, axis=0)
        return np.asarray(filtered[self.order :] / self.sigma)

    def density(self, frequency_Hz: ArrayLike, rate_Hz: float) -> Array:
        """One-sided power spectral density at frequencies (f,) [unit^2/Hz]."""
        turn = np.exp(
            -2j * np.pi * np.outer(np.asarray(frequency_Hz, dtype=float) / rate_Hz, np.arange(1, self.order + 1))
        )
        return np.asarray(2.0 * self.sigma**2 / rate_Hz / np.abs(1.0 - turn @ self.coefficients) ** 2)

    def to_json(self) -> dict[str, Any]:
        """Order, coefficients and the standard deviation of the innovations."""
        return {"order": self.order, "coefficients": self.coefficients.tolist(), "sigma": self.sigma}


def autoregression(
    records: Sequence[ArrayLike],
    order: int | None = None,
    highest: int = HIGHEST_ORDER,
    method: Literal["yule-walker", "burg"] = "yule-walker",
) -> Autoregression:
    """The autoregressive model of noise; always stationary.

    The equations of Yule and Walker have a bias of order p/n, which plays no part in thousands of samples where no band
    is empty: into one that a filter has emptied their autocovariances leak. By Burg's method it stays empty (Kay and
    Marple, Proceedings of the IEEE 69, 1981), its sums here over all records.

    Args:
        records: (n,) each, evenly sampled at rest [unit].
        order: p; None: the one up to ``highest`` with the lowest Bayesian information criterion.
        method: "yule-walker" or "burg".

    Raises:
        RigError: no record is longer than the order, or noise of zero.
    """
    values = _records(records)
    longest = max(len(record) for record in values)
    most = min(highest, longest // 10) if order is None else order
    if not 0 <= most < longest:
        raise RigError(f"autoregression: found order {most}, expected 0 or more, and fewer than {longest} samples")
    n = sum(len(record) for record in values)
    orders = range(most + 1) if order is None else (order,)
    if method == "burg":
        fits = [fit for p, fit in enumerate(_burg(values, most)) if p in orders]
    else:
        covariance = autocovariance(values, most)
        fits = [_yule_walker(covariance, p) for p in orders]
    costs = [n * np.log(variance) + p * np.log(n) for p, (_, variance) in zip(orders, fits, strict=True)]
    coefficients, variance = fits[int(np.argmin(costs))]
    return Autoregression(coefficients, float(np.sqrt(variance)))


def _yule_walker(covariance: Array, order: int) -> tuple[Array, float]:
    if order == 0:
        return np.empty(0), float(covariance[0])
    coefficients = np.asarray(solve_toeplitz(covariance[:order], covariance[1 : order + 1]))
    return coefficients, float(covariance[0] - coefficients @ covariance[1 : order + 1])


def _burg(records: Sequence[Array], most: int) -> Iterator[tuple[Array, float]]:
    """The coefficients and the variance of what they do not predict, of every order up to the largest."""
    forward = np.concatenate([record - record.mean() for record in records])
    backward, place = forward, np.concatenate([np.arange(len(record)) for record in records])
    coefficients, variance = np.empty(0), float(np.mean(forward**2))
    if not variance > 0.0:
        raise _constant()
    count = len(forward)
    yield coefficients, variance
    for order in range(1, most + 1):
        forward, backward, place = forward[1:], backward[:-1], place[1:]
        there = place >= order  # both are of one record
        both = 0.5 * float(np.mean((forward**2 + backward**2)[there]))
        reflection = float(np.mean((forward * backward)[there])) / both if both > 0.0 else 0.0
        forward, backward = forward - reflection * backward, backward - reflection * forward
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1.0 - reflection**2
        left = max(count - len(records) - order, 1)  # degrees of freedom, less the means and the coefficients
        yield coefficients, max(variance * count / left, 1e-300)


def _constant() -> RigError:
    return RigError("noise: every record is constant, expected readings that scatter")


def autocovariance(records: Sequence[ArrayLike], lags: int) -> Array:
    """(lags + 1,) pooled over records, each about its mean; sums are divided by n whatever the lag [unit^2].

    Raises:
        RigError: noise of zero.
    """
    total, count = np.zeros(lags + 1), 0
    for record in _records(records):
        centred = record - record.mean()
        size = next_fast_len(len(centred) + lags, real=True)
        products = irfft(np.square(np.abs(rfft(centred, size))), size)[: lags + 1]
        total += products
        count += len(centred)
    if not total[0] > 0.0:
        raise _constant()
    return np.asarray(total / count)


def _records(records: Sequence[ArrayLike]) -> list[Array]:
    values = [np.asarray(record, dtype=float) for record in records]
    if not values or min(len(record) for record in values) < 2:
        raise RigError("noise: found no record, or one of fewer than two samples")
    return values
