"""The noise floor where no recording at rest shows it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from whitened_examples import louder, recorded

from estimators.gap.data import basefit
from estimators.gap.data.basefit import estimated_floor
from rig.arm import Arm


def floor_of(arm: Arm, noise: np.ndarray | float) -> np.ndarray:
    run = recorded(3, decimation=25)
    own = estimated_floor(louder(run, noise * np.ones((len(run), 6))), arm)
    return np.sqrt([channel.variance for channel in own])


@pytest.mark.parametrize("cycles", [0.3, 0.475, 0.5])
def test_a_fast_tone_is_no_part_of_the_floor(arm: Arm, cycles: float) -> None:
    """Its line is one of hundreds; the median of either estimate is known to 1.4 / sqrt(2 n), 4 % of 600 samples."""
    plain = floor_of(arm, 0.0)
    time = np.arange(float(len(recorded(3, decimation=25))))
    tone = 3.0 * plain * np.cos(2.0 * np.pi * cycles * time)[:, None]
    np.testing.assert_allclose(floor_of(arm, tone), plain, rtol=5.0 * 0.04)


def test_spikes_are_no_part_of_the_floor(arm: Arm) -> None:
    plain = floor_of(arm, 0.0)
    spikes = np.zeros((len(recorded(3, decimation=25)), 6))
    spikes[::50] = 30.0 * plain
    np.testing.assert_allclose(floor_of(arm, spikes), plain, rtol=0.25)


def test_noise_that_a_filter_smoothed_has_no_tones(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is smaller at fast frequencies, at all of them."""
    rng = np.random.default_rng(1)
    smooth = 0.5 * lfilter(*butter(2, 0.2), rng.standard_normal((len(recorded(3, decimation=25)), 6)), axis=0)
    found = floor_of(arm, smooth)
    monkeypatch.setattr(basefit, "_TONAL", np.inf)
    np.testing.assert_array_equal(floor_of(arm, smooth), found)


def test_floors_of_noise_alone_are_those_of_differences(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where both medians tell the same, that of differences is taken: four standard deviations apart, one in 30,000."""
    limited = floor_of(arm, 0.0)
    monkeypatch.setattr(basefit, "_TONAL", np.inf)
    np.testing.assert_array_equal(floor_of(arm, 0.0), limited)
