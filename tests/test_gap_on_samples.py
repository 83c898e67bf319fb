"""Terms of a discrepancy sample by sample, where means over neighbours lose of what varies fast."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from whitened_examples import recorded, unexplained

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies, weighed, weighed_terms
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.sources import sources
from rig.arm import Arm
from rig.arrays import Array

SNR = 100.0


@pytest.fixture(scope="module")
def swept(arm: Arm) -> tuple[WhitenedData, Discrepancies]:
    """A sweep that joint 6 rolls through by some tens of degrees from sample to sample."""
    run = recorded(1, decimation=25)
    data = set_up(run, estimated_floor(run, arm), arm)
    return data, Discrepancies.of(data, data.coarse())


def steadily(name: str, data: WhitenedData) -> Array:
    """(c n,) what a source does that is off ever more, the calibration projected out, of this signal-to-noise."""
    source = next(each for each in sources(data) if each.name == name)
    left = project(data.absorbed, (source.series[0] * np.linspace(-1.0, 1.0, data.count)).ravel())
    return np.asarray(left * SNR / np.linalg.norm(left))


def along(name: str, course: str, found: list[Weighed]) -> Weighed:
    return max((each for each in found if (each.term.source, each.term.course) == (name, course)), key=gained)


def gained(each: Weighed) -> float:
    return float(each.gains.max())


def test_what_varies_from_sample_to_sample_is_weighed_of_samples(swept: tuple[WhitenedData, Discrepancies]) -> None:
    """Of the 5000 nats of a clock that drifts one strength leaves all but its own price, ln(SNR 100) and a little more.
    Means lose a hundred more, so that anything fitted on samples would be likelier by as many nats."""
    data, every = swept
    assert every.means.rough.count < data.count
    left = unexplained(steadily("the clock", data))
    of_means = along("the clock", "time, steadily", weighed_terms(left, every.terms))
    of_samples = along("the clock", "time, steadily", weighed(left, every))
    assert of_means.term.of_samples is not None
    assert of_samples.term.of_samples is None
    assert 0.5 * SNR**2 - gained(of_samples) < 8.0
    assert 0.5 * SNR**2 - gained(of_means) > 60.0
    assert of_samples.term.log_prior == of_means.term.log_prior


@pytest.mark.parametrize("course", ["time, steadily", "time", "orientation", "level", "time, in 128 pieces"])
def test_what_is_slow_is_the_same_of_samples(course: str, swept: tuple[WhitenedData, Discrepancies]) -> None:
    """To half a per cent of what it gains, for courses of every kind."""
    data, every = swept
    left = unexplained(steadily("the offset of mag1", data))
    of_means = along("the offset of mag1", course, weighed_terms(left, every.terms))
    again = weighed_terms(left, [every.on_samples(of_means.term)])
    assert [each.term.course for each in again] == [course]
    assert again[0].term.of_samples is None
    assert gained(again[0]) == pytest.approx(gained(of_means), rel=5e-3, abs=2.0)


def test_what_is_as_likely_on_means_is_as_likely_on_samples(swept: tuple[WhitenedData, Discrepancies]) -> None:
    """As of two joints with parallel axes: neither leads by being the one that was weighed of samples."""
    data, every = swept
    same = [each for each in every.terms if (each.source, each.course) == ("the clock", "time, steadily")]
    twins = [
        replace(each, source="its twin", of_samples=replace(each.of_samples, name="its twin"))
        for each in same
        if each.of_samples is not None
    ]
    assert twins
    found = weighed(unexplained(steadily("the clock", data)), replace(every, terms=[*every.terms, *twins]))
    one, other = (along(name, "time, steadily", found) for name in ("the clock", "its twin"))
    assert one.term.of_samples is None
    assert other.term.of_samples is None
    assert one.log_mass == pytest.approx(other.log_mass, abs=1e-6)


def test_a_weak_unknown_is_weighed_of_means(swept: tuple[WhitenedData, Discrepancies]) -> None:
    """At 5 sigma what means lose is a tenth of a nat."""
    data, every = swept
    found = weighed(unexplained(steadily("the clock", data) * 5.0 / SNR), every)
    assert along("the clock", "time, steadily", found).term.of_samples is not None
