"""What a diagnosis lets go of is made anew where it is asked for, and what it does a part at a time is the same."""

from __future__ import annotations

import numpy as np
import pytest
from whitened_examples import data, discrepancies, recorded, unexplained  # noqa: F401

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence import discrepancy
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.discrepancy import Discrepancies, weighed_terms
from estimators.gap.evidence.refine import Fitted
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.search import explanation
from estimators.gap.search.explanation import Explanation, Member
from rig.arm import Arm

DRIFT = {"where": "magnetometer", "coefficient_per_degC": (0.05, 0.02, -0.1)}


def explained(drifting: WhitenedData, size: float) -> Explanation:
    label = "bias_temperature@magnetometer"
    candidate = next(each for each in all_candidates(drifting) if each.label == label)
    refitted = converged([Fitted(candidate, size * np.array([0.05, 0.02, -0.1]), {})], drifting)
    return Explanation.of([Member(refitted.fits[0], 0.0, (label,))], refitted, -3.0, fine=True)


def test_what_is_let_go_is_made_anew(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an explanation that a later one takes the place of, the evidence is kept; its arrays, asked for again, are
    those of before but for where the derivatives were taken: within the quarter of a square that a refit leaves."""
    run = recorded(1, ("bias_temperature", DRIFT))
    drifting = set_up(run, estimated_floor(run, arm), arm)
    first = explained(drifting, 1.0)
    monkeypatch.setattr(explanation, "_NUMBERS", first.linear.tangent.size)
    before, mass = first.linear, first.log_mass
    assert first.linear is before
    second = explained(drifting, 0.5)
    assert second.linear is second.linear
    again = first.linear
    assert again is not before
    assert first.log_mass == mass
    np.testing.assert_allclose(again.left, before.left, atol=1e-6)
    np.testing.assert_allclose(again.tangent, before.tangent, rtol=1e-3, atol=1e-3 * np.abs(before.tangent).max())
    assert again.averaged[0] + first.log_prior == pytest.approx(mass, abs=0.25)


def test_terms_are_weighed_alike_some_at_a_time(
    data: WhitenedData,  # noqa: F811
    discrepancies: Discrepancies,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To rounding, in whatever number."""
    rng = np.random.default_rng(5)
    linear, some = unexplained(data.whitened + rng.standard_normal(data.size)), discrepancies.terms[::40]
    at_once = {(one.term.source, one.term.course): one.log_mass for one in weighed_terms(linear, some)}
    assert len(at_once) > 7
    monkeypatch.setattr(discrepancy, "_TERMS", 3)
    for one in weighed_terms(linear, some):
        assert one.log_mass == pytest.approx(at_once[one.term.source, one.term.course], abs=1e-9)
