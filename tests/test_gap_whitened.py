"""Whitened data: quick changes, block means, tones, a calibration that a strong cause moved, repeated rows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosed_recordings import scenario as small
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from whitened_examples import data, recorded, unexplained  # noqa: F401

import estimators
from estimators.gap.data import tangent
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.defects import readings_of
from estimators.gap.data.projection import orthonormal, project
from estimators.gap.data.steps import Gaps, Step, after_steps
from estimators.gap.data.tangent import ChannelTangent
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.refine import Fitted
from estimators.gap.evidence.states import pieces_of, under_steps, unnamed
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left
from estimators.gap.hypotheses.tones import _allowed
from rig.arm import Arm
from rig.effects import EFFECTS, Kind, make_effect


@pytest.mark.parametrize(
    "name", [name for name, effect in EFFECTS.items() if effect.kind is Kind.MEAN and not effect.of_log]
)
def test_a_change_is_that_of_the_whole_pipeline(data: WhitenedData, name: str) -> None:
    """What an effect leaves alone is kept; the rest equals the whole way to rounding of some volts."""
    effect = EFFECTS[name]
    choices = {key: names[0] for key, names in effect.choices().items()}
    strengths = {
        item.name: item.typical if item.size == 1 else (item.typical,) * item.size
        for item in effect.parameters()
        if item.strength
    }
    where = next(each for each in effect.places if each not in choices.values())
    made = effect.from_mapping({"where": where, **choices, **strengths})
    whole = replace(data.pipeline, effects=(made,)).expected(data.base, np.random.default_rng(0)).volts
    np.testing.assert_allclose(data.change([made]), whole - data.base.volts, rtol=0.0, atol=1e-13)


def test_block_means_at_mean_poses_are_block_means(arm: Arm) -> None:
    """A smooth change at the mean pose of a few samples is the mean of the change, to second order in their turn."""
    run = recorded(1, decimation=25)
    full = set_up(run, estimated_floor(run, arm), arm)
    blocks = full.averaged(4)
    points = blocks.pointwise()
    effect = make_effect("link_hard_iron", {"where": "link1", "field": (0.0, 0.02, 0.0)})
    one, other = blocks.whiten(blocks.change([effect])), points.whiten(points.change([effect]))
    turn = 4.0 * np.abs(np.diff(run.q, axis=0)).max()
    assert np.linalg.norm(one - other) < turn**2 / 24.0 * 4.0 * np.linalg.norm(one)  # sinc, for orders up to two
    assert np.linalg.norm(blocks.whiten(blocks.residual) - points.whiten(points.residual)) < 1e-6 * np.sqrt(points.size)


def test_what_jumps_within_a_block_is_evaluated_at_several_of_its_samples(arm: Arm) -> None:
    """A joint's reversal is within a block, and its backlash there neither side's: at every sample the block's mean to
    rounding, at a fourth of them a fourth of the error or so, also beside an effect that is smooth."""
    run = recorded(1, decimation=2)
    full = set_up(run, estimated_floor(run, arm), arm)
    blocks = full.averaged(16)
    jumping = make_effect("backlash", {"where": "joint5", "width_rad": 0.01})
    both = [make_effect("link_hard_iron", {"where": "link1", "field": (0.0, 0.001, 0.0)}), jumping]
    for effects in ([jumping], both):
        exact, off = blocks.whiten(blocks.change(effects)), {}
        for count in (1, 4, 16):
            points = blocks.pointwise(count)
            wrong = (points.whiten(points.change(effects)) - exact).reshape(6, -1)
            off[count] = np.linalg.norm(wrong[:, 2:-2])  # half a second at the ends is left out
            (moved,) = points.changes(effects, len(effects) - 1, [jumping], np.ones(6, dtype=bool))
            np.testing.assert_array_equal(moved, points.change(effects))
        assert off[16] < 1e-9 * np.linalg.norm(exact)
        assert off[4] < 0.5 * off[1]


@pytest.mark.parametrize(
    "effect",
    [
        ("hysteresis", {"where": "accel3", "half_width": 0.005}),
        ("scale_cubic", {"where": "accel2", "fraction_of_full": -0.03}),
        ("link_soft_iron", {"where": "link5", "chi": (0.01, 0.0, 0.0, 0.0, 0.0, 0.0)}),
        ("motion_acceleration", {"where": "accelerometer", "lever_m": (0.02, 0.0, 0.0)}),
    ],
    ids=lambda effect: str(effect[0]),
)
def test_where_the_arm_turns_far_in_a_block_every_effect_is_the_mean_over_it(
    arm: Arm, effect: tuple[str, dict[str, object]]
) -> None:
    """A third of a radian in each block of five readings: at the mean pose alone a per cent and more of each is lost,
    at all of the samples nothing but rounding."""
    run = recorded(1, decimation=25)
    blocks = set_up(run, estimated_floor(run, arm), arm).averaged(5)
    made = make_effect(*effect)
    exact = blocks.whiten(blocks.change([made]))
    off = {}
    for count in (1, 4):
        points = blocks.pointwise(count)
        wrong = (points.whiten(points.change([made])) - exact).reshape(6, -1)
        off[count] = np.linalg.norm(wrong[:, 2:-2]) / np.linalg.norm(exact)  # as above
    assert off[1] > 0.003
    assert off[4] < 1e-7  # second differences of positions have lost eight digits


def test_a_strong_cause_and_the_calibration_are_fitted_together(arm: Arm) -> None:
    """A lag of a second turns the fitted axes by tenths of a radian; the lag is recovered all the same."""
    tau_s = 1.0
    run = recorded(2, ("sensor_lag", {"where": "accelerometer", "tau_s": tau_s}), decimation=200)
    found = estimators.diagnose(run, arm=arm)
    (cause,) = found.causes
    names = {(cause.effect, cause.where), *((each["effect"], each["where"]) for each in cause.equivalent)}
    assert ("sensor_lag", "accelerometer") in names
    if cause.effect == "sensor_lag":
        estimate = cause.parameters["tau_s"]
        assert abs(estimate.value - tau_s) < 4.0 * estimate.std + 0.02 * tau_s  # the path is sampled, not continuous


def test_poses_before_and_after_the_recording_leave_nothing_in_what_is_judged(arm: Arm) -> None:
    """Cut from the middle of a sweep, whose readings lag: the first and last of them are of poses that nobody logged.

    18,000 readings of white noise exceed six standard deviations once in 28,000 times.
    """
    run = recorded(1, ("latency", {"where": "acquisition", "delay_s": -0.4}), decimation=25).select(slice(1000, 4000))
    lag = Fitted(Candidate(EFFECTS["latency"], "acquisition"), np.array([-0.35]), {})
    found = converged([lag], set_up(run, estimated_floor(run, arm), arm))
    assert np.abs(found.left).max() < 6.0
    assert np.count_nonzero(found.left == 0.0) == 6 * 2 * 2  # half a second at 4 Hz, at either end


def test_convergence_leaves_a_good_fit_alone(data: WhitenedData) -> None:
    found = converged([], data)
    assert found.data is data
    assert found.fits == []
    np.testing.assert_array_equal(found.explained.residual, data.whitened)


def test_a_tone_faster_than_the_means_is_found_in_the_samples(arm: Arm) -> None:
    frequency = 4.37
    effect = ("vibration", {"where": "accelerometer", "freq_Hz": frequency, "amplitude_m_s2": 0.05})
    run = recorded(3, effect, decimation=8)
    assert len(run) > 16_384  # long enough for means of two samples
    found = estimators.diagnose(run, arm=arm)
    (cause,) = found.established
    assert (cause.effect, cause.where) == ("vibration", "accelerometer")
    resolution = 1.0 / float(run.t[-1] - run.t[0])
    assert abs(cause.parameters["freq_Hz"].value - frequency) < 0.5 * resolution


@pytest.mark.parametrize("frequency", [20.45, 20.33, 30.7])
def test_a_tone_is_found_among_the_rates_of_the_joints(frequency: float) -> None:
    """Sampled at 10 Hz it appears between the first and third harmonic of the fastest joint's .246 Hz. In two draws of
    each it alone was named."""
    few = [name for name in EFFECTS if name not in ("vibration", "mains_hum", "joint_scale", "joint_eccentricity")]
    shaken = {"where": "accelerometer", "amplitude_m_s2": 0.12, "freq_Hz": frequency, "direction": (1.0, 1.0, 0.0)}
    run = small().with_effects([make_effect("vibration", shaken)]).simulate(0)
    found = estimators.diagnose(run, small().simulate_locked(0), without=few)
    assert [cause.effect for cause in found.established] == ["vibration"]


def test_each_channel_closes_by_what_is_left_of_it(arm: Arm) -> None:
    """A warm-up of the magnetometer beside an accelerometer axis that jumps to and fro: the first is a cause, the other
    is in no catalogue, and in no other channel."""
    warm = ("bias_warmup", {"where": "magnetometer", "coefficient": (0.03, -0.04, 0.05), "tau_s": 300.0})
    run = recorded(5, warm)
    accelerometer = run.accelerometer.copy()
    accelerometer[:, 2] += 0.05 * (np.searchsorted(np.linspace(100.0, 1600.0, 12), run.t) % 2)
    found = estimators.diagnose(replace(run, accelerometer=accelerometer), arm=arm)
    assert [(cause.effect, cause.where) for cause in found.established] == [("bias_warmup", "magnetometer")]
    assert found.posterior["other"] > 0.99
    assert found.remainder.follows[0]["source"] == "the offset of accel3"
    for name in ("mag1", "mag2", "mag3"):
        assert found.channels[name].closed > 0.9, name
    assert found.channels["accel3"].closed < 0.1


def test_of_a_direction_every_component_is_said(arm: Arm) -> None:
    """Its length says nothing, and nothing is missing for that."""
    true = np.array([0.6, 0.0, 0.8])
    effect = {"where": "accelerometer", "freq_Hz": 0.3137, "amplitude_m_s2": 0.1, "direction": tuple(true)}
    (cause,) = estimators.diagnose(recorded(3, ("vibration", effect)), arm=arm).established
    told = cause.parameters["direction"]
    value, std = np.array(told.value), np.array(told.std)
    assert np.linalg.norm(value) == pytest.approx(1.0, rel=1e-9)
    assert (std > 0.0).all()
    assert (std < 0.1).all()
    assert (np.abs(value * np.sign(value @ true) - true) < 5.0 * std).all()


def test_changes_beside_other_effects_are_those_of_the_whole_pipeline(data: WhitenedData) -> None:
    """The stages before the moved effect run once: equal to the last bit, also where it needs what they leave out."""
    others = [make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.01})]
    for name, values in (
        ("link_hard_iron", {"where": "link5", "field": (0.01, 0.0, 0.02)}),
        ("field_gradient", {"where": "base", "gradient_per_m": (0.01, 0.0, 0.02, 0.0, 0.01)}),
        ("joint_scale", {"where": "joint1", "scale": 1e-3}),
    ):
        moved = [make_effect(name, values)]
        every, channels = [*others, *moved], np.ones(6, dtype=bool)
        (change,) = data.changes(every, 1, moved, channels)
        np.testing.assert_array_equal(change, data.change(every))


@pytest.mark.parametrize("shared", [0, 2, 3])
def test_the_basis_of_the_tangent_spans_it_whatever_depends_on_what(shared: int) -> None:
    """Two sensors of two channels, the second with parameters that are others' sum: as of the dense columns."""
    rng = np.random.default_rng(shared)
    parts = []
    for channel in range(4):
        first = 4 + 3 * (channel // 2)
        values = rng.standard_normal((50, 1 + shared))
        if shared and channel > 1:
            values[:, -1] = values[:, :-1].sum(axis=1) if shared > 2 else 2.0 * values[:, 0]
        parts.append(ChannelTangent([channel, *range(first, first + shared)], values))
    found, whole = tangent.basis(parts), orthonormal(tangent.dense(parts))
    columns = found.dense()
    assert columns.shape == whole.shape == (200, found.rank)
    np.testing.assert_allclose(columns.T @ columns, np.eye(found.rank), atol=1e-13)
    np.testing.assert_allclose(columns @ columns.T, whole @ whole.T, atol=1e-11)
    values = rng.standard_normal((90, 2))
    np.testing.assert_allclose(found.along(values, 40), columns[40:130].T @ values, atol=1e-13)
    every = rng.standard_normal((200, 2))
    np.testing.assert_allclose(project(found, every), project(columns, every), atol=1e-13)
    rows = np.arange(30, 170, 3)
    np.testing.assert_array_equal(found.of(rows).dense(), columns[rows])
    target = rng.standard_normal(200)
    gram, moment = tangent.moments(parts, target)
    np.testing.assert_allclose(gram, tangent.dense(parts).T @ tangent.dense(parts), atol=1e-12)
    np.testing.assert_allclose(moment, tangent.dense(parts).T @ target, atol=1e-12)


def test_one_repeated_row_is_a_dropout(data: WhitenedData) -> None:
    """No chance repeats six readings: a single row does."""
    dropouts, step = EFFECTS["dropouts"], np.zeros(6)
    assert dropouts.examined(readings_of(data, step), "acquisition") is None
    readings = data.readings.copy()
    readings[700] = readings[699]
    found = dropouts.examined(readings_of(replace(data, readings=readings), step), "acquisition")
    assert found is not None
    assert np.flatnonzero(found.affected.all(axis=1)).tolist() == [700]


def test_channels_that_each_miss_a_reading_now_and_then_are_dropouts(data: WhitenedData) -> None:
    """Twenty of ten thousand readings, each channel by itself. On the converter's steps of a tenth of the noise some
    eighty repeat by chance, of finer ones none: that none is missed has a chance of 1e-20 and less there."""
    dropouts, rng = EFFECTS["dropouts"], np.random.default_rng(3)
    missed = np.zeros(data.readings.shape, dtype=bool)
    readings = data.readings + rng.uniform(-6e-4, 6e-4, missed.shape)
    fine = readings_of(replace(data, readings=readings), np.zeros(6))
    assert dropouts.examined(fine, "acquisition") is None
    missed[rng.choice(np.arange(1, data.count), 20, replace=False), rng.integers(6, size=20)] = True
    for row, column in np.argwhere(missed):
        readings[row, column] = readings[row - 1, column]
    found = dropouts.examined(readings_of(replace(data, readings=readings), np.zeros(6)), "acquisition")
    assert found is not None
    np.testing.assert_array_equal(found.affected, missed)
    assert found.effect.share == pytest.approx(20 / missed.size)  # type: ignore[attr-defined]


def test_channels_that_each_repeat_are_no_dropouts(data: WhitenedData) -> None:
    """A log faster than what it logs: each channel, or each sensor, repeats a reading three times in ten by itself.

    Dropouts on top of that, 277 rows where 13 to 150 repeat without, are found. False failures: the significance of the
    effect's own test, 1e-5 for each of the two.
    """
    dropouts, step = EFFECTS["dropouts"], np.zeros(6)
    rng = np.random.default_rng(0)
    for groups in (np.arange(3) % 3, np.zeros(3, dtype=int)):
        stale = rng.random((data.count, groups.max() + 1))[:, groups] < 0.3
        both = np.hstack([stale, rng.random((data.count, 1)) < np.full(3, 0.3)])
        rows = np.where(both, 0, np.arange(data.count)[:, None])
        readings = np.take_along_axis(data.readings, np.maximum.accumulate(rows), axis=0)
        assert dropouts.examined(readings_of(replace(data, readings=readings), step), "acquisition") is None
        missed = rng.choice(np.arange(1, data.count), data.count // 6, replace=False)
        for row in np.sort(missed):
            readings[row] = readings[row - 1]
        assert dropouts.examined(readings_of(replace(data, readings=readings), step), "acquisition") is not None


def test_a_slow_recording_folds_a_band_once() -> None:
    """Sampled once in 30 years, a band of 2 Hz may appear anywhere; its 6e11 resolved frequencies are not listed."""
    data = SimpleNamespace(count=400, interval_s=1e9, base=SimpleNamespace(q_encoder=None))
    mains = SimpleNamespace(effect=SimpleNamespace(bands=((49.0, 51.0),)))
    frequency = np.arange(401) / (800 * data.interval_s)
    allowed = _allowed(mains, data, frequency)  # type: ignore[arg-type]
    assert allowed[frequency > 1.5 / (400 * 1e9)].all()


def test_noise_without_a_name_may_come_and_go(data: WhitenedData) -> None:
    """Noise of a sensor that is coloured, and 20 times as large in a third of the time, is white once it is learned.

    Half of the readings have a mean square within 15 % of one (1,000 of them and more: 6 sigma of what a fitted size
    leaves); a spectrum that stays the same is off by a factor of two in the quiet part at least.
    """
    rng = np.random.default_rng(0)
    size = np.where((np.arange(data.count) * 6 // data.count) % 3 == 1, 60.0, 3.0)
    left = lfilter([0.6], [1.0, -0.8], rng.standard_normal((len(data.columns), data.count))) * size
    state = unnamed([Left(data, Explained(data.absorbed, left.ravel()))])
    assert state is not None
    assert state.other
    for number, column in enumerate(data.columns):
        white = left[number]
        for step in state.steps:
            white = step(white) if step.column == column else white
        for part in (white[size < 10.0], white[size > 10.0]):
            assert 0.85 < float(np.mean(part**2)) < 1.15


def test_a_level_does_not_jump_where_readings_are_left_out() -> None:
    """A slow level of ten on white noise, its lowest frequencies whitened: of readings left out at both ends and one in
    ten between, each would leave a hundred beside it. What is left is a chi-square, to five standard deviations."""
    rng, count = np.random.default_rng(2), 4000
    weights = (rng.random(count) > 0.1).astype(float)
    weights[[0, 1, -2, -1]] = 0.0
    level = 10.0 * np.cos(np.pi * np.arange(count) / count)
    factor = np.minimum(1.0, np.arange(count) / 40.0)
    gaps = Gaps.of(weights)
    left = after_steps([Step(0, factor, in_time=False)], weights * (level + rng.standard_normal(count)), gaps)
    assert not left[weights == 0.0].any()
    assert float(left @ left) == pytest.approx(weights.sum(), abs=5.0 * np.sqrt(2.0 * weights.sum()) + 40.0)
    assert not Gaps.of(np.ones(3)).at.size
    assert not Gaps.of(np.zeros(3)).at.size


def test_a_level_does_not_jump_at_the_edges_of_what_is_left_out_for_long() -> None:
    """Of 50 readings left out at either end and 300 between, of a level of ten whose low frequencies are whitened: what
    stops at an edge leaves half of the level there and more; what turns there, a step's memory times its slope."""
    count = 4000
    there = np.ones(count, dtype=bool)
    there[:50] = there[-50:] = there[1000:1300] = False
    gaps, level = Gaps.of(there.astype(float)), 10.0 * np.cos(3.0 * np.pi * np.arange(count) / count)
    step = Step(0, np.minimum(1.0, np.arange(count) / 40.0), in_time=False)
    edges = np.concatenate([np.arange(start, start + 5) for start in (50, 995, 1300, count - 55)])
    assert np.abs(step(there * level)[edges]).max() > 4.0
    assert np.abs(after_steps([step], there * level, gaps)[edges]).max() < 1.5
    noise = gaps.filled(there * np.random.default_rng(5).standard_normal(count))
    assert float(np.mean(noise**2)) == pytest.approx(gaps.share(count), abs=5.0 * np.sqrt(2.0 * 1.5 / count))
    assert gaps.share(count) == pytest.approx(1.0 - 100.0 / count, abs=1e-3)  # two that fade have two thirds


def test_products_after_a_step_are_those_of_stepped_data_with_readings_left_out(data: WhitenedData) -> None:
    out = np.zeros((len(data.base), 6), dtype=bool)
    out[[0, 1, 700, -1], 4] = True
    some = data.without(out)
    steps = [Step(4, np.linspace(0.1, 1.0, data.count), in_time=False)]
    under, _ = under_steps(pieces_of(some, unexplained(some.whitened)), unexplained(some.whitened), steps)
    stepped = some.stepped(steps)
    left = project(stepped.absorbed, stepped.whiten(stepped.residual))
    assert under.left @ under.left == pytest.approx(left @ left, rel=1e-6)


def test_derivatives_are_taken_beside_what_changes_them(data: WhitenedData) -> None:
    """Beside a latency of seconds a candidate's columns are those of the delayed path; beside one of ms as before."""
    late, later, little = (make_effect("latency", {"where": "acquisition", "delay_s": s}) for s in (2.0, 2.01, 1e-3))
    scanner = Scanner.of(data)
    assert scanner.beside([little], data.pipeline) is scanner
    found = scanner.beside([late], data.pipeline)
    assert scanner.beside([later], data.pipeline) is found
    candidate = Candidate(EFFECTS["joint_scale"], "joint5")
    step = float(candidate.steps[0])
    change = data.change([late, candidate.make([step], {})]) - data.change([late])
    expected, plain = data.whiten(change) / step, data.whiten(next(candidate.derivatives(data, {})))
    values = candidate.columns(found.fine.data, {}).values[:, 0]
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    assert np.linalg.norm(plain - expected) > 0.01 * np.linalg.norm(expected)
    under = scanner.stepped([Step(0, np.full(data.count, 0.5), in_time=True)])
    assert under.beside([late], data.pipeline).fine.data.steps == under.fine.data.steps


def test_whitening_begins_at_the_first_reading_that_is_there(data: WhitenedData) -> None:
    """What fades as drifting noise does counts by the drift's variance, whatever is left out before: exactly so, up to
    the share that the filter's memory leaves."""
    drifting = ChannelNoise(1e-6, parts=((1e-2, 50.0 * data.interval_s),))
    out = np.zeros(data.readings.shape, dtype=bool)
    out[:3] = True
    some = replace(data, noises=(drifting,) * 6).without(out)
    fading = np.exp(-np.arange(data.count) / 50.0)
    there = data.count - 3
    covariance = toeplitz(drifting.autocovariance(data.interval_s * np.arange(float(there))))
    exact = float(fading[3:] @ np.linalg.solve(covariance, fading[3:]))
    white = some.whiten_means(0, fading)
    assert not white[:3].any()
    assert float(white @ white) == pytest.approx(exact, rel=0.02)
