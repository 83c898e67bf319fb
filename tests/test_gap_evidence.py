"""Parts of the evidence, each against what it says it is: tones, widths, floors, discrepancies."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from whitened_examples import data, discrepancies, recorded, unexplained  # noqa: F401

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.projection import project
from estimators.gap.data.stack import only_in
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies, left_beside, weighed, weighed_terms
from estimators.gap.evidence.fast_tones import fast_tones
from estimators.gap.evidence.jumps import best, roughly
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.refine import Fitted
from estimators.gap.evidence.repeats import Repeats
from estimators.gap.evidence.states import NoiseState, log_det, pieces_of, under_steps, unseen_floor
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.hypotheses.courses import FADING, courses
from estimators.gap.hypotheses.prior import FLOOR_RAISED
from estimators.gap.hypotheses.shapes import shape_prior
from estimators.gap.hypotheses.sources import sources
from rig.arm import Arm
from rig.effects import EFFECTS, make_effect
from rig.effects._numerics import low_passed, play


def test_a_floor_that_nothing_at_rest_shows_costs_what_it_is_raised_by() -> None:
    """Normal in the log of the variance: one standard deviation costs half a nat."""

    def cost(raised: float) -> float:
        step = Step(0, np.full(40, np.exp(-0.5 * raised)), in_time=False)
        return unseen_floor(NoiseState("noise", (), (step,), 0.0)).log_weight

    for deviations in (1.0, -2.0, 3.0):
        assert cost(0.0) - cost(deviations * FLOOR_RAISED) == pytest.approx(0.5 * deviations**2, rel=1e-9)


def test_the_determinant_of_a_step_is_that_of_the_readings_it_is_of(data: WhitenedData) -> None:
    """Restricted likelihood, by its definition: half the change of log |B' B| for the basis B of the calibration."""
    rng = np.random.default_rng(1)
    factor = np.exp(0.3 * rng.standard_normal(data.count))
    steps = [Step(data.columns[1], factor, in_time=True)]
    weights = np.ones((len(data.columns), data.count))
    weights[1] = factor
    moved = data.absorbed.dense() * weights.ravel()[:, None]
    expected = float(np.log(factor).sum()) - 0.5 * float(np.linalg.slogdet(moved.T @ moved)[1])
    assert log_det(data, steps) == pytest.approx(expected, rel=1e-9)
    linear = unexplained(data.whitened)
    under, determinant = under_steps(pieces_of(data, linear), linear, steps)
    assert determinant == pytest.approx(expected, rel=1e-9)
    left = data.whitened * weights.ravel()
    left -= moved @ np.linalg.lstsq(moved, left)[0]
    assert under.left @ under.left == pytest.approx(left @ left, rel=1e-9)
    assert log_det(data, []) == 0.0


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.tone])
def test_a_tone_is_expected_anywhere_in_its_band(data: WhitenedData, name: str) -> None:
    """A normal density that is one over the band where it is highest: the catalogue's bands, or up to Nyquist's."""
    candidate = next(each for each in all_candidates(data) if each.effect.name == name)
    (item,) = [each for each in candidate.effect.parameters() if each.name == "freq_Hz"]
    bands = candidate.effect.bands
    band = sum(high - low for low, high in bands) if bands else 0.5 / data.interval_s
    nothing = {each.name: (0.0,) * each.size if each.size > 1 else 0.0 for each in candidate.strengths}
    tone = candidate.effect.from_mapping({"where": candidate.where, **nothing})
    width_Hz = float(shape_prior(tone, item, data)[1][0]) * item.typical
    assert 1.0 / (np.sqrt(2.0 * np.pi) * width_Hz) == pytest.approx(1.0 / band, rel=1e-12)
    (phase,) = [each for each in candidate.effect.parameters() if each.name == "phase_rad"]
    np.testing.assert_allclose(np.sqrt(2.0 * np.pi) * shape_prior(tone, phase, data)[1] * phase.typical, np.pi)
    if not bands:  # of several recordings the one in which it acts says how fast it was read, single samples counted
        beside = SimpleNamespace(parts=[data, SimpleNamespace(samples=4, interval_s=2.0)])
        second = only_in(candidate.effect, 1).from_mapping(vars(tone))
        expected = shape_prior(tone, item, data)[1] * 2.0 * data.interval_s
        assert shape_prior(second, item, beside)[1] == pytest.approx(expected, rel=1e-12)  # type: ignore[arg-type]


