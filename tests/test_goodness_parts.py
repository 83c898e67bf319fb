"""The parts of goodness one by one, robust calibration, and what is written down of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from goodness_examples import calibrated, good, known
from kinematic_examples import ACCELEROMETER_NOISE, TABLE_5
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2

import estimators
import scenarios
from estimators.calibration import Calibration
from estimators.ellipsoid.calibrate import calibrate_attitude_free
from estimators.goodness import (
    clipped,
    hold_out,
    is_it_good,
    judged,
    outliers,
    reject_outliers,
    repeats,
    residuals_of,
    robust_calibrate,
    whiteness,
)
from estimators.goodness.hold_out import tail_probability
from estimators.goodness.residuals import selected
from estimators.stillness import still_poses
from rig.arm import Arm
from rig.errors import RefusedFit, RigError
from rig.maneuver import StaticPoses
from rig.recording import Metadata, Recording, thinned


@pytest.fixture(scope="module")
def ann_arbor() -> Recording:
    return scenarios.load("ann-arbor").simulate(seed=0)


# The tests one by one


def test_the_tail_of_a_quadratic_form() -> None:
    """Equal weights are a chi-square; others are held against two million draws, good to 1.4 % at 2.5e-3.

    The approximation is good to some per cent of the probability.
    """
    for value in (0.5, 3.0, 20.0, 60.0):
        assert tail_probability(2.0 * np.eye(3), np.eye(3), 2.0 * value) == pytest.approx(chi2.sf(value, 3), rel=0.02)
    weights = np.array([-0.05, -0.02, 0.1, 0.3, 0.3, 0.7])
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    draws = np.square(rng.normal(size=(2_000_000, 6))) @ weights
    for share in (0.9, 0.5, 0.1, 2.5e-3):
        value = float(np.quantile(draws, 1.0 - share))
        found = tail_probability(turn @ np.diag(weights) @ turn.T, np.eye(6), value)
        assert found == pytest.approx(share, rel=0.1)
    assert tail_probability(np.eye(2), np.eye(2), -1.0) == 1.0
    assert tail_probability(np.diag(weights), np.eye(6), 1e9) == 0.0


def test_holding_out_is_a_fit_without_the_block() -> None:
    """One Gauss-Newton step against a whole fit of the rest; they differ by the square of a change of some percent."""
    run = known(400, np.random.default_rng(3))
    calibration = estimators.calibrate(run, noise={"accelerometer": ACCELEROMETER_NOISE})
    residuals = residuals_of(run, "accelerometer", calibration["accelerometer"])
    held = fitted = 0.0
    for block in range(10):
        rows = np.arange(400)
        rest = run.select((rows < 40 * block - 4) | (rows >= 40 * block + 44))
        other = estimators.calibrate(rest, noise={"accelerometer": ACCELEROMETER_NOISE})["accelerometer"]
        part = run.select(slice(40 * block, 40 * block + 40))
        held += np.square(residuals_of(part, "accelerometer", other).standardised).sum()
        fitted += np.square(residuals.standardised[40 * block : 40 * block + 40]).sum()
    found = hold_out(residuals)
    assert found is not None
    assert found.blocks == 10
    assert found.ratio == pytest.approx(np.sqrt(held / fitted), rel=2e-4)


def test_a_block_that_alone_sees_something_cannot_be_held_out() -> None:
    """Turns about one axis but for one block."""
    n = 1000
    turns = np.outer(np.linspace(0.0, 40.0, n), [0.0, 0.0, 1.0])
    turns[300:400] = Rotation.random(100, rng=np.random.default_rng(4)).as_rotvec()
    rotation = Rotation.from_rotvec(turns)
    volts = TABLE_5.volts(TABLE_5.components(rotation.as_matrix(), np.array([5.0, 3.0, -8.0])))
    volts += np.random.default_rng(5).normal(size=volts.shape) * ACCELEROMETER_NOISE
    run = Recording(t=np.arange(n) / 4.0, tool_quaternion=rotation.as_quat(scalar_first=True), accelerometer=volts)
    found = good(run)
    assert found.hold_out is not None
    assert found.hold_out.alone == (3,)
    assert "1 of ten parts of the recording cannot be done without" in found.verdict


def test_a_calibration_of_another_day_is_judged_by_its_parameters() -> None:
    """As good as it holds: 200 recordings of the same sensor, with the p-values of the tests of structure and transfer.

    Each count is binomial; tails cut at 1e-5, eight counts: outside once in 6,000 runs.
    """
    rng = np.random.default_rng(22)
    found = []
    for _ in range(200):
        calibration = calibrated(known(600, rng))
        judgement = good(known(300, rng), calibration)
        assert judgement.transfer is not None
        assert judgement.by_direction is not None
        assert judgement.hold_out is not None
        block = float(judgement.hold_out.block_p_values[4])
        found.append([judgement.transfer.p_value, judgement.by_direction.p_value, block, judgement.whiteness.p_value])
    for level in (0.05, 0.5):
        low, high = binom.ppf([1e-5, 1.0 - 1e-5], 200, level)
        counts = (np.array(found) < level).sum(axis=0)
        assert ((counts >= low) & (counts <= high)).all(), counts


def test_a_sensor_that_has_changed_is_not_the_calibrations() -> None:
    """By 5 mV, a third of the noise of a reading and six standard deviations of the offset."""
    rng = np.random.default_rng(23)
    calibration = calibrated(known(2000, rng))
    later = known(2000, rng)
    assert good(later, calibration).good
    found = good(
        replace(later, accelerometer=later.readings("accelerometer") + np.array([0.005, 0.0, 0.0])), calibration
    )
    assert "its parameters have moved" in found.verdict
    assert found.by_direction is not None
    assert found.by_direction.p_value > 1e-4  # the model is right, with other parameters
    own = known(2000, rng)
    same = good(own, calibrated(own)).transfer
    assert same is not None
    assert same.chi_square < 1e-6


def test_attitude_free_calibrations_are_judged_at_rest() -> None:
    """60 poses held by hand: judged by their means, and clipping and repeats by the readings."""
    run = scenarios.load("camps2009-accelerometer").simulate(seed=0)
    calibration = Calibration(calibrate_attitude_free(run, run.sensors).sensors, run.name)
    found = is_it_good(run, calibration)["accelerometer"]
    assert found.good, str(found)
    assert found.samples == len(run)
    assert found.coverage.counts.sum() == len(still_poses(run)) < 100
    readings = np.minimum(run.readings("accelerometer"), [1.2, 9.0, 9.0])
    held = replace(run, accelerometer=readings)
    assert "readings are clipped (accel1 at 1.2" in is_it_good(held, calibration)["accelerometer"].verdict
    back = judged(run, calibration)["accelerometer"].quality
    assert {"share", "mean_direction"} <= set(back.coverage)


def test_repeats_are_held_against_chance() -> None:
    """A converter of 4 steps to the standard deviation repeats one reading in 2,900 by chance."""
    rng = np.random.default_rng(6)
    readings = np.round(rng.normal(size=(100_000, 3)) * 4.0)
    found = repeats(readings, (4.0, 4.0, 4.0))
    assert found.expected == pytest.approx(99_999 * (1.0 / (8.0 * np.sqrt(np.pi))) ** 3)
    assert found.count == pytest.approx(found.expected, abs=5.0 * np.sqrt(found.expected))  # Poisson
    assert not found.significant
    assert repeats(readings[np.arange(100_000) // 2 * 2]).significant
    single = readings[:50].copy()
    single[10] = single[9] = [17.0, -15.0, 14.0]
    assert repeats(single, (400.0, 400.0, 400.0)).significant
    assert repeats(rng.normal(size=(1000, 3))).count == 0


@pytest.mark.parametrize("step", [1e-3, 0.0], ids=["converter", "continuous"])
@pytest.mark.parametrize("shape", ["sphere", "gauss", "even", "sine"])
def test_what_is_not_clipped_is_not_called_so(shape: str, step: float) -> None:
    """None of 60 ends, of distributions of any shape; false alarms are below 1e-6 each."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        values = {
            "sphere": 1.4 * Rotation.random(20_000, rng=rng).as_matrix()[:, 0] + rng.normal(size=(20_000, 3)) * 0.013,
            "gauss": rng.normal(size=(20_000, 3)),
            "even": rng.uniform(-1.0, 1.0, (20_000, 3)) + rng.normal(size=(20_000, 3)) * 0.001,
            "sine": np.sin(rng.uniform(0.0, 7.0, (20_000, 3))) + rng.normal(size=(20_000, 3)) * 0.001,
        }[shape]
        assert clipped(np.round(values / step) * step if step else values).count == 0


