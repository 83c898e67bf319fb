"""What moves several channels at once by something else in each sample, and means over neighbours hardly show."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from whitened_examples import recorded, unexplained

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies, weighed_terms
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.sources import sources
from rig.arm import Arm

FROM_SAMPLE_TO_SAMPLE = "time, from sample to sample"


@cache
def finely_sampled(arm: Arm) -> tuple[WhitenedData, Discrepancies]:
    """6,656 samples, of which means over eight are what slow errors are told by."""
    run = recorded(1, decimation=25)
    data = set_up(run, estimated_floor(run, arm), arm)
    scanner = Scanner.of(data)
    assert scanner.rough.data.count < data.count / 4
    return data, Discrepancies.of(scanner.fine.data, scanner.rough.data)


@pytest.mark.parametrize("name", ["a turn of the tool", "the clock", "the angle of joint6", "the gain of all channels"])
def test_an_error_that_is_another_in_each_sample_is_told(name: str, arm: Arm) -> None:
    """With a square as large as a quarter of all noise's: as that source, and by far more than means tell of it."""
    data, discrepancies = finely_sampled(arm)
    (source,) = [each for each in sources(data) if each.name == name]
    rng = np.random.default_rng(5)
    change = np.einsum("fcn,fn->cn", source.series, rng.standard_normal((len(source.series), data.count))).ravel()
    change *= np.sqrt(0.25 * data.size / (change @ change))
    left = project(data.absorbed, rng.standard_normal(data.size) + change)
    every = weighed_terms(unexplained(left), discrepancies.terms)
    assert (every[0].term.source, every[0].term.course) == (name, FROM_SAMPLE_TO_SAMPLE)
    of_means = [each.log_mass for each in every if each.term.errors.means is not None]
    assert every[0].log_mass > 4.0 * max(of_means)


def test_noise_moves_nothing_from_sample_to_sample(arm: Arm) -> None:
    """Of 20 noises none; each source by itself, once."""
    data, discrepancies = finely_sampled(arm)
    own = [each for each in discrepancies.terms if each.course == FROM_SAMPLE_TO_SAMPLE]
    names = [each.source for each in own]
    assert len(set(names)) == len(names)
    assert not {"the offset of mag1", "the gains of the accelerometer", "a turn of link1"} & set(names)
    for seed in range(20):
        left = project(data.absorbed, np.random.default_rng(seed).standard_normal(data.size))
        assert all(each.log_mass < 0.0 for each in weighed_terms(unexplained(left), own))
