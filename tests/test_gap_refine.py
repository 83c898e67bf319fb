"""Refits of causes to a recording, and shares in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from whitened_examples import recorded

import scenarios
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.projection import Basis, Columns, project
from estimators.gap.data.rebase import rebased
from estimators.gap.data.tangent import stepped
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence import converge
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.laplace import linearised
from estimators.gap.evidence.refine import Fitted, _Point, _Problem, _Slopes, explained_by, refit, started, tangents
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.hypotheses.considered import set_prior
from estimators.gap.hypotheses.scan import Scanner, ScoreTest
from estimators.gap.hypotheses.score import ABSORBED, Explained, Score
from estimators.gap.search import posterior, weighing
from estimators.gap.search.beam import Search
from estimators.gap.search.explanation import Explanation, Member
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.noises import Noises, Promise
from estimators.gap.share_words import percent
from rig.arm import Arm
from rig.effects import Effect, make_effect


@cache
def whitened_data(seed: int, arm: Arm, *effects: Effect, decimation: int = 100) -> WhitenedData:
    """1,664 samples, or so many that means over neighbours are looked at first, where every 80th is kept."""
    base = scenarios.load("ann-arbor").with_acquisition(decimation=decimation)
    run = base.with_effects(effects).simulate(seed=seed)
    return set_up(run, estimated_floor(run, arm), arm)


def first_fit(data: WhitenedData, label: str) -> Fitted:
    scanner = Scanner.of(data)
    explained = Explained(data.absorbed, data.whitened)
    (candidate,) = [each for each in all_candidates(data) if each.label == label]
    (tested,) = scanner.scan([candidate], explained, explained_by([], scanner.rough.data))
    return started(tested, data, explained)


DIPOLE = make_effect("base_dipole", {"where": "base", "position_m": (0.5, 0.1, 0.2), "moment": (4e-4, 2e-4, -2e-4)})


def test_a_refit_reaches_the_minimum_of_least_squares(arm: Arm) -> None:
    """Within the chi-square at which it stops, of what scipy finds with derivatives at every step."""
    data = whitened_data(1, arm, DIPOLE)
    fit = first_fit(data, "base_dipole@base")
    explained = refit([fit], data).explained

    def left(point: np.ndarray) -> np.ndarray:
        change = data.change([replace(fit, values=point * fit.scale).effect])
        return data.whitened - project(data.absorbed, data.whiten(change))

    best = least_squares(left, fit.values / fit.scale, x_scale="jac", ftol=1e-10, xtol=1e-10)
    assert float(explained.residual @ explained.residual) < 2.0 * best.cost + 0.1


def test_a_frequency_is_told_to_the_bound_of_a_recording_so_long(arm: Arm) -> None:
    """sqrt(12) / (2 pi T snr) (Rife and Boorstyn, IEEE Transactions on Information Theory 20, 1974), of a vibration
    along one of the base's axes: within five of these, and said to a tenth, as the sensor turns under it."""
    true = 0.3137
    fixed = {"where": "accelerometer", "amplitude_m_s2": 0.3, "freq_Hz": true, "direction": (0.0, 0.0, 1.0)}
    data = whitened_data(1, arm, make_effect("vibration", fixed))
    candidates = [each for each in all_candidates(data) if each.effect.name == "vibration"]
    (candidate,) = [each for each in candidates if "base" in each.names.values()]
    found = refit([first_fit(data, candidate.label)], data)
    snr = float(np.linalg.norm(project(data.absorbed, data.whiten(data.change([found.fits[0].effect])))))
    linear = linearised(found)
    covariance = linear.posterior(linear.likeliest)[1] * np.outer(*2 * [found.fits[0].scale])
    (place,) = [n for n, name in enumerate(_names(found.fits[0])) if name == "freq_Hz"]
    bound = np.sqrt(12.0) / (2.0 * np.pi * float(np.ptp(data.t)) * snr)
    assert np.sqrt(covariance[place, place]) == pytest.approx(bound, rel=0.1)
    assert abs(found.fits[0].values[place] - true) < 5.0 * bound


def _names(fit: Fitted) -> list[str]:
    return [item.name for item in fit.free for _ in range(item.size)]


