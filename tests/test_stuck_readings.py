"""Values that stay what they were: told of channels and joints that are stuck, and of no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scenarios
from rig.effects import make_effect
from rig.recording import Recording
from rig.recording.findings import stuck_words


@pytest.fixture(scope="module")
def run() -> Recording:
    return scenarios.load("ann-arbor").simulate(seed=0)


def held(values: np.ndarray, first: int, count: int) -> np.ndarray:
    values = values.copy()
    values[first : first + count] = values[first]
    return values


def test_sound_recordings_are_not_called_stuck(run: Recording) -> None:
    """As they come from the converter, coarse or fine, thinned, of every built-in scenario; and one whose channel is at
    its limit, which is told as clipped."""
    assert not stuck_words(run)
    coarse = make_effect("adc_quantisation", {"where": "acquisition", "lsb_V": 0.05})
    limited = make_effect("saturation", {"where": "accel1", "level": 2.6})
    for effect in (coarse, limited):
        assert not stuck_words(scenarios.load("ann-arbor").with_effects([effect]).simulate(seed=1))
    for name in scenarios.names():
        assert not stuck_words(scenarios.load(name).with_acquisition(decimation=10).simulate(seed=2)), name


def test_a_channel_that_repeats_readings_is_told_with_its_row(run: Recording) -> None:
    assert run.accelerometer is not None
    readings = run.accelerometer.copy()
    for first in (300, 2000, 5000):
        readings[:, 1] = held(readings[:, 1], first, 12)
    (words,) = stuck_words(replace(run, accelerometer=readings))
    assert words.startswith("accelerometer: channel 2 repeats a reading ")
    assert "first from row 300 on (first row 0): stuck now and then?" in words


def test_a_log_that_holds_a_joint_and_catches_up_is_told(run: Recording) -> None:
    assert run.q is not None
    moving = int(np.argmax(np.abs(np.diff(run.q, axis=0)).sum(axis=0)))
    q = run.q.copy()
    q[:, moving] = held(q[:, moving], 1000, 48)
    (words,) = stuck_words(replace(run, q=q))
    assert words.startswith(
        f"joint{moving + 1} stands still for 48 rows, from row 1000 on (first row 0), and then jumps"
    )


def test_a_joint_that_rests_and_goes_on_is_not_stuck(run: Recording) -> None:
    assert run.q is not None
    moving = int(np.argmax(np.abs(np.diff(run.q, axis=0)).sum(axis=0)))
    q = run.q.copy()
    q[1000:, moving] = run.q[952:-48, moving]
    q[952:1000, moving] = q[952, moving]
    assert not stuck_words(replace(run, q=q))


@pytest.mark.parametrize("every", [2, 30])
def test_readings_that_were_filled_in_are_told(run: Recording, every: int) -> None:
    """Each second one, as of a sensor half as fast as its log, or some; in single precision, as files have them."""
    assert run.magnetometer is not None
    lost = np.arange(len(run)) % every == 1
    lost[-1] = False
    filled = [np.interp(run.t, run.t[~lost], values[~lost]) for values in run.magnetometer.T]
    values = np.stack(filled, axis=1).astype(np.float32).astype(float)
    (words,) = stuck_words(replace(run, magnetometer=values))
    assert words.startswith(f"magnetometer: {lost.sum()} readings (")
    assert "straight line between their neighbours, first at row 1 (first row 0)" in words


@pytest.mark.parametrize("every", [2, 10])
def test_poses_that_are_repeated_until_the_next_came_are_told(run: Recording, every: int) -> None:
    """A log ten times slower than the readings, joined without interpolation; once now and then late by a row."""
    assert run.q is not None
    rows = np.arange(len(run)) // every * every
    late = np.flatnonzero(np.random.default_rng(1).random(len(run)) < 0.02)
    rows[late] = rows[late - 1]
    (words,) = stuck_words(replace(run, q=run.q[rows]))
    assert words.startswith(f"each pose is repeated in {every} rows, throughout")
    still = replace(run, q=run.q[rows], metadata=replace(run.metadata, still_poses=True))
    assert not [line for line in stuck_words(still) if line.startswith("each pose")]


def test_a_stuck_sensor_is_not_said_to_be_filled_in(run: Recording) -> None:
    """The same reading throughout lies on a straight line, too."""
    assert run.magnetometer is not None
    (words,) = stuck_words(replace(run, magnetometer=held(run.magnetometer, 3000, 200)))
    assert "200 readings in a row are the same" in words
