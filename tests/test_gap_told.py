"""Which hypothesis a diagnosis' figures are of: one with the causes of the explanation that is listed first."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from diagnosed_recordings import recorded

import estimators
from estimators.gap.diagnosis import Hypothesis
from estimators.gap.report.marginal import Place
from estimators.gap.report.summary import _at_least, _told_of
from rig.effects import EFFECTS

DIPOLE = ("base_dipole", "base")
PLACES = {"base_dipole@base": Place(((*DIPOLE, 1.0),)), "latency@mag": Place((("latency", "mag", 1.0),))}


def found(*labels: str, other: bool = True) -> Any:
    members = [SimpleNamespace(label=label) for label in labels]
    return SimpleNamespace(explanation=SimpleNamespace(members=members), state=SimpleNamespace(labels=()), other=other)


def told(hypotheses: list[Any], doubted: dict[int, tuple[float, ...]], *causes: tuple[str, str]) -> Any:
    posterior = SimpleNamespace(hypotheses=hypotheses, leading=hypotheses[0])
    first = [Hypothesis(causes, True, 0.5)]
    return _told_of(posterior, PLACES, {}, doubted, first, (), False)[0]  # type: ignore[arg-type]


def test_the_figures_are_of_the_explanation_that_is_listed_first() -> None:
    """A dipole leads by its mass; it is doubted in a set with another effect, or so that most are without it."""
    dipole, nothing, doubtful = found("base_dipole@base"), found(), found("latency@mag")
    every, doubted = [dipole, doubtful, nothing], {0: (0.6,), 1: (0.2,)}
    assert told(every, doubted, DIPOLE) is dipole
    assert told(every, doubted) is nothing  # with no cause that is doubted, where there is one
    assert told([dipole, doubtful], doubted) is doubtful
    assert told([dipole], {0: (0.6,)}) is dipole  # nothing else was weighed


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