def test_rivals_of_the_leading_set_are_fitted_as_it_is(arm: Arm) -> None:
    """A hysteresis is not straight: to first order, where means over neighbours put it, a set with it is a nat too
    unlikely here, and the one that was fitted would lead by as much."""
    warming = {"where": "accelerometer", "coefficient": (0.003, -0.006, 0.003), "tau_s": 300.0}
    play, early = {"where": "mag3", "half_width": 0.0044}, {"where": "magnetometer", "delay_s": -0.113}
    run = recorded(3, ("hysteresis", play), ("latency", early), ("bias_warmup", warming), decimation=25)
    data = set_up(run, estimated_floor(run, arm), arm)
    names = ("hysteresis", "bias_warmup", "bias_temperature", "latency")
    candidates = [each for each in all_candidates(data) if each.effect.name in names]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    best, *others = search.run()
    rivals = [each for each in others if each.log_mass > best.log_mass - 5.0]
    assert rivals
    for each in rivals:
        fitted = linearised(converged(each.fits, each.data)).averaged[0]
        assert each.linear.averaged[0] > fitted - 0.3  # what first order may be off by, and what a fit leaves


def test_derivatives_of_a_fit_that_went_far_are_those_where_it_ended(arm: Arm) -> None:
    """A dipole that starts half as strong, 5 cm off: what is handed on is not what was foretold at the start."""
    data = whitened_data(1, arm, DIPOLE)
    fit = first_fit(data, "base_dipole@base")
    best = refit([fit], data).fits[0].values
    away = replace(fit, values=best + np.array([0.05, -0.05, 0.0, *(-0.5 * best[3:])]))
    found = refit([away], data)
    whole = found.fits[0].tangent(data)
    np.testing.assert_allclose(found.columns, whole, rtol=0.0, atol=1e-6 * np.abs(whole).max())


def test_derivatives_are_taken_beside_what_touches_the_same_channels(arm: Arm) -> None:
    """To the last bits those beside all others: of a lag of each sensor, a magnet, and a channel that reads another."""
    data = whitened_data(1, arm, DIPOLE)
    labels = ["base_dipole@base", "sensor_lag@accelerometer", "sensor_lag@magnetometer", "scale_cubic@accel2"]
    fits = [first_fit(data, label) for label in labels]
    moved = [replace(fit, values=np.abs(fit.values) + 0.1 * fit.scale) for fit in fits]
    touched = [each.touched(data).tolist() for each in moved]
    mag = [False] * 3 + [True] * 3
    assert touched == [mag, [not each for each in mag], mag, [False, True, False, False, False, False]]
    crossed = next(each for each in all_candidates(data) if each.effect.name == "channel_crosstalk")
    size = Fitted(crossed, np.full(1, 0.01), {})
    for fitted in (moved, [*moved, size]):
        still = data.change([each.effect for each in fitted])
        for index, found in enumerate(tangents(fitted, data)):
            moves = fitted[index].step / fitted[index].scale
            for column, more, size in zip(found.T, fitted[index].moved, moves, strict=True):
                ahead = data.change([more if each is fitted[index] else each.effect for each in fitted])
                whole = data.whiten(ahead - still) / size
                np.testing.assert_allclose(column, whole, rtol=0.0, atol=1e-6 * np.abs(whole).max())


def test_what_the_calibration_absorbs_is_not_fitted(arm: Arm) -> None:
    """Iron in link 1, which turns about the vertical: the trace across it is a change of sensitivity."""
    iron = make_effect("link_soft_iron", {"where": "link1", "chi": (0.05, 0.0, -0.05, 0.03, 0.0, 0.02)})
    data = whitened_data(2, arm, iron)
    (fit,) = refit([first_fit(data, "link_soft_iron@link1")], data).fits
    tangent = fit.tangent(data)
    length = np.linalg.norm(tangent, axis=0)
    seen = project(data.absorbed, tangent / length)
    values, vectors = np.linalg.eigh(seen.T @ seen)
    hidden = vectors[:, values < ABSORBED**2]
    assert hidden.shape[1] >= 1
    # in units of what every direction does to the readings: hidden ones stay where the start put them, near zero
    strengths = fit.values / fit.scale * length
    assert np.abs(hidden.T @ strengths).max() < 0.1 * np.abs(strengths).max()


@pytest.mark.parametrize(
    ("shares", "text"),
    [
        ((0.5,), "50 %"),
        ((0.97, 0.95, 0.99), "97 % (95-99)"),
        ((0.9991, 0.9987, 1.0), "99.9 % (99.9-100)"),
        ((1.0, 1.0, 1.0), "100 %"),
        ((0.64, -1.0, 0.96), "64 % (-100 to 96)"),
        ((None,), "–"),
    ],
)
def test_shares_are_said_to_a_tenth_close_to_everything(shares: tuple[float | None, ...], text: str) -> None:
    assert percent(*shares) == text


