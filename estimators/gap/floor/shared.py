"""Noise that channels share at rest: a reference, a supply or a ground that wanders from reading to reading."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.fft import dct
from scipy.special import ndtri

from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.learned import parts
from estimators.gap.floor.normal_scores import normal_scores
from rig.arrays import Array, Rows

#: Independent steps in each step between neighbouring readings: neighbours share a reading.
_INDEPENDENT: Final = 2.0 / 3.0
#: Bands, as wide as each other, in each of which noise that is shared from reading to reading is.
_BANDS: Final = 4
#: Standard deviations beyond which a reading at rest is no noise.
_FARTHEST: Final = 5.0


def correlations(readings: Array, labels: Rows) -> Array:
    """(6, 6) correlation of the channels' noise; the identity where readings at rest show none.

    Of the normal scores of the steps between neighbouring readings: nothing slow is in these, and spikes count little.
    Correlated or not are two models, of which the Bayesian information criterion tells (Schwarz, Annals of Statistics
    6, 1978). What channels share at some frequencies alone is no noise from reading to reading.

    Args:
        readings: (n, 6) [recorded unit]; NaN where a sensor was not recorded. labels: (n,) number of the pose at rest,
            -1 where the arm moves.
    """
    found = np.eye(readings.shape[1])
    same = (labels[1:] == labels[:-1]) & (labels[1:] >= 0)
    steps = np.diff(readings, axis=0)[same]
    there = np.flatnonzero(np.isfinite(steps).any(axis=0))
    steps = steps[np.isfinite(steps[:, there]).all(axis=1)][:, there]
    if len(steps) <= len(there):
        return found
    there, steps = there[np.ptp(steps, axis=0) > 0.0], steps[:, np.ptp(steps, axis=0) > 0.0]
    if len(there) < 2:
        return found
    independent = _INDEPENDENT * len(steps)
    own = np.asarray(np.corrcoef(normal_scores(steps), rowvar=False))
    own += (np.eye(len(own)) - own) / independent  # channels that are the same here need not be so elsewhere
    gained = -0.5 * independent * float(np.linalg.slogdet(own)[1])
    least = 0.25 * len(there) * (len(there) - 1) * np.log(independent)
    if gained > least and _in_every_band(readings[:, there], labels, own):
        found[np.ix_(there, there)] = own
    return found


def _in_every_band(readings: Array, labels: Rows, correlation: Array) -> bool:
    """Whether a correlation (c, c) of the channels (n, c) is likelier than none in each band of frequencies."""
    inverse, log_det = np.linalg.inv(correlation), float(np.linalg.slogdet(correlation)[1])
    squares = np.zeros((_BANDS, len(correlation), len(correlation)))
    for label in np.unique(labels[labels >= 0]):
        own = readings[labels == label]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own) <= _BANDS:
            continue
        for band, waves in enumerate(np.array_split(dct(normal_scores(own), axis=0)[1:], _BANDS)):
            squares[band] += waves.T @ waves
    size = np.sqrt(np.maximum(np.einsum("bii->bi", squares), 1e-300))
    alike = squares / (size[:, :, None] * size[:, None, :])
    return bool((log_det + np.einsum("ij,bij->b", inverse, alike) < len(correlation)).all())


def slow_correlations(
    readings: Array, labels: Rows, noises: Mapping[int, ChannelNoise], interval_s: float, neighbours: Array
) -> Array:
    """(6, 6) correlation of the channels' coloured parts; the identity where readings at rest show none.

    Of the cosine coefficients of each pose, as shares of the channels' spectra, those weigh most that are coloured.

    Args:
        readings, labels: as of ``correlations``. noises: of channels, as they were learned at rest.
        interval_s: between readings. neighbours: (6, 6) as ``correlations`` tells.
    """
    found = np.eye(readings.shape[1])
    there = [column for column, noise in noises.items() if noise.seen and not noise.lags]
    if len(there) < 2:
        return found
    waves, shares = [], []
    for label in np.unique(labels[labels >= 0]):
        own = readings[labels == label][:, there]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own) <= _BANDS:
            continue
        frequency = np.arange(1.0, len(own)) / (2.0 * len(own))
        share, total = np.stack([_coloured(noises[column], frequency, interval_s) for column in there], axis=2)
        waves.append(dct(_without_knocks(own), axis=0, norm="ortho")[1:] / np.sqrt(total))
        shares.append(share)
    if not waves:
        return found
    share, wave = np.concatenate(shares), np.concatenate(waves)
    wave /= np.sqrt(np.mean(wave**2, axis=0))  # what was left of knocks is less than there was
    coloured, mixed = wave * np.sqrt(share), np.sqrt(share * (1.0 - share))
    weights = share.T @ share
    own = (coloured.T @ coloured - neighbours[np.ix_(there, there)] * (mixed.T @ mixed)) / np.maximum(weights, 1e-300)
    np.fill_diagonal(own, 1.0)
    independent = float(weights[np.triu_indices(len(there), 1)].mean())
    if independent <= len(there):
        return found
    own += (np.eye(len(own)) - own) / independent
    values, vectors = np.linalg.eigh(own)
    own = (vectors * np.maximum(values, 1.0 / independent)) @ vectors.T
    own /= np.sqrt(np.outer(np.diag(own), np.diag(own)))
    gained = -0.5 * independent * float(np.linalg.slogdet(own)[1])
    if gained > 0.25 * len(there) * (len(there) - 1) * np.log(independent):
        found[np.ix_(there, there)] = own
    return found


def _without_knocks(values: Array) -> Array:
    """Values (n, c) about their medians, none farther off than noise is."""
    off = values - np.median(values, axis=0)
    most = _FARTHEST / float(ndtri(0.75)) * np.median(np.abs(off), axis=0)
    return np.asarray(np.clip(off, -most, most))


def _coloured(noise: ChannelNoise, frequency: Array, interval_s: float) -> Array:
    """(2, f) the share of a spectrum at frequencies [cycles a sample] that is coloured, and the spectrum."""
    spectrum = parts(noise, frequency, interval_s)
    coloured = spectrum.coloured.sum(axis=0)
    total = spectrum.white + coloured
    return np.stack([coloured / total, total])


@lru_cache(maxsize=8)
def decorrelation(
    floor: tuple[ChannelNoise, ...],
    columns: tuple[int, ...],
    noises: tuple[ChannelNoise, ...],
    interval_s: float,
    count: int,
) -> Array | None:
    """(c, c) lower triangular, what leaves of each channel's noise what those before it do not tell; (count, c, c), one
    for each of so many cosine coefficients, where channels share what is coloured; None where they share none.

    Args:
        floor: of all channels. columns: those that are there. noises: of means, count of them interval_s apart.
    """
    if not any(floor[column].shared or floor[column].shared_slow for column in columns):
        return None
    unit = np.eye(len(floor))
    own = np.array([floor[column].shared or unit[column] for column in columns])[:, columns]
    if any(floor[column].shared_slow for column in columns):
        slow = np.array([floor[column].shared_slow or unit[column] for column in columns])[:, columns]
        frequency = np.arange(float(count)) / (2.0 * count)
        share = np.stack([_coloured(noises[column], frequency, interval_s)[0] for column in columns], axis=1)
        fast, late = np.sqrt(1.0 - share), np.sqrt(share)
        own = fast[:, :, None] * fast[:, None] * own + late[:, :, None] * late[:, None] * slow
    return np.asarray(np.linalg.inv(np.linalg.cholesky(own)))
