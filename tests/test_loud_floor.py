"""A recording at rest that is louder than the readings makes everything look certain and fine: it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import recorded, scenario
from scipy.special import chdtrc

import estimators
import scenarios
from estimators.gap.data.basefit import learn_floor
from estimators.gap.diagnosis import Channel
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.report.louder_rest import loud_floor_words
from estimators.gap.report.unsure_rest import unsure_floor_words
from estimators.loud_floor import times_too_loud
from estimators.noise import held_poses
from rig.channels import CHANNELS, COLUMNS_OF
from rig.effects import EFFECTS
from rig.recording import Recording

#: White noise of so many times the rig's own is put on the readings at rest.
LOUD = 3.0


def louder(locked: Recording) -> Recording:
    """The same at rest with more noise, white and of the same rate."""
    rng = np.random.default_rng(5)
    acquisition = scenario().rig.acquisition
    # a converter's step adds its variance to the noise
    own = np.sqrt(np.square(acquisition.noise_V) + acquisition.step_V**2 / 12.0)

    def noisy(sensor: str) -> np.ndarray:
        readings = locked.readings(sensor)
        sigma = np.sqrt(LOUD**2 - 1.0) * own[COLUMNS_OF[sensor]]
        return readings + sigma * rng.standard_normal(readings.shape)

    return replace(locked, accelerometer=noisy("accelerometer"), magnetometer=noisy("magnetometer"))


@pytest.mark.parametrize("method", ["simultaneous", "ellipsoid"])
def test_a_calibration_says_that_its_floor_is_too_loud(method: str) -> None:
    run, locked = recorded()
    floor = estimators.noise_floor(louder(locked))
    found = estimators.judged(run, estimators.calibrate(run, noise=floor, method=method))  # type: ignore[arg-type]
    count = int(floor.pose_samples.sum())
    for sensor in found.sensors.values():
        (line,) = [line for line in sensor.quality.warnings if "noise floor" in line]
        assert f"(locked recording, {count:,} samples at 1000 Hz)" in line
        # 600 magnitudes at least and more readings at rest: the ratio is known to sqrt(2) / sqrt(1200), 4 %; five of it
        assert float(line.split("standard deviation is ")[1].split(" times")[0]) == pytest.approx(LOUD, rel=0.2)
        verdict = sensor.quality.verdict
        assert isinstance(verdict, dict)
        assert "a floor that is too loud" in verdict["text"]


def test_a_floor_of_the_same_noise_says_nothing() -> None:
    for seed in range(5):
        run, locked = recorded(seed=seed)
        found = estimators.calibrate(run, noise=estimators.noise_floor(locked))
        assert not [line for sensor in found.sensors.values() for line in sensor.quality.warnings if "louder" in line]


def test_the_limit_is_that_of_chance() -> None:
    """Noise whose floor is known exactly is called too loud once in ten thousand: never in 300 draws, at one in 33."""
    rng = np.random.default_rng(0)
    freedom = 200.0
    values = rng.chisquare(freedom, 300)
    tests = [
        {"value": value, "degrees_of_freedom": freedom, "p_value": float(chdtrc(freedom, value))} for value in values
    ]
    assert not [test for test in tests if times_too_loud(test) is not None]
    assert times_too_loud({**tests[0], "value": freedom / 4.0, "p_value": 1.0}) == pytest.approx(2.0)
    assert times_too_loud(None) is None
    assert times_too_loud({"value": 0.0, "degrees_of_freedom": 0.0, "p_value": 1.0}) is None


def test_a_diagnosis_says_that_the_locked_recording_is_too_loud() -> None:
    run, locked = recorded()
    few = [name for name in EFFECTS if name not in ("backlash", "joint_offset")]
    loud = estimators.diagnose(run, louder(locked), without=few)
    (line,) = [line for line in loud.warnings if "too loud" in line]
    assert all(channel in line for channel in CHANNELS)
    assert "the readings come at 10 Hz" in line
    assert not [line for line in estimators.diagnose(run, locked, without=few).warnings if "too loud" in line]


def below(square: float, floor: ChannelNoise, source: str = "locked recording") -> list[str]:
    """What is said of residuals of so many times the floor's variance in one channel."""
    run, _ = recorded()
    row = Channel(np.sqrt(floor.variance), np.sqrt(square * floor.variance), 0.0, 1.0, 0.0, None)
    return loud_floor_words([run], [{"accel1": row}], [(floor,) * 6], [source])


def test_only_a_floor_that_is_known_well_enough_is_called_too_loud() -> None:
    white = ChannelNoise(1.0, samples=2000, duration_s=20.0)
    assert below(0.5, white)
    assert not below(0.95, white)
    assert not below(0.5, white, source="the recording itself")
    assert not below(0.5, replace(white, samples=20))
    # Noise that remembers for longer than either recording: a variance of half the floor's is no surprise
    assert not below(0.5, replace(white, white=0.2, parts=((0.8, 60.0),)))


def test_readings_at_rest_between_each_other_last_but_once() -> None:
    """A locked recording forty times as fast as the sweep is read as four series, each a fortieth of it: its floor is
    learned from all of these, in as long as they lasted."""
    still = scenarios.load("ann-arbor").simulate_locked(0)
    labels = held_poses(still)
    floor = learn_floor(still, 40.0 / still.rate_Hz)
    for channel in floor:
        assert channel.holds == len(np.unique(labels[labels >= 0]))
        assert channel.samples > 0.9 * (labels >= 0).sum()
        assert channel.duration_s == pytest.approx((labels >= 0).sum() / still.rate_Hz, rel=0.1)


def test_a_floor_that_the_locked_recording_hardly_shows_is_told() -> None:
    """The RMS of white noise is known to 1 / sqrt(2 n): 10 % of 50 samples."""
    run, _ = recorded()
    white = ChannelNoise(1.0, samples=2000, duration_s=20.0)
    assert not unsure_floor_words([run], [(white,) * 6], ["locked recording"])
    few = replace(white, samples=40, duration_s=0.4)
    assert not unsure_floor_words([run], [(few,) * 6], ["the recording itself"])
    (line,) = unsure_floor_words([run], [(few,) + (white,) * 5], ["locked recording"])
    assert "accel1 to ±11 % (40 samples at rest in 0.4 s)" in line
    assert "drift" not in line
    # sqrt(2 * 60 s / 1,000 s) / 2 of the variance that drifts
    drifting = replace(white, white=0.1, parts=((0.9, 60.0),), samples=100_000, duration_s=1000.0)
    (line,) = unsure_floor_words([run], [(white, drifting, drifting) + (white,) * 3], ["locked recording"])
    assert "accel2 and accel3 to ±16 % (100,000 samples at rest in 1,000 s, most of it a drift that" in line
    assert "within 60 s" in line
