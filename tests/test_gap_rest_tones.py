"""Tones at rest that no effect of the catalogue makes are noise, and as loud in the sweep no gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import recorded
from whitened_examples import louder

import estimators
from estimators.gap.data.basefit import learn_floor
from estimators.gap.data.rest_tones import _near
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.floor.tones_at_rest import amplitude_of, made_by_an_effect
from rig.errors import RigError
from rig.recording import Recording

EVERY, FREQUENCY = range(6), 2.3


def test_which_tones_an_effect_makes() -> None:
    assert made_by_an_effect(50.1, EVERY, 1000.0, 0.01)
    assert made_by_an_effect(10.0, EVERY, 20.0, 0.01)  # 50 Hz, read 20 times a second
    assert not made_by_an_effect(3.7, EVERY, 20.0, 0.01)
    assert made_by_an_effect(3.7, range(2), 20.0, 0.01)  # a table that shakes
    assert not made_by_an_effect(3.7, range(2, 4), 20.0, 0.01)


def test_the_amplitude_at_rest_is_that_of_all_poses() -> None:
    """To five standard deviations, sqrt(2 / 3000)."""
    rng = np.random.default_rng(1)
    time = np.arange(3000.0)
    readings = rng.standard_normal(3000) + 1.5 * np.sin(2.0 * np.pi * 0.137 * time)
    assert amplitude_of(np.split(readings, 3), 0.137) == pytest.approx(1.5, abs=5.0 * np.sqrt(2.0 / 3000.0))


def test_a_tone_is_found_near_the_frequency_at_rest() -> None:
    """What is left of it is what its three parameters cannot be told to: less than 25 of 3 squares, once in 60,000."""
    rng = np.random.default_rng(2)
    time = 0.1 * np.arange(6000.0)
    tone = 2.0 * np.sin(2.0 * np.pi * FREQUENCY * time + 1.0)
    found, size = _near(time, tone + rng.standard_normal(6000), FREQUENCY + 0.007, 30.0)
    assert float(np.sum((found - tone) ** 2)) < 25.0
    assert size == pytest.approx(2.0, abs=5.0 * np.sqrt(2.0 / 6000.0))


def test_a_tone_that_wanders_is_found_in_stretches() -> None:
    """Its phase goes by three radians and back, by .59 at most in one of 16 stretches: what is left of the tone is
    2 (.59^2 / 12) / 2 = .029, and what 32 sizes cannot be told to, 32 / 6000. One line would leave more than 1."""
    rng = np.random.default_rng(3)
    time = 0.1 * np.arange(6000.0)
    tone = 2.0 * np.sin(2.0 * np.pi * FREQUENCY * time + 3.0 * np.sin(2.0 * np.pi * time / 1200.0))
    found, _ = _near(time, tone + rng.standard_normal(6000), FREQUENCY, 30.0)
    assert float(np.mean((found - tone) ** 2)) < 0.05


def test_a_slow_hum_takes_no_more_than_its_own_cycles() -> None:
    """Of poses of a third of its period: in stretches as short as that, a wave of .05 Hz would be a gap of a period of
    70 s. In four of its own cycles it holds next to nothing of that: a tenth at most."""
    time = 0.1 * np.arange(6000.0)
    gap = np.sin(2.0 * np.pi * time / 70.0)
    found, _ = _near(time, gap, 0.05, 6.9)
    assert float(np.mean((gap - found) ** 2)) > 0.9 * 0.5


def test_a_channel_that_is_constant_beside_one_that_hums_is_told() -> None:
    _, locked = recorded()
    locked = humming(locked, 1.0)
    assert locked.accelerometer is not None
    readings = locked.accelerometer.copy()
    readings[:, 1] = 2.5
    with pytest.raises(RigError, match=r"accel2 (is constant|stays at)"):
        learn_floor(replace(locked, accelerometer=readings), 1.0 / locked.rate_Hz)


def humming(run: Recording, times: float) -> Recording:
    phases = np.arange(6.0)
    return louder(run, times * 0.015 * np.sin(2.0 * np.pi * FREQUENCY * run.t[:, None] + phases))


def diagnosed(times: float) -> Diagnosis:
    run, locked = recorded()
    return estimators.diagnose(humming(run, times), humming(locked, 1.0))


def test_as_loud_as_at_rest_it_is_no_gap() -> None:
    """It was something outside the catalogue, with more than .999."""
    found = diagnosed(1.0)
    assert found.posterior["nothing"] > 0.5
    assert "is taken for noise, and out of the readings" in " ".join(found.warnings)


def test_what_the_sweep_has_more_of_it_stays() -> None:
    assert diagnosed(2.0).posterior["other"] > 0.95
