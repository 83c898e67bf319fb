"""What moves several channels at once by something else in each sample, and means over neighbours hardly show."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from whitened_examples import recorded, unexplained

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.amplitudes import between_steps
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


@pytest.mark.parametrize(("source", "course"), [("the clock", FROM_SAMPLE_TO_SAMPLE), ("the angle of joint6", "time")])
def test_what_an_amplitude_is_told_to_does_not_depend_on_the_grid(source: str, course: str, arm: Arm) -> None:
    """The log mass is the integral over a grid of 2,000 amplitudes to .1, wherever the grid of eight lies; alone, that
    grid's varies by a nat where a few directions tell, and by hundreds where thousands do."""
    data, discrepancies = finely_sampled(arm)
    rng = np.random.default_rng(6)
    term = max(
        (each for each in discrepancies.terms if (each.source, each.course) == (source, course)),
        key=lambda each: len(each.values),
    )
    sizes = rng.standard_normal((len(term.values), 1)) / np.sqrt(term.values)[:, None] * 3.0
    left = rng.standard_normal(data.size) + term.every_sample(term.made(sizes))[:, 0]
    linear, alone, masses = unexplained(left), list[float](), list[float]()
    for shift in (1.0, 1.4, 2.0, 2.8):
        (roughly,) = weighed_terms(linear, [replace(term, shift=shift)])
        alone.append(roughly.log_mass)
        masses.append(between_steps(linear, [roughly])[0].log_mass)
        moments = term.along(left[:, None])[:, 0]
        variance = roughly.term.variances[int(np.argmax(roughly.gains))] * np.geomspace(0.25, 4.0, 2001)[:, None]
        ratio = variance * term.values
        gains = 0.5 * np.sum(variance * moments**2 / (1.0 + ratio) - np.log1p(ratio), axis=1)
        step = np.log(16.0) / 2000 / (2.0 * np.log(term.ratio)) / term.steps
        assert masses[-1] == pytest.approx(term.log_prior + np.logaddexp.reduce(gains) + np.log(step), abs=0.1)
    assert np.ptp(masses) < 0.1
    assert np.ptp(alone) > 0.3