def test_a_shape_is_expected_among_those_that_are_searched(data: WhitenedData) -> None:
    """Normal about the middle of an even grid, its highest density one over the grid's range; and in the logarithm of a
    geometric one, beyond its ends too."""
    dipole = next(each for each in all_candidates(data) if each.effect.name == "base_dipole")
    (place,) = [each for each in dipole.effect.parameters() if each.name == "position_m"]
    axes = dipole.effect.ranges(data.base)["position_m"]
    middle = np.array([0.5 * (axis[0] + axis[-1]) for axis in axes])
    steps = np.array([axis[1] - axis[0] for axis in axes])
    for off in (0.0, 1.3, -2.0):  # the last two beyond the grid's ends
        away, width = shape_prior(Fitted(dipole, np.array([1e-4, 0.0, 0.0, *middle + off]), {}).effect, place, data)
        assert away * place.typical == pytest.approx(np.full(3, -off), abs=1e-12)
        density = 1.0 / (np.sqrt(2.0 * np.pi) * width * place.typical)
        assert density == pytest.approx(1.0 / (steps * [len(axis) for axis in axes]), rel=1e-9)
    warm = next(each for each in all_candidates(data) if each.effect.name == "bias_warmup")
    (tau,) = [each for each in warm.effect.parameters() if each.name == "tau_s"]
    for index in (2, 4, 9):  # the last one beyond the end
        tau_s = tau.grid[0] * 2.0**index
        away, width = shape_prior(Fitted(warm, np.array([1e-3, 0.0, 0.0, tau_s]), {}).effect, tau, data)
        octave = tau_s * np.log(2.0) / tau.typical
        assert away == pytest.approx((3 - index) * octave, rel=1e-9)
        assert width == pytest.approx(len(tau.grid) * octave / np.sqrt(2.0 * np.pi), rel=1e-9)


def test_a_tone_that_means_would_hide_is_taken_out_of_the_channels_that_it_moves(arm: Arm) -> None:
    """Of .3 of the rate, in one channel: its size there to five standard deviations, and nothing in the others."""
    volts = 0.05
    run = recorded(3)
    frequency = 0.3 / float(np.median(np.diff(run.t)))
    tone = volts * np.cos(2.0 * np.pi * frequency * run.t)[:, None] * [0.0, 1.0, 0.0]
    run = replace(run, accelerometer=run.accelerometer + tone)
    humming = set_up(run, estimated_floor(run, arm), arm)
    assert fast_tones(humming, 1, ()) == ([], humming)
    (found,), cleared = fast_tones(humming, 2, ())
    assert found.where == "accelerometer"
    error = 5.0 * np.sqrt([channel.variance / humming.count for channel in humming.floor])
    assert np.all(np.abs(found.gap - volts / np.sqrt(2.0) * np.array([0, 1, 0, 0, 0, 0])) < error)
    moved = np.sqrt(np.mean((humming.readings - cleared.readings) ** 2, axis=0))
    assert moved == pytest.approx(found.gap, rel=1e-9, abs=1e-15)


def test_a_harmonic_of_the_arms_motion_is_no_tone_beside_the_effect_that_makes_it(data: WhitenedData) -> None:
    """A third of a radian in each mean of five: the fifth harmonic of the fastest joint is as fast as a tone."""
    remembering = make_effect("hysteresis", {"where": "accel3", "half_width": 0.02})
    changed = replace(data, readings=data.readings + data.change([remembering]))
    alone, _ = fast_tones(changed, 5, ())
    assert alone
    beside, cleared = fast_tones(changed, 5, (), [remembering], data.pipeline)
    assert beside == []
    np.testing.assert_array_equal(cleared.readings, changed.readings)


