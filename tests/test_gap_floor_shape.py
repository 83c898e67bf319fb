"""A floor known as an autoregression: the sweep may have another spectrum, as far as readings at rest allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct, idct
from whitened_examples import data  # noqa: F401

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.states import moved_floor
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left

#: Logarithms of the sweep's variance in each of six bands, of those at rest.
LEVELS = np.array([0.5, -0.5, 0.5, -0.5, 0.5, -0.5])


@pytest.mark.parametrize("rest", [1.0, 4.0, 100.0])
def test_the_spectrum_of_the_sweep_counts_by_its_share_of_all_readings(
    data: WhitenedData,  # noqa: F811
    rest: float,
) -> None:
    """Of a sweep and so many times its readings at rest each band's level is their mean, by their numbers: to four
    deviations of the sweep's part in it, and half that for the squares of what the two differ by."""
    variance, samples = data.floor[0].variance, round(rest * data.count)
    known = ChannelNoise(
        variance,
        samples=samples,
        duration_s=samples * data.interval_s,
        lags=(variance, 0.3 * variance, *[0.0] * 60),
        every_s=data.interval_s,
    )
    floor = (known, *data.floor[1:])
    own = replace(data, floor=floor, noises=floor)
    assert (len(own.whiteners[0].ar) - 1) // 2 == len(LEVELS)
    noise = np.random.default_rng(3).standard_normal((6, own.count))
    bands = np.arange(own.count) * len(LEVELS) // own.count
    noise[0] = idct(dct(noise[0], norm="ortho") * np.exp(0.5 * LEVELS)[bands], norm="ortho")
    found = moved_floor([Left(own, Explained(own.absorbed, noise.ravel()))], at_rest=True)
    assert found is not None
    factors = [step.factor for step in found.steps if step.column == 0]
    told = -2.0 * np.log(np.prod(factors, axis=0)) if factors else np.zeros(own.count)
    share = 1.0 / (1.0 + rest)
    deviation = share * np.sqrt(2.0 * len(LEVELS) / own.count)
    for band, level in enumerate(LEVELS):
        middle = told[bands == band][20:-20]
        assert np.median(middle) == pytest.approx(share * level, abs=4.0 * deviation + 0.5 * share * level**2)
