"""Which hypothesis a diagnosis' figures are of: one with the causes of the explanation that is listed first."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosed_recordings import recorded
from whitened_examples import recorded as recorded_by

import estimators
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.diagnosis import Hypothesis as Listed
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.refine import Fitted, at
from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.report.marginal import Place, twins
from estimators.gap.report.same_sets import merged
from estimators.gap.report.summary import _at_least, _told_of
from estimators.gap.report.told import told
from estimators.gap.search.explanation import Explanation, Member
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior
from rig.arm import Arm
from rig.channels import SENSORS
from rig.effects import EFFECTS

DIPOLE = ("base_dipole", "base")
PLACES = {"base_dipole@base": Place(((*DIPOLE, 1.0),)), "latency@mag": Place((("latency", "mag", 1.0),))}


def found(*labels: str, other: bool = True) -> Any:
    members = [SimpleNamespace(label=label) for label in labels]
    return SimpleNamespace(explanation=SimpleNamespace(members=members), state=SimpleNamespace(labels=()), other=other)


def told_of(hypotheses: list[Any], doubted: dict[int, tuple[float, ...]], *causes: tuple[str, str]) -> Any:
    posterior = SimpleNamespace(hypotheses=hypotheses, leading=hypotheses[0])
    first = [Listed(causes, True, 0.5)]
    return hypotheses[_told_of(posterior, PLACES, {}, doubted, first, (), False)]  # type: ignore[arg-type]


def test_the_figures_are_of_the_explanation_that_is_listed_first() -> None:
    """A dipole leads by its mass; it is doubted in a set with another effect, or so that most are without it."""
    dipole, nothing, doubtful = found("base_dipole@base"), found(), found("latency@mag")
    every, doubted = [dipole, doubtful, nothing], {0: (0.6,), 1: (0.2,)}
    assert told_of(every, doubted, DIPOLE) is dipole
    assert told_of(every, doubted) is nothing  # with no cause that is doubted, where there is one
    assert told_of([dipole, doubtful], doubted) is doubtful
    assert told_of([dipole], {0: (0.6,)}) is dipole  # nothing else was weighed


def test_a_cause_is_fitted_again_without_an_image_beside_it(arm: Arm) -> None:
    """A latency of 2 s, and a lag that does nearly the same beside it, each at half of that: a lag that is no cause
    takes nothing from the latency, which is then within four standard deviations of what it is; it was off by fifty."""
    run = recorded_by(3, ("latency", {"where": "accelerometer", "delay_s": 2.0}))
    data = set_up(run, estimated_floor(run, arm), arm)
    labels = ("sensor_lag@accelerometer", "latency@accelerometer")
    every = {each.label: each for each in all_candidates(data)}
    halves = [Fitted(every[label], np.ones(1), {}) for label in labels]
    members = [Member(fit, 0.0, (label,)) for fit, label in zip(halves, labels, strict=True)]
    both = Explanation.of(members, at(halves, data), 0.0, fine=True)
    weighed = Hypothesis(both, NoiseState(), (), 0.0)
    found = told(weighed, (0.1, 0.9))
    (latency,) = found.hypothesis.explanation.fits
    std = np.sqrt(found.hypothesis.moments[1][0, 0]) * latency.scale[0]
    assert abs(latency.values[0] - 2.0) < 4.0 * std < 0.1
    assert found.places(1) == [(found.hypothesis, 0, 1.0)]
    assert found.places(0) == [(weighed, 0, 1.0)]
    assert told(weighed, (0.92, 0.95)).hypothesis is weighed
    unsure = told(weighed, (0.6, 0.95))
    assert unsure.hypothesis is weighed
    (as_weighed, *_), (otherwise, number, share) = unsure.places(1)
    assert (as_weighed, number, share) == (weighed, 0, pytest.approx(0.4))
    assert otherwise.explanation.fits[0].values == pytest.approx(latency.values)


def test_of_latencies_any_two_of_which_do_the_same_each_sensor_has_its_own(arm: Arm) -> None:
    """That of both sensors and that of one make what those of each sensor do: no one of the three stands for another.
    Of the three sets the one is told whose effects share no channel; its mass is that of all."""
    late = [("latency", {"where": where, "delay_s": 2.0 + by}) for where, by in ((SENSORS[0], 1.0), (SENSORS[1], 0.0))]
    run = recorded_by(3, *late)
    data = set_up(run, estimated_floor(run, arm), arm)
    every = {each.label: each for each in all_candidates(data)}
    accelerometer, magnetometer, both = (f"latency@{where}" for where in (*SENSORS, "acquisition"))
    hypotheses = []
    for mass, own in (
        (0.0, (both, accelerometer)),
        (-0.01, (both, magnetometer)),
        (-0.02, (accelerometer, magnetometer)),
    ):
        fits = [Fitted(every[label], np.ones(1), {}) for label in own]
        members = [Member(fit, 0.0, (label,)) for fit, label in zip(fits, own, strict=True)]
        found = converged(fits, data)
        hypotheses.append(Hypothesis(Explanation.of(members, found, 0.0, fine=True), NoiseState(), (), mass))
    posterior = Posterior(tuple(hypotheses), None, None, None)  # type: ignore[arg-type]
    (told_of,) = merged(posterior).hypotheses
    assert told_of.explanation.key == (accelerometer, magnetometer)
    assert told_of.log_mass == pytest.approx(np.logaddexp.reduce([0.0, -0.01, -0.02]))
    ahead = replace(hypotheses[0], terms=("something unknown",), log_mass=20.0)  # type: ignore[arg-type]
    beside = merged(replace(posterior, hypotheses=(ahead, *hypotheses))).hypotheses
    assert [one.explanation.key for one in beside] == [ahead.explanation.key, told_of.explanation.key]
    alone = replace(posterior, hypotheses=(told_of,))
    assert merged(alone).hypotheses == (told_of,)
    assert twins(alone) == {}


def test_weights_that_were_given_are_told() -> None:
    run, locked = recorded()
    without = [name for name in EFFECTS if name != "backlash"]
    plain, weighed = (estimators.diagnose(run, locked, without=without, prior=own) for own in (None, {"backlash": 5.0}))
    assert plain.warnings == ()
    assert weighed.warnings == ("the probabilities rest on given weights of effects: backlash 5",)


def test_of_an_effect_that_is_there_twice_the_first_is_there_where_either_is() -> None:
    assert _at_least([0.9, 0.5]) == pytest.approx([0.95, 0.45])
    assert _at_least([0.9, 0.6, 0.5]) == pytest.approx([0.98, 0.75, 0.27])
    assert _at_least([0.7]) == pytest.approx([0.7])
