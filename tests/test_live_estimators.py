"""Recursive estimators: what comes piece by piece says the same as what comes at once."""

from __future__ import annotations

import numpy as np
import pytest
from directions import unit_vectors

import estimators
import scenarios
from estimators.coverage import direction_name
from estimators.ellipsoid import Options as EllipsoidOptions
from estimators.ellipsoid.fit import fit_ellipsoid
from estimators.ellipsoid.running import brought_up
from estimators.ellipsoid.thinned import Thinned
from estimators.known_angle.statistics import Statistics
from estimators.live import PROCEDURES, Calibrator, Cloud, Guide, Options, SlidingSum, StillStream
from rig.arrays import Array
from rig.errors import RigError
from rig.recording import Recording

GAIN = np.array([[0.14, 0.002, 0.001], [0.002, 0.143, -0.003], [0.001, -0.003, 0.138]])
OFFSET = np.array([2.3, 2.4, 2.1])
NOISE = 0.0135


def tumbled(count: int, seed: int, noise: float = NOISE) -> Array:
    rng = np.random.default_rng(seed)
    return 9.8 * unit_vectors(rng, count) @ GAIN + OFFSET + noise * rng.standard_normal((count, 3))


@pytest.fixture(scope="module")
def sweep() -> Recording:
    return scenarios.load("ann-arbor").simulate(seed=3)


def fed(run: Recording, options: Options, piece: int) -> Calibrator:
    stream = Calibrator(run, options)
    for first in range(0, len(run), piece):
        stream.add(run.select(slice(first, first + piece)))
    return stream


@pytest.mark.parametrize("piece", [7, 1000])
def test_with_a_pose_the_stream_says_what_the_offline_fit_says(sweep: Recording, piece: int) -> None:
    stream = fed(sweep, Options(), piece)
    offline = estimators.calibrate(sweep, noise="residuals")
    for sensor in sweep.sensors:
        live, whole = stream.estimate(sensor), offline[sensor]
        assert live.names == whole.parameters
        sigma = np.sqrt(np.diagonal(whole.covariance))
        # sums of 6,656 products in another order: some 1e-14 of themselves, times a condition below 1e3
        np.testing.assert_allclose((live.values - whole.values) / sigma, 0.0, atol=1e-6)
        np.testing.assert_allclose(live.std, sigma, rtol=1e-9)


def test_a_sliding_window_says_what_its_own_samples_say(sweep: Recording) -> None:
    span = 800.0
    stream = fed(sweep, Options(forget_s=span), 40)
    count = stream.estimate("accelerometer").samples
    # a twentieth of the window more at most, and one piece
    assert span * sweep.rate_Hz <= count <= 1.05 * span * sweep.rate_Hz + 2 * 40
    last = sweep.select(slice(len(sweep) - count, None))
    offline = estimators.calibrate(last, noise="residuals")
    for sensor in sweep.sensors:
        live, whole = stream.estimate(sensor), offline[sensor]
        sigma = np.sqrt(np.diagonal(whole.covariance))
        np.testing.assert_allclose((live.values - whole.values) / sigma, 0.0, atol=1e-6)


def test_old_parts_are_dropped_and_never_subtracted() -> None:
    window = SlidingSum(1.0)
    large, small = (Statistics(0, np.full((10, 10), size), np.zeros((10, 3)), np.zeros((3, 3))) for size in (1e30, 1.0))
    window.add(0.0, large)
    for step in range(1, 300):
        window.add(0.01 * step, small)
    assert window.total is not None
    assert window.total.gram[0, 0] == np.round(window.total.gram[0, 0]) <= 107.0


def held(poses: int, seed: int) -> tuple[Array, Array, Array]:
    """Times, readings and the poses' true means: 3 s still, 1 s of motion, again and again at 100 Hz."""
    rng = np.random.default_rng(seed)
    means = 9.8 * unit_vectors(rng, poses) @ GAIN + OFFSET
    parts = []
    for place, mean in enumerate(means):
        parts.append(np.tile(mean, (300, 1)))
        after = means[(place + 1) % poses]
        parts.append(mean + np.linspace(0.0, 1.0, 100)[:, None] * (after - mean) + 0.2 * rng.standard_normal((100, 3)))
    readings = np.concatenate(parts)
    return 0.01 * np.arange(len(readings)), readings + NOISE * rng.standard_normal(readings.shape), means


