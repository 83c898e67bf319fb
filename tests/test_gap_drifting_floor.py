"""Where the floor drifts, an unknown error is whitened along its course, and jumps are told by their steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from whitened_examples import data, unexplained  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies, weighed_terms
from estimators.gap.evidence.jumps import Jumps
from estimators.gap.evidence.jumps_in_drift import StepsInDrift, scores
from estimators.gap.evidence.passing import Atom, Passings
from estimators.gap.evidence.terms import terms_along
from estimators.gap.hypotheses.courses import Course
from estimators.gap.hypotheses.sources import Source, sources
from rig.arrays import Array
from rig.effects import make_effect


@pytest.fixture(scope="module")
def drifting(data: WhitenedData) -> WhitenedData:
    """As if each channel had three slow parts of its white noise's size."""
    noises = tuple(
        replace(each, parts=tuple((each.white, tau_s) for tau_s in (3.0, 40.0, 500.0)), lags=()) for each in data.noises
    )
    return replace(data, noises=noises)


def named(data: WhitenedData, name: str) -> Source:
    (found,) = [each for each in sources(data) if each.name == name]
    return found


def changed(data: WhitenedData, source: Source, course: Array) -> Array:
    """(c n,) whitened: what freedoms of a source in one ratio do along a course, beside the calibration."""
    assert source.felt is not None
    felt = np.einsum("f,fcn->cn", np.array([0.7, -0.6, 0.4, 0.5, 0.3])[: len(source.series)], source.felt[0]) * course
    readings = np.zeros((data.count, 6))
    readings[:, data.columns] = felt.T
    return project(data.absorbed, data.whiten(readings))


@pytest.mark.parametrize("name", ["the offset of mag2", "the gains of the accelerometer", "the gain of all channels"])
@pytest.mark.parametrize("kind", ["jumps", "wave"])
def test_a_term_holds_what_the_source_does_along_its_course(drifting: WhitenedData, name: str, kind: str) -> None:
    """To rounding; the product of the whitened source with the course holds less than .95 of its square."""
    source = named(drifting, name)
    clock = np.arange(drifting.count)
    if kind == "jumps":
        values = np.column_stack([(clock > 600) & (clock < 700), clock >= 1200]).astype(float)
    else:
        values = np.column_stack([np.cos(0.9 * clock), np.sin(0.9 * clock)])
    course = Course("a course", values, np.array([1.0, 0.5]))
    change = changed(drifting, source, values @ [1.0, -0.7])
    for one, least, most in ((source, 1.0 - 1e-9, 1.0 + 1e-9), (replace(source, felt=None), 0.0, 0.95)):
        (term,) = terms_along(drifting.absorbed, one, course, 0.0)
        along = term.along(change[:, None])[:, 0]
        if not (name == "the offset of mag2" and kind == "wave" and one.felt is None):  # a constant keeps a sine one
            assert least <= float(np.sum(along**2 / term.values)) / float(change @ change) <= most


def test_what_a_step_tells_is_what_it_does(drifting: WhitenedData) -> None:
    """Of an axis's offset: the square of a step of one at each of some instants, beside the calibration, to a tenth:
    the slowest part has not faded when the next is there; and no other instant tells more."""
    taken = scores(drifting, drifting.absorbed.dense().T.reshape(-1, len(drifting.columns), drifting.count))
    source = named(drifting, "the offset of mag2")
    steps = StepsInDrift(drifting, source, taken)
    for instant in (100, 400, 801, 1300):
        change = changed(drifting, source, (np.arange(drifting.count) >= instant).astype(float))
        every = steps.squares(change.reshape(len(drifting.columns), -1))
        assert int(np.argmax(every)) == instant
        assert float(every[instant]) == pytest.approx(float(change @ change), rel=0.1)


