"""Pairs of effects that explain together what neither does alone."""

from __future__ import annotations

import numpy as np
import pytest
from whitened_examples import recorded

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.hypotheses.considered import set_prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import Explained, evidence
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.pairs import paired
from rig.arm import Arm

SCALE, DROOP = "joint_scale@joint5", "joint_compliance@joint5"
TOGETHER = (
    ("joint_scale", {"where": "joint5", "scale": 0.0025}),
    ("joint_compliance", {"where": "joint5", "droop_rad": 0.0037}),
)


def of_scale_and_droop(arm: Arm) -> WhitenedData:
    run = recorded(1, *TOGETHER)
    return set_up(run, estimated_floor(run, arm), arm)


def test_two_effects_explain_what_least_squares_with_both_does(arm: Arm) -> None:
    """To rounding, ranks included, whichever of the two comes first; an effect of several strengths is among them."""
    data = of_scale_and_droop(arm)
    names = (SCALE, DROOP, "joint_eccentricity@joint5", "base_dipole@base", "field_gradient@base")
    scanner = Scanner.of(data)
    explained = Explained(scanner.rough.data.absorbed, scanner.rough.data.whitened)
    tests = [scanner.rough.best(each, explained)[0] for each in all_candidates(data) if each.label in names]
    assert len(tests) == len(names)
    found = paired(tests, scanner.rough, explained)
    every = []
    for tested in tests:
        own = scanner.rough.columns(tested.candidate, tested.shape)
        every.append(np.zeros((scanner.rough.data.size, own.values.shape[1])))
        every[-1][own.rows] = own.values / np.linalg.norm(own.values, axis=0)
    for i, first in enumerate(every):
        for j, second in enumerate(every):
            columns = explained.without(np.hstack([first, second]))
            values, vectors = np.linalg.eigh(columns.T @ columns)
            kept = values > 1e-5
            along = vectors[:, kept].T @ (columns.T @ explained.residual)
            if i != j:
                expected = evidence(float(np.sum(along**2 / values[kept])), int(kept.sum()))
                assert found[i, j] == pytest.approx(expected, rel=2e-3, abs=0.1)
    assert found == pytest.approx(found.T, rel=1e-6, abs=1e-6)


def test_two_effects_are_found_that_one_does_the_same_as(arm: Arm) -> None:
    """A scale and a droop of one joint, 30 sigma each, are an eccentricity of it but for a few nats: alone, either is
    hundreds of nats behind that."""
    data = of_scale_and_droop(arm)
    labels = (SCALE, DROOP, "joint_eccentricity@joint5")
    candidates = [each for each in all_candidates(data) if each.label in labels]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    found = {each.key: each for each in search.run()}
    wave, both = found["joint_eccentricity@joint5",], found[DROOP, SCALE]
    assert abs(both.log_mass - wave.log_mass) < 10.0
    assert max(search.gained(search.fitted((member,))) for member in both.members) < search.gained(wave) - 50.0


def test_beside_what_needs_single_samples_means_are_worth_what_these_tell(arm: Arm) -> None:
    """Means over six samples tell dozens of nats less of a motor's field than these do: enough to lose against what is
    weighed on samples. Of the set that leads its factor is exact; of another that one's is taken, to half a percent."""
    made: list[tuple[str, dict[str, object]]] = [
        ("motor_current_field", {"where": "joint6", "field": (-0.0012, 0.0173, -0.0315)}),
        ("motor_current_field", {"where": "joint1", "field": (0.0012, -0.0011, -0.0021)}),
        ("hysteresis", {"where": "mag2", "half_width": 0.01}),
    ]
    run = recorded(1, *made, decimation=50)
    data = set_up(run, estimated_floor(run, arm), arm)
    labels = [f"{name}@{values['where']}" for name, values in made]
    candidates = {each.label: each for each in all_candidates(data) if each.label in labels}
    assert [candidates[label].smooth for label in labels] == [True, True, False]
    every = list(candidates.values())
    search = Search(Scanner.of(data), every, set_prior(every, {}, data, {}), wide=True)

    def added(to: Explanation, label: str) -> Explanation:
        return search.fitted(next(each for each in search.additions(to, 3) if each[-1].label == label))

    field = added(search.fitted(()), labels[0])
    both = added(field, labels[1])
    roughly = [search.gained(each) for each in (field, both)]
    added(both, labels[2])
    for each, before in zip((field, both), roughly, strict=True):
        told = search.fine(each.members, each).log_mass - search.fine(()).log_mass
        assert before < told - 30.0
        assert search.gained(each) == pytest.approx(told, rel=1e-6 if each is both else 5e-3)


def test_a_set_whose_effects_do_nothing_without_one_of_them_is_ranked(arm: Arm) -> None:
    """What single samples add to its slow effects is not to be had; the search goes on, by what the whole set gains."""
    warming = {"where": "accelerometer", "coefficient": (0.003, -0.006, 0.003), "tau_s": 300.0}
    run = recorded(3, ("hysteresis", {"where": "mag3", "half_width": 0.0044}), ("bias_warmup", warming), decimation=25)
    data = set_up(run, estimated_floor(run, arm), arm)
    candidates = [each for each in all_candidates(data) if each.effect.name in ("hysteresis", "bias_warmup")]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    both = next(each for each in search.run() if len({member.fit.candidate.smooth for member in each.members}) == 2)
    before = search.gained(both)
    slow = search.fine([member for member in both.members if member.fit.candidate.smooth])
    vars(slow)["log_mass"] = -np.inf  # as where one of them does nothing
    assert search.gained(both) == pytest.approx(both.log_mass - search.fine(()).log_mass)
    assert search.gained(both) == pytest.approx(before, rel=0.1)
    assert search._refined()


def test_two_effects_are_tried_in_the_place_of_two(arm: Arm) -> None:
    """A play and a late sensor: from those of another joint and of the other sensor to the true ones, which are not
    tried one by one then."""
    true, others = ("backlash@joint5", "latency@magnetometer"), ("backlash@joint1", "latency@accelerometer")
    late = {"where": "magnetometer", "delay_s": 0.05}
    run = recorded(2, ("backlash", {"where": "joint5", "width_rad": 0.008}), ("latency", late))
    data = set_up(run, estimated_floor(run, arm), arm)
    candidates = [each for each in all_candidates(data) if each.label in (*true, *others)]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    before = search.fitted(())
    for label in others:
        (tested,) = [each for each in search.score_tests(before) if each.candidate.label == label]
        before = search.fitted((*before.members, search._member([tested], before)))
    assert before.key == others
    search._pair(before)
    found = {each.key: each for each in search.found.values()}
    assert found[true].log_mass > before.log_mass
    assert not any(set(key) == {one, other} for key in found for one in true for other in others)