@pytest.mark.parametrize("piece", [1, 13, 1600])
def test_still_poses_are_found_as_they_come_without_motion(piece: int) -> None:
    t, readings, truth = held(30, seed=4)
    stream = StillStream(100.0)
    for first in range(0, len(t), piece):
        stream.add(t[first : first + piece], readings[first : first + piece])
    # the threshold needs the first windows, so the first pose or two may be missed; a split pose is one too many
    assert 28 <= len(stream) <= 30
    nearest = np.argmin(np.linalg.norm(truth[None] - stream.means[:, None], axis=2), axis=1)
    errors = stream.means - truth[nearest]
    # a mean over n readings errs by NOISE / sqrt(n); 90 of them exceed five sigma once in 20,000 runs
    assert (np.abs(errors) < 5.0 * NOISE / np.sqrt(stream.counts)[:, None]).all()
    assert (stream.counts >= 50).all()


@pytest.mark.parametrize("piece", [7, 1000])
def test_without_a_pose_the_stream_says_what_the_offline_fit_says(piece: int) -> None:
    t, accelerometer, _ = held(40, seed=5)
    magnetometer = tumbled(len(t), seed=6) * [1.0, 1.3, 0.8]
    magnetometer[[50, 7000]] += 1.0  # outliers
    run = Recording(t=t, accelerometer=accelerometer, magnetometer=magnetometer)
    stream = fed(run, Options(attitude=False), piece)
    offline = estimators.calibrate(run, method="ellipsoid", noise="residuals", attitude_free=EllipsoidOptions())
    for sensor in run.sensors:
        live, whole = stream.estimate(sensor), offline[sensor]
        assert live.names == whole.parameters
        assert live.samples == whole.samples
        # the same samples by the same steps
        assert np.array_equal(live.values, whole.values)
        np.testing.assert_allclose(live.std, np.sqrt(np.diagonal(whole.covariance)), rtol=1e-12)
    assert stream.estimate("accelerometer").poses == 40


def test_what_is_kept_depends_on_the_number_of_samples_alone() -> None:
    """Of 10,000 rows a limit of 1,000 leaves those that sixteen divides, however they came."""
    run = Recording(t=0.01 * np.arange(10_000), magnetometer=tumbled(10_000, seed=7))
    for pieces in ([1] * 100 + [33] * 300, [10_000], [2_500] * 4):
        kept, row = Thinned(1_000), 0
        for piece in pieces:
            kept.add(run.select(slice(row, row + piece)))
            row += piece
        assert row == len(run)
        assert np.array_equal(kept.recording().t, run.t[::16])
        assert np.array_equal(kept.recording().readings("magnetometer"), run.readings("magnetometer")[::16])


def test_of_a_sliding_window_the_last_seconds_are_kept() -> None:
    run = Recording(t=0.01 * np.arange(10_000), magnetometer=tumbled(10_000, seed=8))
    kept = Thinned(1_000, span_s=5.0)
    for row in range(0, len(run), 30):
        kept.add(run.select(slice(row, min(row + 30, len(run)))))
    assert np.array_equal(kept.recording().t, run.t[run.t >= run.t[-1] - 5.0])
    few = Thinned(100, span_s=5.0)
    for row in range(0, len(run), 30):
        few.add(run.select(slice(row, min(row + 30, len(run)))))
    assert np.array_equal(few.recording().t, [t for t in run.t[::8] if t >= run.t[-1] - 5.0])


def test_of_a_sliding_window_too_what_is_kept_does_not_depend_on_the_pieces() -> None:
    """At a rate that changes, the window holds 2,000 samples at most: one of two is kept, then of four, for good."""
    steps = np.concatenate([np.full(3_000, 0.01), np.full(3_000, 0.0025), np.full(3_000, 0.02)])
    run = Recording(t=np.cumsum(steps), magnetometer=tumbled(9_000, seed=9))
    found = []
    for piece in (1, 7, 300, 9_000):
        kept = Thinned(600, span_s=5.0)
        for row in range(0, len(run), piece):
            kept.add(run.select(slice(row, row + piece)))
        found.append(kept.recording().t)
    assert np.array_equal(found[0], run.t[::4][run.t[::4] >= run.t[-1] - 5.0])
    assert all(np.array_equal(found[0], other) for other in found[1:])