@pytest.mark.parametrize(("step", "count"), [(1.2207e-3, 200), (0.0, 20)], ids=["converter", "continuous"])
def test_a_few_clipped_readings_are_enough(step: float, count: int) -> None:
    """A hundredth, or where no two readings are alike by chance a thousandth, of 20,000: in one channel at one end."""
    rng = np.random.default_rng(8)
    values = 2.5 + 1.4 * Rotation.random(20_000, rng=rng).as_matrix()[:, 0] + rng.normal(size=(20_000, 3)) * 0.013
    values = np.round(values / step) * step if step else values
    limit = np.sort(values[:, 1])[-count]
    values[:, 1] = np.minimum(values[:, 1], limit)
    found = clipped(values)
    assert found.high[1] >= count
    assert found.count == found.high[1]
    assert found.highest[1] == limit


def test_poses_without_noise_pile_up_by_themselves() -> None:
    """Below half a step of noise only a known limit tells."""
    levels = np.repeat(np.array([[0.0, 1.0, 2.0], [2.0, 0.0, 1.0], [1.0, 2.0, 0.0]]), 100, axis=0)
    levels += np.random.default_rng(9).choice([0.0, 0.01], levels.shape)
    assert clipped(levels, (0.001, 0.001, 0.001)).count == 0
    assert clipped(levels, (0.001, 0.001, 0.001), limits=(-1.0, 2.01)).high[0] > 10


