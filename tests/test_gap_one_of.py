"""Causes of which at least one is there, against the sums that say so; and places that are one."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from estimators.gap.diagnosis import OneOf
from estimators.gap.evidence.states import NoiseState
from estimators.gap.report.marginal import twins
from estimators.gap.report.one_of import at_least_one

DIPOLE, GRADIENT, LAG, STEP = (
    ("base_dipole", "base"),
    ("field_gradient", "base"),
    ("sensor_lag", "a"),
    ("bias_step", "b"),
)


def test_causes_that_share_what_is_certain_are_told_together() -> None:
    found = at_least_one({(DIPOLE,): 0.3, (GRADIENT,): 0.4, (DIPOLE, GRADIENT): 0.28, (): 0.02})
    assert [one.causes for one in found] == [(GRADIENT, DIPOLE)]
    assert found[0].probability == pytest.approx(0.98)


def test_what_is_established_by_itself_and_what_stays_in_doubt_is_not_told() -> None:
    assert at_least_one({(LAG,): 0.5, (LAG, STEP): 0.5}) == ()
    assert at_least_one({(DIPOLE,): 0.45, (GRADIENT,): 0.45, (): 0.1}) == ()
    assert at_least_one({(): 1.0}) == ()


def test_a_cause_that_is_as_likely_without_the_others_is_none_of_them() -> None:
    """A step that is there or not, whatever else is."""
    both = {(DIPOLE,): 0.5, (GRADIENT,): 0.5}
    masses = {(*causes, *extra): mass * 0.5 for causes, mass in both.items() for extra in ((), (STEP,))}
    assert at_least_one(masses) == (OneOf((DIPOLE, GRADIENT), 1.0),)


def test_places_that_do_the_same_are_one_under_whatever_floor_they_were_fitted() -> None:
    """Irons of two links of which no joint between them moves, each found beside another floor."""

    def of(state: str, log_mass: float, *labels: str) -> SimpleNamespace:
        member = SimpleNamespace(label=labels[0], labels=labels)
        explanation = SimpleNamespace(key=(labels[0],), members=(member,))
        return SimpleNamespace(log_mass=log_mass, terms=(), state=NoiseState(name=state), explanation=explanation)

    first, third = "link_soft_iron@link1", "link_soft_iron@link3"
    hypotheses = [of("", 0.0, third, first), of("slower floor", -1.5, first, third), of("", -9.0, "backlash@joint5")]
    assert twins(SimpleNamespace(hypotheses=hypotheses)) == {first: third}  # type: ignore[arg-type]
    alone = [of("", 0.0, third), of("slower floor", -1.5, first)]
    assert twins(SimpleNamespace(hypotheses=alone)) == {}  # type: ignore[arg-type]
