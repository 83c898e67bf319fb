"""What the noise may be beside a set of causes: a floor that walks is learned beside those that it does not replace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import scenario as small
from scipy.stats import binom
from whitened_examples import recorded

import estimators
import scenarios
from estimators.gap.data.basefit import estimated_floor, posed, set_up
from estimators.gap.data.laid_out import floor_and_step
from estimators.gap.evidence.states import SLOWER, NoiseState
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.hypotheses.considered import set_prior, unseen_places, visible
from estimators.gap.hypotheses.noise_effects import fit_effect
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation, Member
from estimators.gap.search.noises import Noises, Promise
from estimators.gap.search.posterior import explain
from rig.arm import Arm
from rig.effects import EFFECTS, Effect, make_effect
from rig.effects._numerics import gauss_markov
from rig.maneuver import LockedPoses
from rig.recording import Recording

WALK = make_effect("noise_coloured", {"where": "accelerometer", "tau_s": 5000.0, "sigma_V": (0.015,) * 3})
WARMUP = make_effect("bias_warmup", {"where": "accelerometer", "coefficient": (0.1, -0.1, 0.1), "tau_s": 240.0})


@pytest.fixture(scope="module")
def locked() -> Recording:
    rig = scenarios.load("ann-arbor").with_acquisition(decimation=1).rig
    poses = LockedPoses(hold_s=100.0, rate_Hz=20.0)
    return rig.simulate(poses, np.random.default_rng(7))


def beside_a_warmup(seed: int, locked: Recording, *effects: Effect) -> tuple[Promise, list[Promise]]:
    """A slower floor that was learned beside a warm-up of the accelerometer, and what it is beside less."""
    base = scenarios.load("ann-arbor").with_acquisition(decimation=200)
    run, arm = posed(base.with_effects(effects).simulate(seed=seed), None)
    data = set_up(run, floor_and_step(run, locked, arm)[0], arm)
    candidates = all_candidates(data)
    prior, scanner = set_prior(candidates, {}, data, {}), Scanner.of(data)
    own = [each for each in candidates if each.label == "bias_warmup@accelerometer"]
    search = Search(scanner, own, prior)
    (members,) = search.additions(search.fine(()), 1)
    noises = Noises(prior, (), at_rest=True)
    promises = noises.again([((NoiseState(), scanner), search.fine(members))])
    (one,) = [each for each in promises if each.state.name == SLOWER]
    return one, noises.beside_fewer(one)


def test_a_walk_that_looked_like_a_warmup_is_the_floor(locked: Recording) -> None:
    """Under the white floor that poses at rest show, the warm-up gained 50 to 150 nats in most of 12 draws; beside the
    floor that walks, it was dropped in 11 of them: three of four are not in four sets of a thousand."""
    told = 0
    for seed in range(4):
        one, fewer = beside_a_warmup(seed, locked, WALK)
        assert all(each.log_mass > one.log_mass for each in fewer)
        told += bool(fewer) and not fewer[-1].explanation.members
    assert told >= 2


def test_a_warmup_beside_a_walk_stays(locked: Recording) -> None:
    """It gains some 2,000 nats."""
    assert not beside_a_warmup(0, locked, WALK, WARMUP)[1]


@pytest.mark.parametrize("tau_s", [3.3, 12.0])
def test_how_long_coloured_noise_remembers_is_fitted_between_the_grid_and_beyond_it(
    tau_s: float,
) -> None:
    """As large as the floor on every axis: 95 % intervals of 40 draws, each bound of the counts once in 1e5 runs."""
    run, arm = recorded(1), Arm.a465()
    data = set_up(run, estimated_floor(run, arm), arm)
    held = {"tau_s": 0, "sigma_V": 0}
    for seed in range(40):
        rng = np.random.default_rng(seed)
        left = rng.standard_normal((len(data.columns), data.count))
        left[:3] += gauss_markov(data.t, tau_s, rng.standard_normal((data.count, 3))).T
        fitted = fit_effect(
            EFFECTS["noise_coloured"], "accelerometer", Left(data, Explained(data.absorbed, left.ravel()))
        )
        assert fitted is not None
        off = fitted.effect.strengths / [data.whiteners[column].sigma for column in range(3)] - 1.0
        held["sigma_V"] += int(np.sum(np.abs(off) * data.whiteners[0].sigma < 1.96 * fitted.std))
        held["tau_s"] += abs(float(vars(fitted.effect)["tau_s"]) - tau_s) < 1.96 * fitted.widths["tau_s"]
    assert held["tau_s"] >= binom.ppf(1e-5, 40, 0.93)
    assert held["sigma_V"] >= binom.ppf(1e-5, 120, 0.93)


def test_coloured_noise_is_the_floor_where_nothing_shows_that() -> None:
    """Of one sensor or of both, as large as the floor that neighbouring readings show: what a named noise gains, the
    floor gains as well, and the odds are those of the priors, some 40 to one; three nats are left in all of 8 draws."""
    run, arm = recorded(1), Arm.a465()
    floor = estimated_floor(run, arm)
    sigma = np.sqrt([channel.variance for channel in floor])
    for seed in range(8):
        rng = np.random.default_rng(seed)
        added = gauss_markov(run.t, 5.0, rng.standard_normal((len(run), 6))) * sigma
        noisy = replace(run, accelerometer=run.accelerometer + added[:, :3])
        if seed % 2:
            noisy = replace(noisy, magnetometer=run.magnetometer + added[:, 3:])
        data = set_up(noisy, floor, arm)
        candidates = all_candidates(data)
        prior, scanner = set_prior(candidates, unseen_places(data, ()), data, {}), Scanner.of(data)
        given, nothing = (NoiseState(), scanner), Search(scanner, candidates, prior).fine(())
        named = [each for each in Noises(prior, (), at_rest=True).beyond(given, nothing) if each.state.labels]
        found = Noises(prior, (), at_rest=False).as_floor(given, nothing)
        assert found[-1].state.labels == ()
        assert found[-1].log_mass > max(each.log_mass for each in named) + 3.0
        assert Noises(prior, (), at_rest=True).as_floor(given, nothing) == []


@pytest.mark.parametrize(
    ("noise", "tau_s"),
    [
        (make_effect("timing_jitter", {"where": "acquisition", "sigma_s": 0.05}), 5000.0),
        (make_effect("noise_excess", {"where": "mag3", "extra_sigma": 0.02}), 400.0),
    ],
    ids=["a clock that jitters", "noise in excess"],
)
def test_slow_noise_is_told_beside_noise_with_a_name(noise: Effect, tau_s: float, locked: Recording) -> None:
    """Beside either alone the other looks like something without a name: two draws, each by far.

    Slower than the recording it is the floor that goes on; a quarter as long, and in one sensor, it has a name.
    """
    slow = replace(WALK, tau_s=tau_s)
    for seed in range(2):
        base = scenarios.load("ann-arbor").with_acquisition(decimation=200)
        run, arm = posed(base.with_effects([slow, noise]).simulate(seed=seed), None)
        found = explain(set_up(run, floor_and_step(run, locked, arm)[0], arm)).leading
        assert f"{noise.name}@{noise.where}" in found.labels
        assert not found.other
        named = {"noise_coloured@accelerometer", "bias_random_walk@accelerometer"} & set(found.labels)
        assert named if tau_s < run.t[-1] - run.t[0] else found.state.name == SLOWER


def test_a_promise_that_leads_is_kept_only_where_its_effects_are_refitted(locked: Recording) -> None:
    """One that says its effects have far to go is worth what they are where they then are; the others stay as they are.

    Learned beside a warm-up that is there, a slower floor promises what it is worth, to a hundredth.
    """
    one, _ = beside_a_warmup(0, locked, WARMUP)
    data = one.explanation.data
    candidates = all_candidates(data)
    noises = Noises(set_prior(candidates, {}, data, {}), (), at_rest=True)
    assert noises.kept([one]) == [one]
    boasting = replace(one, log_mass=one.log_mass + 100.0, ahead=100.0)
    (kept,) = noises.kept([boasting])
    assert kept.log_mass == pytest.approx(one.log_mass, abs=0.05)
    assert kept.ahead == 0.0
    other = replace(one, log_mass=one.log_mass + 1.0)
    assert noises.kept([boasting, other]) == [other, kept]
    less = replace(boasting, log_mass=one.log_mass - 1.0)
    assert noises.kept([less, other]) == [other, less]


def test_a_state_is_worth_beside_an_explanation_what_it_promises_there(locked: Recording) -> None:
    one, _ = beside_a_warmup(0, locked, WARMUP)
    data = one.explanation.data
    candidates, _ = visible(data, one.given[1], ())
    noises = Noises(set_prior(candidates, unseen_places(data, ()), data, {}), (), at_rest=True)
    found = noises.beside(one.given, one.explanation, one.explanation.linear)
    assert found
    for each in found:
        worth = noises.worth(each.state, each.given, each.explanation, each.explanation.linear)
        assert worth == pytest.approx(each.log_mass, rel=1e-12)


def test_jitter_is_fitted_as_noise_that_follows_the_signal() -> None:
    """What a page whitens by. Jitter of a quarter of a second: a signal-to-noise far above what its size needs."""
    jitter = make_effect("timing_jitter", {"where": "acquisition", "sigma_s": 0.25})
    run = scenarios.load("ann-arbor").with_effects([jitter]).with_acquisition(decimation=100).simulate(seed=1)
    data = set_up(run, estimated_floor(run, Arm.a465()), Arm.a465())
    fitted = fit_effect(EFFECTS["timing_jitter"], "acquisition", Left(data, Explained(data.absorbed, data.whitened)))
    assert fitted is not None
    assert fitted.in_time
    assert fitted.added[:, 0].max() > 10.0 * fitted.added[:, 0].min()


def test_pose_noise_whose_times_begin_at_zero_is_fitted() -> None:
    noise = make_effect("pose_noise", {"where": "acquisition", "sigma_rad": 0.02, "tau_s": 0.0})
    run = (
        scenarios.load("ann-arbor").with_effects([noise]).with_acquisition(decimation=100, pose="tool").simulate(seed=1)
    )
    run, arm = posed(run, None)
    data = set_up(run, estimated_floor(run, arm), arm)
    fitted = fit_effect(EFFECTS["pose_noise"], "acquisition", Left(data, Explained(data.absorbed, data.whitened)))
    assert fitted is not None
    assert fitted.gain > 100.0
    assert fitted.effect.tau_s >= 0.0  # type: ignore[attr-defined]


def test_a_floor_that_walks_is_not_searched_for_sets_of_causes(
    locked: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is likelier than a cause is or nearly as likely, as a warm-up in one of three draws, and the search under it
    finds nothing."""
    fitted, sizes = Search.fitted, []

    def noted(search: Search, members: Sequence[Member]) -> Explanation:
        sizes.append(len(members))
        return fitted(search, members)

    monkeypatch.setattr(Search, "fitted", noted)
    for seed in range(3):
        run, arm = posed(
            scenarios.load("ann-arbor").with_acquisition(decimation=200).with_effects([WALK]).simulate(seed=seed), None
        )
        every = explain(set_up(run, floor_and_step(run, locked, arm)[0], arm)).hypotheses
        slower = next(each for each in every if (each.state.name, each.labels, each.terms) == (SLOWER, (), ()))
        assert slower.log_mass > every[0].log_mass - 2.5
    assert max(sizes) <= 3


