"""Noise that channels share at rest: a reference, a supply or a ground that wanders from reading to reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.fft import dct
from scipy.special import ndtri
from scipy.stats import rankdata

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arrays import Array, Rows

#: Independent steps in each step between neighbouring readings: neighbours share a reading.
_INDEPENDENT: Final = 2.0 / 3.0
#: Bands, as wide as each other, in each of which noise that is shared from reading to reading is.
_BANDS: Final = 4


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
    own = np.asarray(np.corrcoef(_scores(steps), rowvar=False))
    own += (np.eye(len(own)) - own) / independent  # channels that are the same here need not be so elsewhere
    gained = -0.5 * independent * float(np.linalg.slogdet(own)[1])
    least = 0.25 * len(there) * (len(there) - 1) * np.log(independent)
    if gained > least and _in_every_band(readings[:, there], labels, own):
        found[np.ix_(there, there)] = own
    return found


def _scores(values: Array) -> Array:
    """(n, c) normal scores of each channel's values (n, c)."""
    return np.asarray(ndtri(rankdata(values, axis=0) / (len(values) + 1.0)))


def _in_every_band(readings: Array, labels: Rows, correlation: Array) -> bool:
    """Whether a correlation (c, c) of the channels (n, c) is likelier than none in each band of frequencies."""
    inverse, log_det = np.linalg.inv(correlation), float(np.linalg.slogdet(correlation)[1])
    squares = np.zeros((_BANDS, len(correlation), len(correlation)))
    for label in np.unique(labels[labels >= 0]):
        own = readings[labels == label]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own) <= _BANDS:
            continue
        for band, waves in enumerate(np.array_split(dct(_scores(own), axis=0)[1:], _BANDS)):
            squares[band] += waves.T @ waves
    size = np.sqrt(np.maximum(np.einsum("bii->bi", squares), 1e-300))
    alike = squares / (size[:, :, None] * size[:, None, :])
    return bool((log_det + np.einsum("ij,bij->b", inverse, alike) < len(correlation)).all())


def decorrelation(floor: Sequence[ChannelNoise], columns: Sequence[int]) -> Array | None:
    """(c, c) lower triangular, what leaves of each channel's noise what those before it do not tell; None where the
    channels share none.

    Args:
        floor: of all channels. columns: those that are there.
    """
    if not any(floor[column].shared for column in columns):
        return None
    correlation = np.array([floor[column].shared or np.eye(len(floor))[column] for column in columns])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(correlation[:, columns])))
