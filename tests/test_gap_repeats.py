"""What repeats by itself, in time or in a joint's angle, is no tone of the catalogue, which may be a line of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from whitened_examples import data, recorded, unexplained  # noqa: F401

from estimators.gap import diagnose
from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import weighed_terms
from estimators.gap.evidence.repeats import Repeats, clocks
from estimators.gap.hypotheses.sources import sources
from estimators.gap.remainder_words import course_words
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.recording import Recording

Wave = Callable[[WhitenedData], Array]


def repeats(data: WhitenedData) -> Repeats:
    every = sources(data)
    return Repeats(data, every, [-float(np.log(len(every)))] * len(every))


def angle(data: WhitenedData, joint: int) -> Array:
    assert data.base.q_encoder is not None
    return np.unwrap(data.base.q_encoder[:, joint - 1])


@pytest.mark.parametrize(
    ("wave", "course"),
    [
        (lambda data: np.exp(-5.0 * (data.t / 60.0 % 1.0)), ("every ", 60.0, " s")),
        (lambda data: (np.rad2deg(angle(data, 5)) / 24.0) % 1.0, ("every ", 24.0, " deg of joint5")),
        (lambda data: np.sin(2.0 * np.pi * np.rad2deg(angle(data, 1)) / 24.0), ("a sine of ", 24.0, " deg of joint1")),
        (lambda data: np.sin(2.0 * np.pi * 0.31 * data.t), ("a sine of ", 0.31, " Hz")),
        (lambda data: np.sin(2.0 * np.pi * 0.013 * data.t), ("a sine of ", 0.013, " Hz")),
    ],
)
def test_a_waveform_is_told_with_its_clock_and_its_period(
    data: WhitenedData, wave: Wave, course: tuple[str, float, str]
) -> None:
    """Of an axis's offset, at a signal-to-noise of 40: half its square, less 150 nats for what 16 harmonics cost and
    for those beyond them."""
    (source,) = [each for each in sources(data) if each.name == "the offset of mag2"]
    change = project(data.absorbed, (source.series[0] * wave(data)).ravel())
    left = project(data.absorbed, np.random.default_rng(1).standard_normal(data.size))
    left += 40.0 * change / np.linalg.norm(change)
    best = weighed_terms(unexplained(left), repeats(data).terms(left))[0]
    assert best.term.source == source.name
    kind, period, rest = re.fullmatch(r"(.*?)([\d.]+)(.*)", best.term.course).groups()  # type: ignore[union-attr]
    assert (kind, rest) == course[::2]
    assert float(period) == pytest.approx(course[1], rel=1e-3)
    assert best.log_mass > 0.5 * 40.0**2 - 150.0


def test_noise_repeats_in_nothing(data: WhitenedData) -> None:
    """By half a million fundamentals and harmonics of sources: of 20 recordings none is worth more than nothing. By the
    prior one in e^9 such shares would be."""
    own = repeats(data)
    for seed in range(20):
        noise = project(data.absorbed, np.random.default_rng(seed).standard_normal(data.size))
        assert all(each.log_mass < 0.0 for each in weighed_terms(unexplained(noise), own.terms(noise)))


def test_only_joints_that_move_and_not_steadily_are_clocks(data: WhitenedData) -> None:
    """Joint 6 rolls without end: what repeats in its angle repeats in time."""
    assert [each.name for each in clocks(data)] == ["", " of joint1", " of joint5"]
    assert data.base.q_encoder is not None
    still = replace(data, base=replace(data.base, q_encoder=np.zeros_like(data.base.q_encoder)))
    assert [each.name for each in clocks(still)] == [""]
    posed = replace(data, base=replace(data.base, q_encoder=None))
    assert [each.name for each in clocks(posed)] == [""]


def test_a_bit_of_a_converter_repeats_in_the_level(data: WhitenedData) -> None:
    """Of 78 mV, two standard deviations of the noise too large where it is set: told by its period of 156 mV, to the
    share of it that the span's twenty periods tell."""
    level = data.modelled[:, 3]
    bit = np.floor(level / 0.078) % 2.0
    change = np.zeros_like(data.readings)
    change[:, 3] = 2.0 * np.sqrt(data.floor[3].variance) * bit
    left = project(data.absorbed, data.whiten(change) + np.random.default_rng(1).standard_normal(data.size))
    found = weighed_terms(unexplained(left), repeats(data).terms(left))[0]
    assert found.term.source == "the offset of mag1"
    course = re.fullmatch(r"(?:every|a sine of) (.*) % of the span of mag1", found.term.course)
    assert course is not None
    periods = float(np.ptp(level)) / 0.156
    assert float(course[1]) / 100.0 * np.ptp(level) == pytest.approx(0.156, rel=0.25 / periods)


def test_words_of_a_period() -> None:
    assert course_words("every 24 deg of joint5") == "that repeats every 24 deg of joint5"
    assert course_words("a sine of 24 deg of joint5") == "that repeats as a sine of 24 deg of joint5"


@pytest.fixture(scope="module")
def run() -> Recording:
    return recorded(4, decimation=50)


@pytest.mark.parametrize("of_joint", [True, False])
def test_a_line_of_what_repeats_is_no_hum(run: Recording, of_joint: bool) -> None:
    """A ripple of a joint's motor, and a spike at every 25th reading: once mains hum and vibrations with certainty."""
    assert run.q is not None
    assert run.magnetometer is not None
    size = np.std(np.diff(run.magnetometer[:40], axis=0), axis=0)
    wave = np.sin(30.0 * run.q[:, 0]) if of_joint else np.where(np.arange(len(run)) % 25 == 0, 3.0, 0.0)
    off = np.outer(wave, size * np.array([2.0, 1.5, 0.0]))
    found = diagnose(replace(run, magnetometer=run.magnetometer + off))
    assert found.verdict == "unknown"
    assert not [cause for cause in found.causes if cause.probability > 0.1]


def test_what_hums_in_every_channel_is_one_thing(data: WhitenedData) -> None:
    """A tone that each channel has in its own size and phase, at a signal-to-noise of 30: more than in the sensor that
    has most of it, and with no second frequency."""
    every = {each.name: each for each in sources(data)}
    phases = np.random.default_rng(8).uniform(0.0, 2.0 * np.pi, 6)
    tone = sum(
        every[f"the offset of {channel}"].series[0] * np.sin(2.0 * np.pi * 0.31 * data.t + phase)
        for channel, phase in zip(CHANNELS, phases, strict=True)
    )
    change = project(data.absorbed, np.ravel(tone))
    left = project(data.absorbed, np.random.default_rng(1).standard_normal(data.size))
    left += 30.0 * change / np.linalg.norm(change)
    best = weighed_terms(unexplained(left), repeats(data).terms(left))[0]
    assert best.term.source == "the offsets of every channel"
    assert best.log_mass > 0.5 * 30.0**2 - 100.0