def test_noise_beside_more_causes_is_asked_for_where_it_may_matter(locked: Recording) -> None:
    """What noise gains beside nothing, it gains at most beside a cause: far from likely, that is left out."""
    run, arm = posed(scenarios.load("ann-arbor").with_acquisition(decimation=200).simulate(seed=1), None)
    data = set_up(run, floor_and_step(run, locked, arm)[0], arm)
    candidates = all_candidates(data)
    prior, scanner = set_prior(candidates, unseen_places(data, ()), data, {}), Scanner.of(data)
    own = [each for each in candidates if each.label == "bias_warmup@accelerometer"]
    search, noises = Search(scanner, own, prior), Noises(prior, (), at_rest=True)
    nothing, given = search.fine(()), (NoiseState(), scanner)
    (members,) = search.additions(nothing, 1, -np.inf)
    one = search.fine(members)
    gained = max(each.log_mass for each in noises.beyond(given, nothing)) - nothing.log_mass
    just = one.log_mass + gained
    for least, there in ((just - 0.1, True), (just + 0.1, False)):
        found = noises.beyond_each(given, [one, nothing], least)
        assert any(each.explanation is nothing for each in found)
        assert any(each.explanation is one for each in found) is there


@pytest.mark.parametrize("seed", range(3))
def test_noise_of_two_channels_is_two_causes(seed: int) -> None:
    """Each of twice the floor's variance, which 600 readings tell to 6 %: noise without a name takes both at once, and
    costs more."""
    noises = [
        make_effect("noise_excess", {"where": "accel2", "extra_sigma": 0.02}),
        make_effect("noise_excess", {"where": "mag1", "extra_sigma": 0.012}),
    ]
    run = small().with_effects(noises).simulate(seed)
    found = estimators.diagnose(run, small().simulate_locked(seed), without=[n for n in EFFECTS if n != "noise_excess"])
    assert found.hypotheses[0].causes == (("noise_excess", "accel2"), ("noise_excess", "mag1"))
    assert found.posterior["known"] > 0.5