@pytest.mark.parametrize("bad", [0.0, 0.003])
def test_a_fit_brought_up_to_date_by_sums_is_that_of_all_samples(bad: float) -> None:
    """A tenth more samples, with outliers or without. The channels' noise is found from an eighth of them, to some 8 %
    of its variance, and anew by the fit of all: weights that differ by so much move an estimate by some .08 standard
    deviations. Four times that is allowed for the largest of nine."""
    readings = tumbled(22_000, seed=10)
    rng = np.random.default_rng(11)
    readings[rng.random(len(readings)) < bad] += 0.5
    running = fit_ellipsoid(readings[:20_000], 9.8)
    for row in range(20_000, 22_000, 50):
        updated = brought_up(running, readings[row - 1 : row + 50])
        assert updated is not None
        running = updated
    whole = fit_ellipsoid(readings, 9.8)
    assert abs(running.samples - whole.samples) <= 2
    assert running.samples + running.dropped.outliers == len(readings)
    np.testing.assert_allclose((running.values - whole.values) / whole.std, 0.0, atol=0.32)
    np.testing.assert_allclose(running.std, whole.std, rtol=0.08)


def test_the_cloud_is_bounded_and_keeps_every_reading() -> None:
    cloud = Cloud()
    for seed in range(20):
        cloud.add(float(seed), tumbled(5_000, seed))
    assert len(cloud) < 8192
    assert cloud.counts.sum() == 100_000
    np.testing.assert_allclose((cloud.counts[:, None] * cloud.means).sum(axis=0) / 1e5, OFFSET, atol=0.02)


def test_the_cloud_forgets() -> None:
    cloud = Cloud(span_s=10.0)
    cloud.add(0.0, np.tile(OFFSET, (5, 1)) + 1.0)
    cloud.add(20.0, tumbled(100, 0))
    assert cloud.counts.sum() == 100


def test_it_is_enough_when_the_intervals_are_and_the_sphere_was_seen() -> None:
    rng = np.random.default_rng(6)
    u = unit_vectors(rng, 30_000)
    for up, wanted in ((u, True), (u[u[:, 2] > 0.3], False)):
        mag = up @ GAIN + OFFSET + 1e-5 * rng.standard_normal(up.shape)
        run = Recording(t=0.01 * np.arange(len(mag)), magnetometer=mag)
        stream = fed(run, Options(to=1e-2, attitude=False), 1_000)
        state = stream.state("magnetometer")
        assert state.interval < 1e-2
        assert state.enough is wanted
        if not wanted:
            assert "-z" in state.turn


def test_procedures_say_which_turn_is_missing() -> None:
    turns = PROCEDURES["three-turns"]
    assert turns.undetermined(9) == ("angle1-2",)
    assert turns.undetermined(6) == ()
    assert "add one slow turn about z, beginning with x up" in str(turns.lacking())
    for name in ("four-turns", "faces-and-edges", "sphere"):
        assert PROCEDURES[name].lacking() is None


def test_a_procedure_is_shown_step_by_step() -> None:
    guide = Guide(PROCEDURES["faces"])
    seen = []
    for number in range(6):
        assert guide.number == number
        ups = np.array(seen).reshape(-1, 3)
        assert guide.words(ups).startswith(f"step {number + 1} of 6: hold it with ")
        seen.append(guide.procedure.steps[number].directions[0])
        guide.see(np.array(seen))
    assert guide.words(np.array(seen)) == "faces is done"
    assert {direction_name(up) for up in seen} == {"+x", "-x", "+y", "-y", "+z", "-z"}


def test_an_unknown_procedure_and_bad_options_are_refused() -> None:
    with pytest.raises(RigError, match="three-turns"):
        estimators.live.procedure("three-turn")
    with pytest.raises(RigError, match="forget_s: found -1"):
        Options(forget_s=-1.0)
