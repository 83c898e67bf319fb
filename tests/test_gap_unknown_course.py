"""What a gap follows is told from the first weighing of what has no name, whatever leads by then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from whitened_examples import data  # noqa: F401

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.considered import set_prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.search.noises import Noises
from estimators.gap.search.weighing import Weighing


def test_what_repeats_is_told_where_noise_is_far_likelier(data: WhitenedData) -> None:
    """A sine of 20 standard deviations of its size, where a floor that nothing shows explains all: without a floor at
    rest that is a promise from the beginning."""
    readings = data.readings.copy()
    wave = np.sin(2.0 * np.pi * 0.0731 * data.t)
    readings[:, 0] += 20.0 / np.linalg.norm(wave) * np.sqrt(data.floor[0].variance) * wave
    moved = replace(data, readings=readings)
    scanner = Scanner.of(moved)
    work = Weighing(scanner, [], Noises(set_prior([], {}, moved, {}), (), at_rest=False), None)
    floor = NoiseState()
    none = work.search(floor, scanner).fine(())
    unseen = work.alone(none, NoiseState("unseen floor"))
    work.enter(replace(unseen, log_mass=unseen.log_mass + 1e4))
    work.enter_nameless(none, floor, Discrepancies.of(moved, moved))
    assert work.taken is not None
    most = {course: max(square for name, square in work.taken if name == course) for course, _ in work.taken}
    sines = [course for course in most if course.startswith("a sine of 0.073")]
    assert sines
    assert max(most[course] for course in sines) > 0.8 * 20.0**2