def test_a_search_of_any_length_has_its_price(arm: Arm) -> None:
    """Where what is left is a billion times the noise, an instant was one of more than a machine's integers count."""
    (candidate, *_) = all_candidates(whitened_data(1, arm))
    score = Score(100.0, 1, np.ones(1), 1.0)
    tested = ScoreTest(candidate, {}, score, searched=10**25)
    assert tested.log_p - score.log_p == pytest.approx(25.0 * np.log(10.0))
    assert tested.evidence < score.evidence


def test_an_onset_that_changes_no_number_is_nothing(arm: Arm) -> None:
    """A step of millivolts in readings of a trillion volts."""
    data = whitened_data(1, arm)
    (candidate,) = [each for each in all_candidates(data) if each.label == "bias_step@accel1"]

    class Still(type(candidate)):  # type: ignore[misc]
        def columns(self, data: WhitenedData, shape: object) -> Columns:
            return Columns(np.empty((0, 1)), 0)

    still = Still(**vars(candidate))
    (tested,) = Scanner.of(data).scan([still], *2 * [Explained(data.absorbed, data.whitened)])
    assert (tested.score.statistic, tested.score.rank, tested.evidence) == (0.0, 0, 0.0)


def test_what_nothing_shows_is_not_moved(arm: Arm) -> None:
    """A phase of what has no amplitude: its derivative is rounding, and a step along it was one of 1e135 rad."""
    columns, left = np.array([[2.0, 0.0], [0.0, 1e-130]]), np.array([1.0, 1e5])
    slopes = _Slopes(np.zeros(2), columns, columns.T @ columns, Basis((), 2), np.zeros(2))
    step = slopes.step(_Point(np.zeros(2), [], np.zeros(0), left, 0.0, np.zeros(2), np.zeros(2)), 0.0)
    np.testing.assert_allclose(step, [0.5, 0.0], rtol=1e-9, atol=0.0)
    data = whitened_data(1, arm)
    fit = Fitted(next(each for each in all_candidates(data) if each.label == "scale_cubic@mag1"), np.zeros(1), {})
    assert _Problem([fit], data).at(np.array([1e70])).misfit == np.inf


def test_a_drift_without_an_end_tells_a_slope_and_no_time(arm: Arm) -> None:
    """A warm-up twelve times slower than the recording is a straight line, which any slow one is: the time is fitted
    where it is expected, within what a normal prior leaves (three and a half widths cost six nats)."""
    drift = make_effect("bias_warmup", {"where": "magnetometer", "coefficient": (0.6, -0.6, 0.6), "tau_s": 2e4})
    data = whitened_data(1, arm, drift)
    candidate = next(each for each in all_candidates(data) if each.label == "bias_warmup@magnetometer")
    start = Fitted(candidate, np.array([0.1, -0.1, 0.1, 1920.0]), {})
    found = converged([start], data)
    linear = linearised(found)
    assert abs(linear.pull[3] / linear.width[3]) < 3.5
    assert found.misfit == pytest.approx(data.size, abs=6.0 * np.sqrt(2.0 * data.size))


def test_effects_that_nearly_do_the_same_are_judged_where_they_are_likeliest(arm: Arm) -> None:
    """Two warm-ups imitate a drift with the temperature, by large coefficients against each other. From there Laplace's
    approximation slides more than ten nats; where they are likeliest it does not, and they are no likelier than it."""
    drift = make_effect("bias_temperature", {"where": "magnetometer", "coefficient_per_degC": (0.05, 0.02, -0.1)})
    data = whitened_data(1, arm, drift)
    labels = ("bias_temperature@magnetometer", "bias_warmup@magnetometer")
    one, other = (next(each for each in all_candidates(data) if each.label == label) for label in labels)
    prior = set_prior([one, other], {}, data, {})
    search = Search(Scanner.of(data), [one, other], prior)
    true = search.fine([Member(Fitted(one, np.array([0.05, 0.02, -0.1]), {}), 0.0, (one.label,))])
    values = [np.array([-0.2, -0.1, 0.4, 300.0]), np.array([0.1, 0.05, -0.2, 600.0])]
    refitted = converged([Fitted(other, each, {}) for each in values], data)
    far = [replace(fit, values=fit.values + by) for fit, by in zip(refitted.fits, (0.3, -0.3), strict=True)]
    members = tuple(Member(fit, 0.0, (other.label,)) for fit in far)
    there = Explanation(members, refitted.data, prior.log_set([member.drawn for member in members]), True)
    assert there.linear.ahead > 10.0
    likeliest = there.where_likeliest()
    assert likeliest.linear.ahead < 10.0
    assert likeliest.log_mass < true.log_mass