def test_jumps_in_a_drift_are_told_with_their_instants(drifting: WhitenedData) -> None:
    """Six jumps of an axis's offset between two levels, each of a signal-to-noise of about 8: when they are, to three
    samples, in each of three noises, beside one that is not there at most."""
    every = sources(drifting)
    jumps = Jumps(drifting, every, [-float(np.log(len(every)))] * len(every))
    source = named(drifting, "the offset of mag2")
    at = np.array([210, 480, 690, 930, 1190, 1400])
    change = changed(drifting, source, np.searchsorted(at, np.arange(drifting.count), side="right") % 2 == 1)
    (steps,) = [each for each in jumps.in_drift if each.source.name == source.name]
    for seed in range(3):
        left = project(drifting.absorbed, np.random.default_rng([29, seed]).standard_normal(drifting.size))
        left += 20.0 * change / np.linalg.norm(change)
        best = weighed_terms(unexplained(left), jumps.terms(left))[0]
        assert best.term.source.endswith("of mag2")
        assert best.log_mass > 50.0
        told = np.array(steps.instants(left.reshape(len(drifting.columns), -1), 8.0))
        assert np.abs(told[:, None] - at).min(axis=0).max() <= 3
        assert len(told) <= len(at) + 1


def test_noise_in_a_drift_shows_no_jumps(drifting: WhitenedData) -> None:
    """Of 30 noises of the floor's own spectrum none has jumps of a positive log mass."""
    every = sources(drifting)
    jumps = Jumps(drifting, every, [-float(np.log(len(every)))] * len(every))
    for seed in range(30):
        left = project(drifting.absorbed, np.random.default_rng([31, seed]).standard_normal(drifting.size))
        found = weighed_terms(unexplained(left), jumps.terms(left))
        assert all(each.log_mass < 0.0 for each in found)


def test_a_pulse_in_a_drift_is_told(drifting: WhitenedData) -> None:
    """A pulse of the magnetometer's offsets as long as the floor's memory, at a signal-to-noise of 20: once, and for as
    long as it lasts to a fifth."""
    every = sources(drifting)
    passings = Passings(drifting, every, [-float(np.log(len(every)))] * len(every))
    source = named(drifting, "the offsets of the magnetometer")
    change = changed(drifting, source, Atom(800.0, 40.0).everywhere(drifting.count)[:, 0])
    left = project(drifting.absorbed, np.random.default_rng(4).standard_normal(drifting.size))
    left += 20.0 * change / np.linalg.norm(change)
    best = weighed_terms(unexplained(left), passings.terms(left))[0]
    assert best.term.source == source.name
    assert best.term.course.startswith("time, once about ")
    lasts = float(best.term.course.partition(" for ")[2].partition(" s")[0])
    assert lasts == pytest.approx(2.355 * 40.0 * drifting.interval_s, rel=0.2)


def test_another_form_of_a_cause_is_whitened_along_its_course(drifting: WhitenedData) -> None:
    """A droop whose strength follows a course: its exact term holds all of the square, to rounding, whichever course;
    the product with the whitened droop leaves a tenth and more out along the fastest of them."""
    droop = make_effect("joint_compliance", {"where": "joint5", "droop_rad": 0.01})
    change = drifting.change([droop])
    own = project(drifting.absorbed, drifting.whiten(change)[:, None])
    every = Discrepancies.of(drifting, drifting)
    terms = every.forms(("joint_compliance@joint5", ""), lambda: (change, own))
    taken, shares = drifting.absorbed.extended(own), []
    for course in every.courses:
        (term,) = [each for each in terms if each.course == course.name]
        values = course.values @ (course.weight * np.random.default_rng(1).standard_normal(course.values.shape[1]))
        left = project(taken, drifting.whiten(change * values[:, None]))
        held = [np.sum(each.along(left[:, None])[:, 0] ** 2 / each.values) for each in (every.on_samples(term), term)]
        assert held[0] == pytest.approx(left @ left, rel=1e-6)
        shares.append(held[1] / (left @ left))
    assert min(shares) < 0.9
