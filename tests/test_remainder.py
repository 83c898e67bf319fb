"""The test of what a fitted rig leaves of a fresh recording: its false-refusal rate, and what it refuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from diagnosed_recordings import BACKLASH, backlash, recorded, scenario
from scipy.stats import binom

from estimators.gap.data.basefit import learn_floor, set_up
from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.hypotheses.considered import set_prior, unseen_places, visible
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.report.fitted_rig import REFUSED
from estimators.gap.report.remainder_test import p_value
from estimators.gap.search.beam import Search
from rig.effects import Effect, make_effect
from rig.effects.parameters import Value

RECORDINGS = 3


def data_of(effect: Effect, rig: Effect, seed: int) -> tuple[WhitenedData, WhitenedData]:
    """A recording beside the ideal rig, and beside a fitted one."""
    run, locked = recorded(effect, seed=seed)
    floor = learn_floor(locked, float(np.median(np.diff(run.t))))
    ideal, fitted = (set_up(run, floor, scenario().rig.arm, given) for given in ((), (rig,)))
    return ideal, fitted


def p_values_of(data: WhitenedData, *stds: Sequence[Mapping[str, Value]]) -> list[float]:
    """With each of the standard deviations of the fitted rig."""
    scanner = Scanner.of(data)
    candidates, _ = visible(data, scanner, ())
    prior = set_prior(candidates, unseen_places(data, ()), data, {})
    search = Search(scanner, [each for each in candidates if not each.effect.tone], prior)
    search.score_tests(search.fitted(()))  # tones are not part of the test, and slow
    discrepancies = Discrepancies.of(search.data, search.rough)
    return [p_value(scanner, discrepancies, candidates, prior, std) for std in stds]


def test_the_true_rig_is_refused_as_often_as_stated() -> None:
    found = np.array([p_values_of(data_of(backlash(), backlash(), seed)[1], ())[0] for seed in range(RECORDINGS)])
    # the chance that a true rate of 5 % gives more than this many: below 1e-3
    assert np.sum(found <= REFUSED) <= binom.isf(1e-3, RECORDINGS, REFUSED)


def test_a_wrong_cause_that_leaves_ten_sigma_is_refused() -> None:
    truth, wrong = backlash(), make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.012})
    ideal, fitted = data_of(truth, wrong, 0)
    left = ideal.whiten(ideal.change([truth]) - ideal.change([wrong]))
    assert np.linalg.norm(project(ideal.absorbed, left)) > 10.0
    assert p_values_of(fitted, ())[0] <= REFUSED


def test_a_rig_is_known_no_better_than_it_was_fitted() -> None:
    """A width off by ten standard deviations of this recording: refused as exact, and not as one that may be so off."""
    truth = backlash()
    ideal, _ = data_of(truth, truth, 0)
    width = BACKLASH["width_rad"]
    slope = project(ideal.absorbed, ideal.whiten(ideal.change([truth]) - ideal.change([wider(1e-3 * width)])))
    off = 10.0 * 1e-3 * width / float(np.linalg.norm(slope))
    _, fitted = data_of(truth, wider(off), 0)
    exact, known = p_values_of(fitted, (), [{"width_rad": off}])
    assert exact <= REFUSED
    # one standard deviation and a tenth of noise: a p-value below .05 needs two
    assert known > REFUSED


def wider(by: float) -> Effect:
    return make_effect("backlash", {**BACKLASH, "width_rad": BACKLASH["width_rad"] + by})