def test_few_samples_are_looked_at_one_by_one(arm: Arm) -> None:
    scanner = Scanner.of(whitened_data(1, arm, DIPOLE))
    assert scanner.rough is scanner.fine


def test_sets_are_compared_on_one_scale(arm: Arm) -> None:
    """Single samples tell more of a backlash than means over neighbours do. A set that needs single samples counts for
    what it adds on these: it is no further ahead of sets that are fitted on means than of their fits sample by sample.
    """
    lash = make_effect("backlash", {"where": "joint1", "width_rad": 0.05})
    data = whitened_data(1, arm, lash, decimation=80)
    labels = ("backlash@joint1", "harmonic_drive_error@joint6")
    candidates = [next(each for each in all_candidates(data) if each.label == label) for label in labels]
    assert [each.smooth for each in candidates] == [True, False]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    assert search.rough.size < data.size
    (members,) = (one for one in search.additions(search.fitted(()), 2) if one[0].label == labels[0])
    play = search.fitted(members)
    wave = Fitted(candidates[1], np.array([3e-5, 0.5, 200.0]), {})
    fine = search.fine(play.members, play)
    assert search.gained(fine) == search.gained(play)
    assert fine.log_mass - search.fine(()).log_mass > search.gained(play) + 1.0  # what the scales differ by
    both = search.fitted((*play.members, Member(wave, 0.0, (labels[1],))))
    assert both.fine
    assert not play.fine
    assert search.gained(both) - search.gained(play) == pytest.approx(both.log_mass - fine.log_mass, abs=1e-9)
    assert search.gained(play) == pytest.approx(fine.log_mass - search.fine(()).log_mass, rel=1e-9)


def test_an_instant_is_moved_to_where_it_is_likeliest_beside_the_rest(arm: Arm) -> None:
    """A step that was found three readings early, beside nothing else."""
    data = whitened_data(1, arm, make_effect("bias_step", {"where": "mag2", "volts": 0.1, "at_s": 800.0}))
    scanner = Scanner.of(data)
    candidates = [each for each in all_candidates(data) if each.label == "bias_step@mag2"]
    search = Search(scanner, candidates, set_prior(candidates, {}, data, {}))
    (members,) = search.additions(search.fine(()), 1)
    early = replace(members[0].fit, kept={"at_s": float(members[0].fit.kept["at_s"]) - 3.0 * data.interval_s})
    found = search.run([[replace(members[0], fit=early)]], deep=False)[0]
    assert abs(float(found.members[0].fit.kept["at_s"]) - 800.0) <= 0.5 * data.interval_s


