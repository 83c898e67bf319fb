"""What is weighed beside something without a name, and what need not be."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import scenarios
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies, weighed
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.hypotheses.considered import set_prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.search import further_unknowns
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.further_effects import further_effects
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.noises import Noises
from estimators.gap.search.posterior import NoiseState
from estimators.gap.search.weighing import FAR, HARDLY, NEAR, UNKNOWN, Weighing
from rig.arm import Arm
from rig.effects import make_effect

STATE = NoiseState()


@cache
def of_a_dipole(arm: Arm) -> tuple[WhitenedData, Weighing, Search]:
    dipole = make_effect("base_dipole", {"where": "base", "position_m": (0.5, 0.1, 0.2), "moment": (4e-4, 2e-4, -2e-4)})
    run = scenarios.load("ann-arbor").with_acquisition(decimation=100).with_effects([dipole]).simulate(seed=1)
    data = set_up(run, estimated_floor(run, arm), arm)
    candidates = [each for each in all_candidates(data) if each.label in ("base_dipole@base", "joint_offset@joint3")]
    prior, scanner = set_prior(candidates, {}, data, {}), Scanner.of(data)
    work = Weighing(scanner, candidates, Noises(prior, (), at_rest=True), progress=None)
    return data, work, Search(scanner, candidates, prior)


def fresh(arm: Arm) -> tuple[Weighing, Search, Explanation]:
    _, work, search = of_a_dipole(arm)
    clean = Weighing(work.scanner, work.candidates, work.noises, None)
    clean.discrepancies = work.discrepancies_under(STATE, work.scanner)
    return clean, search, search.run()[0]


def nameless(work: Weighing, each: Explanation, gained: float) -> Hypothesis:
    """A set beside its likeliest discrepancy, as if this gained so much."""
    assert work.discrepancies is not None
    (first, *_) = weighed(each.linear, work.discrepancies)
    return Hypothesis(each, STATE, (first,), work.known(each, STATE) + UNKNOWN + gained)


@pytest.mark.parametrize("gained", [0.5 * HARDLY, 2.0 * HARDLY])
def test_nothing_is_looked_for_beside_a_discrepancy_that_is_not_asked_for(gained: float, arm: Arm) -> None:
    """Neither another effect nor a second discrepancy; beside one that is, both are."""
    work, search, dipole = fresh(arm)
    found = nameless(work, dipole, gained)
    work.enter(work.alone(dipole, STATE))
    work.enter(found)
    asked_for = gained > HARDLY
    assert work.asked_for(found) is asked_for
    more = list(further_effects(found, [found], search, asked_for, np.inf))
    assert not more or asked_for
    before = len(work.hypotheses)
    further_unknowns.weigh_further(work)
    assert (len(work.hypotheses) > before) is asked_for


def test_an_effect_is_tried_in_the_place_of_one_that_is_hardly_needed(arm: Arm) -> None:
    """Where a discrepancy does about as well without a cause, others are tried in its place beside that, whether or not
    one is asked for beside the cause: what is asked of the search tells."""
    work, search, dipole = fresh(arm)
    found, without = nameless(work, dipole, 0.0), nameless(work, search.fine(()), 0.0)
    asked: list[tuple[str, ...]] = []

    class Asked(Search):
        def beside(self, parent: Explanation, weighed: Weighed) -> list[Explanation]:
            assert weighed.gains is without.terms[0].gains
            asked.append(parent.key)
            return []

    one = Asked(work.scanner, work.candidates, work.noises.prior)
    for least, expected in ((without.log_mass - 1.0, [()]), (without.log_mass + 1.0, [])):
        asked.clear()
        list(further_effects(found, [found, without], one, False, least))
        assert asked == expected


@pytest.mark.parametrize("behind", [0.5 * (NEAR + FAR), NEAR + FAR + 1.0])
def test_a_set_that_is_far_behind_beside_a_discrepancy_is_so_under_other_noise(behind: float, arm: Arm) -> None:
    """It is not weighed there where it is a million times as unlikely as what already counts for nothing."""
    work, _, dipole = fresh(arm)
    work.enter(work.alone(dipole, STATE))
    found = replace(nameless(work, dipole, 0.0), log_mass=work.best - behind)
    work.enter(found)
    assert work._hopeless(dipole, NoiseState()) is (behind > NEAR + FAR)
    assert not work._hopeless(dipole, STATE)


def test_nothing_at_all_is_weighed_once_under_each_state_of_the_noise(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, search, _ = fresh(arm)
    nothing, calls = search.fine(()), list[NoiseState]()

    def entered(work: Weighing, each: Explanation, state: NoiseState, _: Discrepancies) -> list[Hypothesis]:
        calls.append(state)
        work.gains.append((state, each.key, 0.0))
        return []

    monkeypatch.setattr(Weighing, "enter_nameless", entered)
    other = NoiseState()
    for state in (STATE, STATE, other):
        assert work.discrepancies is not None
        work._beside([nothing], state, search, work.discrepancies)
    assert [each is STATE for each in calls] == [True, False]


def test_nothing_further_is_told_of_what_cause_and_discrepancy_leave_as_they_cancel(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where more is left beside a discrepancy than without it: a second one would explain the first."""
    work, _, dipole = fresh(arm)
    found = nameless(work, dipole, 5.0)
    work.enter(found)
    assert work.discrepancies is not None
    assert further_unknowns._with_further(work, found, work.discrepancies).further
    monkeypatch.setattr(further_unknowns, "left_beside", lambda linear, *_: replace(linear, left=1.1 * linear.left))
    assert further_unknowns._with_further(work, found, work.discrepancies) is found
