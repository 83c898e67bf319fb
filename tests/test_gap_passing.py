"""What comes and passes, once or a few times, is told with its instant, its width and its frequency."""

from __future__ import annotations

import re

import numpy as np
import pytest
from whitened_examples import data, unexplained  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import weighed_terms
from estimators.gap.evidence.passing import Atom, Passings
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.sources import sources
from estimators.gap.remainder_words import course_words
from rig.arrays import Array

#: When, for how long [s], and at what frequency [Hz].
_COURSE = re.compile(r"time, (once|\d times, first) (about|from) (\S+) s for (\S+) s(?:, at (\S+) Hz)?")


@pytest.fixture(scope="module")
def passings(data: WhitenedData) -> Passings:
    every = sources(data)
    return Passings(data, every, [-float(np.log(len(every)))] * len(every))


def leading(data: WhitenedData, passings: Passings, course: Array, source: str, size: float, seed: int) -> Weighed:
    """The likeliest term where freedoms of a source follow a course in one ratio, at a signal-to-noise."""
    (own,) = [each for each in passings.every if each.name == source]
    ratio = np.array([0.7, -0.6, 0.4])[: len(own.series)]
    change = project(data.absorbed, (np.einsum("f,fcn->cn", ratio, own.series) * course).ravel())
    left = project(data.absorbed, np.random.default_rng(seed).standard_normal(data.size))
    left += size * change / np.linalg.norm(change)
    return weighed_terms(unexplained(left), passings.terms(left))[0]


def told(found: Weighed) -> tuple[str, str, float, float, float]:
    matched = _COURSE.fullmatch(found.term.course)
    assert matched is not None
    often, begins, at, lasts, frequency = matched.groups()
    return often, begins, float(at), float(lasts), float(frequency or 0.0)


def test_a_knock_that_rings_out_is_told(data: WhitenedData, passings: Passings) -> None:
    """At a signal-to-noise of 20: the instant and the time constant to five of the standard deviations that the atom's
    cost is made of, as is the frequency; beyond half the square less 60 nats, which choice and freedoms cost."""
    ring = Atom(900.3, 24.0, 0.21, dies=True)
    best = leading(data, passings, ring.everywhere(data.count)[:, 1], "the offsets of the accelerometer", 20.0, 1)
    often, begins, at, lasts, frequency = told(best)
    assert (best.term.source, often, begins) == ("the offsets of the accelerometer", "once", "from")
    interval, deviation = data.interval_s, 5.0 * np.sqrt(2.0) / 20.0
    assert at == pytest.approx((data.t[900] - data.t[0]), abs=deviation * 24.0 * interval)
    assert lasts == pytest.approx(np.log(2.0) * 24.0 * interval, rel=deviation + 0.05)
    assert frequency == pytest.approx(0.21 / interval, abs=5.0 / (2.0 * np.pi * 24.0 * 20.0) / interval + 1e-3)
    assert best.log_mass > 0.5 * 20.0**2 - 60.0
    assert course_words(best.term.course).startswith("that comes once from ")


def test_a_pulse_is_told(data: WhitenedData, passings: Passings) -> None:
    """Of the field, fixed in the base, as by a lift that passes: at a signal-to-noise of 12 by more than 25 nats."""
    course = Atom(700.0, 30.0).everywhere(data.count)[:, 0]
    best = leading(data, passings, course, "the magnetic field", 12.0, 2)
    often, _, at, lasts, frequency = told(best)
    assert (best.term.source, often, frequency) == ("the magnetic field", "once", 0.0)
    spread = 5.0 * np.sqrt(2.0) / 12.0
    assert at == pytest.approx(data.t[700] - data.t[0], abs=spread * 30.0 * data.interval_s)
    assert lasts == pytest.approx(2.355 * 30.0 * data.interval_s, rel=spread)
    assert best.log_mass > 25.0


def test_bursts_come_again(data: WhitenedData, passings: Passings) -> None:
    """Four of one kind, each of a signal-to-noise of 10: all are found, at their frequency."""
    bursts = [Atom(at, 20.0, 0.34) for at in (150.0, 500.0, 800.0, 1400.0)]
    course = np.sum([each.everywhere(data.count)[:, 0] for each in bursts], axis=0)
    best = leading(data, passings, course, "the offsets of the magnetometer", 20.0, 3)
    often, _, _, _, frequency = told(best)
    assert (best.term.source, often) == ("the offsets of the magnetometer", "4 times, first")
    assert frequency == pytest.approx(0.34 / data.interval_s, rel=0.01)
    assert course_words(best.term.course).startswith("that comes 4 times, first about ")


def test_white_noise_shows_nothing_that_passes(data: WhitenedData, passings: Passings) -> None:
    """The mass of all terms over that of nothing is more than one in a tenth of white noises at most: its mean is the
    prior mass, which is one where every source's share is spent on what passes (Markov allows no claim; of 60 draws
    none or one has it)."""
    masses = []
    for seed in range(60):
        left = project(data.absorbed, np.random.default_rng([17, seed]).standard_normal(data.size))
        found = weighed_terms(unexplained(left), passings.terms(left, -12.0))
        masses.append(sum(float(np.exp(each.log_mass)) for each in found))
    assert np.mean(np.array(masses) > 1.0) < 0.1


def test_what_begins_at_once_is_nothing_before() -> None:
    whole = Atom(30.0, 5.0, 0.2, dies=True).everywhere(100)
    assert not whole[:30].any()
    assert np.abs(whole[30]).max() == 1.0
    assert Atom(-3.0, 2.0).everywhere(50).shape == (50, 1)