def test_whiteness_knows_the_correlation() -> None:
    rng = np.random.default_rng(10)
    run = known(4000, rng)
    calibration = calibrated(run)["accelerometer"]
    residuals = residuals_of(run, "accelerometer", calibration)
    process = lfilter([1.0], [1.0, -0.5], rng.normal(size=(4000, 3)), axis=0)
    found = whiteness(replace(residuals, values=process))
    # Of 12,000 pairs: sqrt((1 - 0.25) / 12,000) = 0.8 %.
    assert found.correlation == pytest.approx(0.5, abs=0.04)
    assert found.inflation == pytest.approx(np.sqrt(3.0), rel=0.06)
    assert found.p_value < 1e-99
    # A gap after every second sample: only pairs of the same burst count, and these are alike.
    bursts = np.repeat(rng.normal(size=(2000, 3)), 2, axis=0)
    t = np.arange(4000) + 10.0 * (np.arange(4000) // 2)
    apart = whiteness(replace(residuals, values=bursts, t=t / 1.0))
    assert apart.correlation > 0.9


# Robust calibration


@pytest.mark.parametrize("share", [0.0, 0.01, 0.2])
def test_outliers_are_left_out(share: float) -> None:
    """Exactly those, gross and all on one side; the estimate is within five standard deviations of the truth."""
    rng = np.random.default_rng(12)
    run = known(3000, rng)
    volts, out = np.array(run.accelerometer), rng.choice(3000, int(share * 3000), replace=False)
    volts[out, rng.integers(0, 3, len(out))] += rng.uniform(0.5, 2.0, len(out))
    calibration, rejected = robust_calibrate(
        replace(run, accelerometer=volts), noise={"accelerometer": ACCELEROMETER_NOISE}
    )
    found, rejection = calibration["accelerometer"], rejected["accelerometer"]
    # Beyond five standard deviations are 0.005 of 9,000 good readings.
    assert np.flatnonzero(~rejection.kept).tolist() == sorted(out.tolist())
    truth = {f"sensitivity{k + 1}": value for k, value in enumerate(TABLE_5.sensitivity)}
    truth |= {f"offset{k + 1}": value for k, value in enumerate(TABLE_5.offset)}
    for name, value in truth.items():
        assert abs(found.value(name) - value) < 5.0 * found.std(name)
    assert any("left out as outliers" in warning for warning in found.quality.warnings) is (share > 0.0)
    assert good(replace(run, accelerometer=volts).select(rejection.kept), calibration).good
    # Of the whole recording it is known that they were left out.
    whole = good(replace(run, accelerometer=volts), calibration)
    assert whole.good, str(whole)
    assert whole.left_out == len(out)


def test_a_model_that_does_not_hold_has_no_outliers() -> None:
    run = known(2000, np.random.default_rng(13))
    volts = np.array(run.accelerometer)
    volts[:800] += np.random.default_rng(14).normal(size=(800, 3))
    with pytest.raises(RefusedFit, match="these are no outliers"):
        reject_outliers(replace(run, accelerometer=volts), "accelerometer")
    with pytest.raises(RigError, match="expected 2 standard deviations or more"):
        reject_outliers(run, "accelerometer", cut=1.0)


def test_outliers_of_few_readings_are_not_imagined() -> None:
    """In 300 recordings of 20 poses: the stated rate is 1e-4."""
    rng = np.random.default_rng(15)
    found = 0
    for _ in range(300):
        run = known(20, rng)
        found += outliers(residuals_of(run, "accelerometer", calibrated(run)["accelerometer"])).significant
    assert found <= 1


# Writing it down


def test_the_verdict_goes_with_the_calibration(ann_arbor: Recording, tmp_path: Path) -> None:
    calibration = judged(ann_arbor, estimators.calibrate(ann_arbor))
    calibration.write(tmp_path / "cal.json")
    back = Calibration.read(tmp_path / "cal.json")
    assert back.to_json() == calibration.to_json()
    own = back["accelerometer"]
    assert own.quality.verdict is not None
    assert own.quality.verdict["good"] is True
    assert own.quality.verdict["text"].startswith("good: ")
    assert own.quality.verdict["text"] in str(back)
    assert own.quality.coverage["share"] > 0.95
    assert own.quality.clipped["count"] == own.quality.repeats["count"] == own.quality.outliers["count"] == 0
    assert own.quality.warnings == ()


def test_reasons_are_warnings(ann_arbor: Recording) -> None:
    held = np.array(ann_arbor.accelerometer)[np.arange(len(ann_arbor)) // 4 * 4]
    run = replace(ann_arbor, accelerometer=held)
    calibration = judged(run, estimators.calibrate(run))
    assert any("repeat the one before" in warning for warning in calibration["accelerometer"].quality.warnings)
    verdict = calibration["accelerometer"].quality.verdict
    assert verdict is not None
    assert verdict["good"] is False
    assert verdict["text"] == f"not good: because {'; '.join(verdict['reasons'])}"
    assert str(calibration).count("repeat the one before") == 1
    assert calibration["magnetometer"].quality.warnings == ()


def test_a_file_is_judged_as_the_recording_is(ann_arbor: Recording, tmp_path: Path) -> None:
    ann_arbor.write(tmp_path / "run.parquet")
    calibration = estimators.calibrate(ann_arbor)
    in_memory = is_it_good(ann_arbor, calibration)["magnetometer"]
    from_file = is_it_good(tmp_path / "run.parquet", calibration)["magnetometer"]
    assert from_file.verdict == in_memory.verdict
    assert from_file.to_json() == in_memory.to_json()


def test_long_recordings_are_thinned_evenly(ann_arbor: Recording, tmp_path: Path) -> None:
    ann_arbor.write(tmp_path / "run.csv")
    for run in (ann_arbor, tmp_path / "run.csv"):
        found = thinned(run, 1000)
        assert 400 < len(found) <= 1000
        # Stretches of four successive samples, a quarter of a second apart.
        steps = np.diff(found.t)
        assert np.isclose(steps, 0.25).mean() == pytest.approx(0.75, abs=0.01)
        assert np.ptp(steps[steps > 0.3]) < 1e-9
        assert found.t[-1] > 0.98 * ann_arbor.t[-1]
    calibration = estimators.calibrate(ann_arbor)
    judgement = is_it_good(ann_arbor, calibration, at_most=1000)["accelerometer"]
    assert judgement.samples <= 1000
    assert judgement.good


def test_averaged_poses_are_judged_by_their_counts() -> None:
    """The noise of a mean of n readings is smaller by sqrt(n); otherwise the residuals would be far below the floor."""
    maneuver = StaticPoses(count=40, hold_s=3.0, move_s=2.0, seed=4)
    rig = scenarios.load("ann-arbor").with_acquisition(decimation=1).rig
    run = rig.simulate(maneuver, np.random.default_rng(16))
    poses = still_poses(run)
    sigma = np.asarray(rig.acquisition.noise_V)[:3]
    calibration = estimators.calibrate(poses.recording, sensors=["accelerometer"], noise={"accelerometer": sigma})
    residuals = residuals_of(poses.recording, "accelerometer", calibration["accelerometer"], Arm.a465())
    # 120 residuals less 14 parameters: 7 %; the poses' weights differ little.
    assert np.sqrt(np.square(residuals.standardised).sum() / (120 - 14)) == pytest.approx(1.0, abs=0.35)


def test_a_pose_that_is_left_out_takes_its_count_with_it() -> None:
    run = known(60, np.random.default_rng(24))
    counts = list(range(10, 70))
    poses = replace(run, metadata=Metadata(extra={"pose_samples": counts}))
    rows = np.arange(60) % 7 != 3
    assert selected(poses, rows).metadata.extra["pose_samples"] == [
        c for c, kept in zip(counts, rows, strict=True) if kept
    ]
    assert len(selected(run, rows)) == rows.sum()


def test_another_unit_is_refused() -> None:
    run = known(100, np.random.default_rng(17))
    calibration = calibrated(run)
    with pytest.raises(RigError, match="expected the calibration's V"):
        is_it_good(replace(run, units={"accelerometer": "mV"}), calibration)


def test_short_recordings_are_judged_as_far_as_that_goes() -> None:
    run = known(18, np.random.default_rng(18))
    found = good(run)
    assert found.by_direction is None
    assert found.hold_out is None
    assert "too few readings to look at them by direction" in found.verdict