def test_a_cause_of_another_form_is_told_by_its_own_change_along_something(
    data: WhitenedData, discrepancies: Discrepancies
) -> None:
    """A cubic error whose size goes with the square of time is a signal-to-noise of 40 beside a steady one; no source
    but its own strength follows that in one term."""
    cubic = make_effect("scale_cubic", {"where": "mag1", "fraction_of_full": 0.05})
    steady = data.change([cubic])
    change = data.whiten(steady)
    share = np.tile(np.linspace(-1.0, 1.0, data.count) ** 2, len(data.columns)) - 1.0 / 3.0
    off = project(data.absorbed, change * share)
    noise = project(data.absorbed, np.random.default_rng(4).standard_normal(data.size))
    own = {("scale_cubic@mag1", ""): lambda: (steady, change[:, None])}
    best = weighed(unexplained(noise + 40.0 * off / np.linalg.norm(off)), discrepancies, own)[0]
    assert best.term.source == "the strength of scale_cubic at mag1"
    assert best.term.course == "time"
    assert best.log_mass > 0.5 * 0.9 * 40.0**2 - 100.0
    quiet = weighed(unexplained(noise), discrepancies, own)
    assert all(each.log_mass < 0.0 for each in quiet)


def test_what_an_effect_can_do_itself_is_no_other_form_of_it(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """A supply of another waveform than what was found is its own parameters' business, at a signal-to-noise of 40."""
    waves = [make_effect("supply_ratiometric", {"where": "supply", "waveform": row}) for row in 1e-3 * np.eye(24)]
    every = [data.change([wave]) for wave in waves]
    own = project(data.absorbed, np.column_stack([data.whiten(each) for each in every]))
    change = np.tensordot(np.linspace(1.0, -1.0, 24), every, axes=1)
    noise = project(data.absorbed, np.random.default_rng(4).standard_normal(data.size))
    left = noise + 40.0 * own[:, 5] / np.linalg.norm(own[:, 5])
    terms = discrepancies.forms(("supply_ratiometric@supply", "another"), lambda: (change, own))
    assert terms
    assert all(each.log_mass < 0.0 for each in weighed_terms(unexplained(left), terms))


def test_a_sine_without_a_name_is_told_from_every_sample(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """Of the magnetic field, between two frequencies of the transform, a signal-to-noise of 12: half of its square less
    the prices of source, frequency and amplitudes; the frequency within six of its bounds. Noise alone is worth less
    than nothing."""
    noise = np.random.default_rng(4).standard_normal(data.size)
    (field,) = [each for each in sources(data) if each.name == "the magnetic field"]
    true = 0.1 + 0.25 / float(np.ptp(data.t))
    wave = project(data.absorbed, (field.series[0] * np.sin(2.0 * np.pi * true * data.t)).ravel())
    (sines,) = [each for each in discrepancies.fitted if isinstance(each, Repeats)]
    quiet = project(data.absorbed, noise)
    loud = quiet + 12.0 * wave / np.linalg.norm(wave)
    best = weighed_terms(unexplained(loud), sines.terms(loud))[0]
    assert best.term.source == "the magnetic field"
    assert best.term.course.startswith("a sine of ")
    found = float(best.term.course.split()[3])
    assert abs(found - true) < 6.0 * np.sqrt(12.0) / (2.0 * np.pi * float(np.ptp(data.t)) * 12.0)
    assert best.log_mass > 0.5 * 12.0**2 - 50.0
    assert all(each.log_mass < 0.0 for each in weighed_terms(unexplained(quiet), sines.terms(quiet)))


@pytest.mark.parametrize(
    ("name", "values", "source", "course"),
    [
        (
            "link_hard_iron",
            {"where": "link1", "field": (0.01, 0.02, 0.0)},
            "the magnetic field along link1",
            "time, throughout",
        ),
        ("latency", {"where": "magnetometer", "delay_s": 0.01}, "the clock of the magnetometer", "time, throughout"),
        ("latency", {"where": "acquisition", "delay_s": 0.01}, "the clock", "time, throughout"),
        ("joint_offset", {"where": "joint5", "offset_rad": 0.001}, "the angle of joint5", "time, throughout"),
        ("backlash", {"where": "joint1", "width_rad": 0.002}, "the angle of joint1", "the direction of joint1"),
        (
            "supply_ratiometric",
            {"where": "supply", "waveform": (0.001, -0.002, 0.001) * 8},
            "the gain of all channels",
            "time",
        ),
        (
            "vibration",
            {"where": "accelerometer", "freq_Hz": 0.31, "direction": (1.0, 0.0, 0.0)},
            "the acceleration",
            "a sine of 0.31 Hz",
        ),
    ],
)
def test_what_has_no_name_is_told_where_it_acts_and_along_what(
    data: WhitenedData, discrepancies: Discrepancies, name: str, values: dict[str, object], source: str, course: str
) -> None:
    """Thirty standard deviations of an effect: nine tenths of half their square, less the price of source, course,
    amplitude and of the functions of time that are not needed, 60 nats at most."""
    (item, *_) = [each for each in EFFECTS[name].parameters() if each.strength]
    effect = make_effect(name, {item.name: item.typical, **values} if item.size == 1 else values)
    change = project(data.absorbed, data.whiten(data.change([effect])))
    noise = project(data.absorbed, np.random.default_rng(6).standard_normal(data.size))
    best = weighed(unexplained(noise + 30.0 * change / np.linalg.norm(change)), discrepancies)[0]
    assert best.term.source == source
    assert best.term.course.startswith(course)
    assert best.log_mass > 0.5 * 0.9 * 30.0**2 - 60.0


def test_levels_that_change_are_split_where_they_do() -> None:
    """By optimal partitioning, of levels ten standard deviations of their means apart; noise alone is not split, more
    often than once in e^2 times its samples' number of places."""
    rng = np.random.default_rng(8)
    true = [150, 400, 470, 900, 1300]
    level = 1.5 * (np.searchsorted(true, np.arange(1600), side="right") % 2)
    noise = rng.standard_normal(1600)
    found = best((noise + level)[:, None], np.ones(1600))
    assert len(found) == len(true)
    assert np.abs(np.array(found) - true).max() <= 6  # a step of 1.5 deviations moves by so much once in a million
    assert len(roughly((noise + level)[:, None], np.ones(1600))) >= 2  # to and fro hides from a single split
    assert best(noise[:, None], np.ones(1600)) == roughly(noise[:, None], np.ones(1600)) == []


def test_an_offset_that_jumps_to_and_fro_is_no_walk_and_a_walk_does_not_jump(
    data: WhitenedData, discrepancies: Discrepancies
) -> None:
    rng = np.random.default_rng(9)
    noise = project(data.absorbed, rng.standard_normal(data.size))

    def likeliest(course: np.ndarray) -> str:
        change = np.zeros((data.count, 6))
        change[:, 1] = course
        change = project(data.absorbed, data.whiten(change))
        return weighed(unexplained(noise + 60.0 * change / np.linalg.norm(change)), discrepancies)[0].term.course

    at = np.sort(rng.uniform(0.05, 0.95, 12)) * data.count
    levels = rng.standard_normal(13)
    assert likeliest(levels[np.searchsorted(at, np.arange(data.count))]).endswith(" jumps")
    assert likeliest(np.cumsum(rng.standard_normal(data.count))) == "time"


def test_hysteresis_of_any_form_is_an_offset_that_follows_its_history(
    data: WhitenedData, discrepancies: Discrepancies
) -> None:
    """Four plays side by side (Prandtl and Ishlinskii) on one axis: three quarters of their square, which are 20
    standard deviations, are the history's; their form is not one play's."""
    own = data.base.inputs[:, 4]
    change = np.zeros((data.count, 6))
    change[:, 4] = np.mean([play(own, share * np.ptp(own)) for share in (0.002, 0.007, 0.02, 0.05)], axis=0) - own
    change = project(data.absorbed, data.whiten(change))
    noise = project(data.absorbed, np.random.default_rng(5).standard_normal(data.size))
    left = noise + 20.0 * change / np.linalg.norm(change)
    best = weighed(unexplained(left), discrepancies)[0]
    assert (best.term.source, best.term.course) == ("the offset of mag2", "the history of its level")
    assert best.log_mass > 0.5 * 0.75 * 20.0**2 - 40.0


@pytest.mark.parametrize(
    ("columns", "told"), [((4,), "the offset of mag2"), ((3, 4, 5), "the offsets of the magnetometer")]
)
def test_what_creeps_is_an_offset_that_follows_a_fading_memory(
    data: WhitenedData, discrepancies: Discrepancies, columns: tuple[int, ...], told: str
) -> None:
    """After a field of a while ago, an amplifier's or a steel tool's: a time constant amid those of the course. Six of
    these hold .99 of the square of 25 standard deviations."""
    change = np.zeros((data.count, 6))
    clock = np.arange(data.count) * data.interval_s
    for column in columns:
        change[:, column] = low_passed(clock, data.modelled[:, [column]], 10.0)[:, 0]
    change = project(data.absorbed, data.whiten(change))
    noise = project(data.absorbed, np.random.default_rng(8).standard_normal(data.size))
    best = weighed(unexplained(noise + 25.0 * change / np.linalg.norm(change)), discrepancies)[0]
    assert (best.term.source, best.term.course.replace("their levels", "its level")) == (told, FADING)
    assert best.log_mass > 0.5 * 0.99 * 25.0**2 - 40.0


def test_axes_that_are_off_by_one_law_are_told_together(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """Three axes of one chip that saturate alike, at 12 standard deviations each: one source with six functions, for
    three with six each, which cost ten nats more apiece."""
    change = np.zeros((data.count, 6))
    change[:, :3] = np.tanh(0.12 * data.base.inputs[:, :3]) - 0.12 * data.base.inputs[:, :3]
    change = project(data.absorbed, data.whiten(change))
    noise = project(data.absorbed, np.random.default_rng(4).standard_normal(data.size))
    best = weighed(unexplained(noise + 20.0 * change / np.linalg.norm(change)), discrepancies)[0]
    assert (best.term.source, best.term.course) == ("the offsets of the accelerometer", "their levels")
    assert best.log_mass > 0.5 * 0.9 * 20.0**2 - 40.0


def test_bumps_along_a_joint_are_told_place_by_place(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """A worn track under one channel's contact: three bumps a tenth of a turn wide, which three harmonics hold little
    of. Of 40 standard deviations the places hold nine tenths of the square."""
    assert data.base.q_encoder is not None
    angle = data.base.q_encoder[:, 0]
    bumps = sum(size * np.exp(-0.5 * ((angle - at) / 0.15) ** 2) for at, size in ((-1.1, 1.0), (0.3, -0.8), (0.9, 0.7)))
    change = np.zeros((data.count, 6))
    change[:, 1] = bumps
    change = project(data.absorbed, data.whiten(change))
    noise = project(data.absorbed, np.random.default_rng(6).standard_normal(data.size))
    best = weighed(unexplained(noise + 40.0 * change / np.linalg.norm(change)), discrepancies)[0]
    assert (best.term.source, best.term.course) == ("the offset of accel2", "the angle of joint1, place by place")
    assert best.log_mass > 0.5 * 0.9 * 40.0**2 - 100.0


def test_a_joint_that_turns_far_from_mean_to_mean_has_no_places(data: WhitenedData) -> None:
    places = {each.name for each, _ in courses(data) if each.name.endswith("place by place")}
    assert "the angle of joint1, place by place" in places
    assert data.base.q_encoder is not None
    step = np.quantile(np.abs(np.diff(np.unwrap(data.base.q_encoder[:, 5]))), 0.9)
    assert ("the angle of joint6, place by place" in places) == bool(step < 2.0 / 4.0)


def test_how_fast_the_tool_turns_holds_what_any_lever_feels(arm: Arm) -> None:
    """A lever's acceleration is linear in the angular acceleration and in products of rates: what is left of it comes
    from differences over two samples, a sixth of the squared turn of one, and of the reversals between them."""
    run = recorded(1, decimation=25)
    whole = set_up(run, estimated_floor(run, arm), arm)
    lever = whole.change([make_effect("motion_acceleration", {"where": "accelerometer", "lever_m": (0.1, -0.2, 0.3)})])
    still = whole.change([make_effect("motion_acceleration", {"where": "accelerometer"})])
    moved = (lever - still)[2:-2, :3]
    (course,) = [each for each, _ in courses(whole) if each.name == "how fast the tool turns"]
    columns = np.column_stack([np.ones(whole.count), course.values])[2:-2]
    left = moved - columns @ np.linalg.lstsq(columns, moved, rcond=None)[0]
    assert np.linalg.norm(left) < 0.01 * np.linalg.norm(moved - moved.mean(axis=0))


def test_what_a_joint_that_changes_its_speed_shakes_goes_with_the_square_of_that(data: WhitenedData) -> None:
    """Of a joint at a steady speed nothing does."""
    name = "the square of joint6's speed"
    assert name not in {each.name for each, _ in courses(data)}
    velocity = data.base.joint_velocity.copy()
    velocity[:, 5] *= 1.0 + 0.8 * np.sin(0.1 * data.base.t)
    changing = replace(data, base=replace(data.base, velocity=velocity))
    (course,) = [each for each, _ in courses(changing) if each.name == name]
    assert course.values.shape == (data.count, 1)
    np.testing.assert_allclose(course.values[:, 0] / course.values[0, 0], (velocity[:, 5] / velocity[0, 5]) ** 2)


def test_what_is_on_while_a_joint_is_fast_or_the_arm_moves_is_a_course(data: WhitenedData) -> None:
    """An arm that stops for a third of the time: a switch at half the speed is told to a fifth of its variance by six
    cosines, of which a sum of so few rings; a switch at rest by a course of its own."""
    velocity = data.base.joint_velocity.copy()
    velocity[:, 5] *= np.maximum(0.0, np.sin(0.1 * data.base.t) + 0.5)
    velocity[velocity[:, 5] == 0.0] = 0.0
    stopping = replace(data, base=replace(data.base, velocity=velocity))
    found = {each.name: each.values for each, _ in courses(stopping)}
    moving = velocity.any(axis=1)
    assert np.mean(found["whether the arm moves"][:, 0] == moving) > 0.97
    assert "whether the arm moves" not in {each.name for each, _ in courses(data)}
    fast = (np.abs(velocity[:, 5]) > 0.5 * np.abs(velocity[:, 5]).max()).astype(float)
    columns = np.column_stack([np.ones(len(fast)), found["how fast joint6 turns"]])
    left = fast - columns @ np.linalg.lstsq(columns, fast, rcond=None)[0]
    assert np.var(left) < 0.2 * np.var(fast)


def test_what_a_term_took_beside_an_effect_it_does_not_take_again(
    data: WhitenedData, discrepancies: Discrepancies
) -> None:
    """An effect that could do nearly the same: of the two fitted at once nothing is left for the term, where what it
    takes by itself left most of that."""
    own = [each for each in discrepancies.terms if each.source == "the magnetic field"]
    term = next(each for each in own if each.course == "time")
    rng = np.random.default_rng(3)
    made = project(data.absorbed, term.made(rng.standard_normal((len(term.values), 1)))[:, 0])
    other = project(data.absorbed, rng.standard_normal(data.size))
    tangent = (made / np.linalg.norm(made) + 0.5 * other / np.linalg.norm(other))[:, None]
    left = project(data.absorbed, 60.0 * made / np.linalg.norm(made) + rng.standard_normal(data.size))
    left -= tangent[:, 0] * float(tangent[:, 0] @ left) / float(tangent[:, 0] @ tangent[:, 0])
    one = np.ones(1)
    linear = Linear(left, tangent, np.zeros(1), one > 0, one, np.zeros(1, dtype=np.intp))
    (first,) = weighed_terms(linear, [term])
    assert first.log_mass > 100.0
    again = weighed_terms(left_beside(linear, first, discrepancies), [term])
    assert all(each.log_mass < 0.0 for each in again)