def test_a_calibration_that_gets_worse_is_not_followed(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each calibration is .1 V further off than the one before: none is better than with nothing there, which is what
    was attained then, whatever the first calibration's tangent promises."""
    data = whitened_data(1, arm, DIPOLE)
    tried: list[WhitenedData] = []

    def worse(data: WhitenedData, effects: Sequence[Effect]) -> WhitenedData:
        fresh = rebased(data, effects)
        off = np.zeros(data.tangent.shape[1])
        off[1] = 0.1 * (len(tried) + 1)  # the first channel's offset
        tried.append(fresh.around(stepped(fresh.pipeline, off), fresh.in_place))
        return tried[-1]

    monkeypatch.setattr(converge, "rebased", worse)
    found = converge.converged([first_fit(data, "base_dipole@base")], data)
    assert len(tried) > 1
    assert found.data is data
    assert found.misfit + found.short == pytest.approx(data.whitened @ data.whitened)


@pytest.mark.parametrize(("promises", "searches"), [((200.0, 100.0), 1), ((200.0, 300.0), 2), ((10.0,), 0)])
def test_sets_far_from_everything_are_followed_while_noise_is_likelier_beside_them(
    promises: tuple[float, ...], searches: int, arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Log masses that noise without a name promises beside the set that leads; what was found has 0."""
    data = whitened_data(1, arm, DIPOLE)
    scanner = Scanner.of(data)
    candidates = [each for each in all_candidates(data) if each.label in ("base_dipole@base", "scale_cubic@mag1")]
    prior = set_prior(candidates, {}, data, {})
    work = weighing.Weighing(scanner, candidates, Noises(prior, (), at_rest=True), progress=None)
    nothing = Search(scanner, candidates, prior).fine(())
    work.enter(Hypothesis(nothing, posterior.NoiseState(), (), 0.0))
    told, run = iter(promises), Search.run
    ran: list[Search] = []

    def counted(search: Search, *args: object, **options: bool) -> list[object]:
        ran.append(search)
        return run(search, *args, **options)  # type: ignore[arg-type, return-value]

    given = posterior.NoiseState(), scanner
    monkeypatch.setattr(Noises, "nameless", lambda *_: [Promise(next(told), given[0], given, nothing)])
    monkeypatch.setattr(Search, "run", counted)
    posterior._far_from_it(work, given, nothing)
    assert len(ran) == searches


@pytest.mark.parametrize("promised", [0.0, -np.inf])
def test_a_search_ends_where_the_set_belongs_under_another_state_of_the_noise(promised: float, arm: Arm) -> None:
    """Log mass under that state; pairs are tried before, and without one all goes on to the end."""
    data = whitened_data(1, arm, DIPOLE, make_effect("scale_cubic", {"where": "mag1", "fraction_of_full": 0.05}))
    labels = ("base_dipole@base", "scale_cubic@mag1", "scale_quadratic@accel1")
    candidates = [each for each in all_candidates(data) if each.label in labels]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    asked: list[int] = []

    def under_others(each: Explanation) -> float:
        asked.append(len(each.members))
        return promised

    found = search.run(under_others=under_others)[0]
    if promised == 0.0:
        assert search.overtaken is not None
        assert search.overtaken[0] == promised
        assert asked == [0, 1, 2]
    else:
        assert search.overtaken is None
        assert asked == [0, 1]
    assert found.key == labels[:2]


def test_the_set_that_leads_sample_by_sample_has_its_effects_swapped_too(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A steady roll of joint 6 makes the field of its motor much like one of link 5: with one, the other is tried.

    They tie to rounding: either may lead, and where the other does next, its effects are swapped in turn.
    """
    iron = make_effect("link_hard_iron", {"where": "link5", "field": (0.02, 0.0, -0.02)})
    data = whitened_data(1, arm, DIPOLE, iron, decimation=80)
    labels = ("base_dipole@base", "link_hard_iron@link5", "motor_current_field@joint6")
    candidates = [each for each in all_candidates(data) if each.label in labels]
    search = Search(Scanner.of(data), candidates, set_prior(candidates, {}, data, {}))
    refined, calls = Search._refined, []

    def late(search: Search) -> list[Explanation]:
        found = refined(search)
        if not calls:  # as if means over neighbours had led the search elsewhere
            search.improved.clear()
            other = labels[1] if labels[2] in found[0].key else labels[2]
            for key in [key for key in search.found if {labels[0], other} <= set(key[0])]:
                del search.found[key]
        calls.append(found[0].key)
        return found

    monkeypatch.setattr(Search, "_refined", late)
    search.run()
    assert len(calls) in (2, 3)
    assert {labels[:2], labels[::2]} <= {key for key, _ in search.found}


@pytest.mark.parametrize(("best", "weighed"), [(2.0, True), (4.0, False)])
def test_a_set_is_weighed_beside_a_discrepancy_where_that_may_matter(best: float, weighed: bool, arm: Arm) -> None:
    """A discrepancy that gains nothing beside nothing costs its prior, 2.7 nats, beside a dipole too: from the leading
    set it is left out where that makes it 6 nats less likely."""
    data = whitened_data(1, arm, DIPOLE)
    candidates = [each for each in all_candidates(data) if each.label == "base_dipole@base"]
    prior, scanner = set_prior(candidates, {}, data, {}), Scanner.of(data)
    work = weighing.Weighing(scanner, candidates, Noises(prior, (), at_rest=True), progress=None)
    state, search = posterior.NoiseState(), Search(scanner, candidates, prior)
    dipole = search.run()[0]
    assert not work._hopeless(dipole, state)
    work.gains.append((state, (), weighing.UNKNOWN))
    work.enter(Hypothesis(dipole, state, (), dipole.log_mass + best))
    assert work._hopeless(dipole, state) is not weighed
    assert not work._hopeless(dipole, posterior.NoiseState())
