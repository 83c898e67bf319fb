"""Is it good? Good calibrations are called good as often as is stated, and each fault is found and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import ellipsoid_examples as example
import numpy as np
import pytest
from directions import unit_vectors
from goodness_examples import calibrated, good, known, unknown
from scipy.signal import lfilter
from scipy.stats import binom

import estimators
import scenarios
from estimators.calibration import Calibration
from estimators.ellipsoid import Options
from estimators.goodness import (
    Goodness,
    is_it_good,
    residuals_of,
)
from rig.arrays import Array
from rig.recording import Metadata, Recording


def spoilt(change: Callable[[Array, np.random.Generator], Array], n: int = 6000, seed: int = 0) -> Goodness:
    rng = np.random.default_rng(seed)
    run = known(n, rng)
    return good(replace(run, accelerometer=change(np.array(run.accelerometer), rng)))


@pytest.fixture(scope="module")
def ann_arbor() -> Recording:
    return scenarios.load("ann-arbor").simulate(seed=0)


# Good calibrations


@cache
def probabilities(attitude: str, n: int) -> tuple[Array, int]:
    """(draws, 4) p-values of good calibrations: by direction, of a held-out block, of whiteness, against the floor."""
    rng = np.random.default_rng(20)
    rows, called_good = [], 0
    for _ in range(200):
        run, calibration = unknown(n, rng) if attitude == "unknown" else (known(n, rng), None)
        found = good(run, calibration)
        assert found.by_direction is not None
        assert found.hold_out is not None
        assert found.chi_square is not None
        first_block = float(found.hold_out.block_p_values[0])
        rows.append(
            [found.by_direction.p_value, first_block, found.whiteness.p_value, float(found.chi_square["p_value"])]
        )
        called_good += found.good
    return np.array(rows), called_good


@pytest.mark.parametrize(("attitude", "n"), [("known", 300), ("known", 2000), ("unknown", 300)])
def test_p_values_are_what_they_are_called(attitude: str, n: int) -> None:
    """Of 200 good calibrations about a twentieth has p < 0.05, and half has p < 0.5, test by test.

    Each count is binomial; both its tails are cut at 1e-5, so of these 24 counts one is outside in 2,000 runs.
    """
    found, called_good = probabilities(attitude, n)
    for level in (0.05, 0.5):
        low, high = binom.ppf([1e-5, 1.0 - 1e-5], 200, level)
        counts = (found < level).sum(axis=0)
        assert ((counts >= low) & (counts <= high)).all(), counts
    # Less than one in a thousand is called not good: more than four of 200 once in 100,000 runs.
    assert called_good >= 196


def test_a_good_calibration_is_called_good(ann_arbor: Recording) -> None:
    """With either sensor, from joint angles; the seeds are the first ones, and the stated rate of failure is 1e-3."""
    noise = scenarios.load("ann-arbor").rig.acquisition.noise_V
    calibration = estimators.calibrate(ann_arbor, noise=noise)
    found = is_it_good(ann_arbor, calibration)
    assert set(found) == {"accelerometer", "magnetometer"}
    for sensor, goodness in found.items():
        assert goodness.good, str(goodness)
        assert str(goodness).startswith(f"{sensor}: good: residuals over noise floor ")
        assert goodness.coverage.share > 0.95
        assert goodness.hold_out is not None
        # Ten blocks of the sweep: 14 parameters more than twice over in 19,968 readings.
        assert goodness.hold_out.ratio == pytest.approx(1.0 + 14 / 19_968, abs=14 / 19_968)


def test_separate_fits_and_other_recordings_are_judged_too(ann_arbor: Recording) -> None:
    separate = estimators.calibrate(ann_arbor, method="separate")
    found = is_it_good(ann_arbor, separate)["magnetometer"]
    assert found.good
    assert "no noise floor was recorded" in found.verdict
    other = scenarios.load("ann-arbor").simulate(seed=5)
    assert is_it_good(other, separate)["magnetometer"].good
    off = estimators.calibrate(scenarios.load("renk2005-table2").simulate(seed=0), sensors=["accelerometer"])
    assert not is_it_good(other, off)["accelerometer"].good


# Faults


def test_repeated_readings_are_named() -> None:
    found = spoilt(lambda volts, _: volts[np.arange(len(volts)) // 3 * 3])
    assert not found.good
    assert found.repeats.held == pytest.approx(3.0, rel=0.01)
    assert found.repeats.longest == 3
    assert "too small by a factor of 1.73" in found.verdict


def test_repeats_that_change_nothing_are_only_remarked_upon() -> None:
    """One in five hundred: standard deviations are a thousandth too small."""
    run = known(6000, np.random.default_rng(22))
    assert run.tool_quaternion is not None
    assert run.accelerometer is not None
    rows = np.arange(6000)
    rows[1::500] -= 1
    found = good(replace(run, tool_quaternion=run.tool_quaternion[rows], accelerometer=run.accelerometer[rows]))
    assert found.repeats.significant
    assert found.good, found.verdict
    assert "0.2 % of the readings repeat the one before; no clipped or outlying readings" in found.verdict


def test_clipped_readings_are_named() -> None:
    found = spoilt(lambda volts, _: np.clip(volts, None, 3.6))
    assert found.clipped.high[0] > 100
    assert found.clipped.low == (0, 0, 0)
    assert f"readings are clipped (accel1 at 3.6 {found.clipped.high[0]}" in found.verdict


def test_outliers_are_named() -> None:
    def add(volts: Array, rng: np.random.Generator) -> Array:
        volts[rng.choice(len(volts), 12, replace=False), 1] += 0.3
        return volts

    found = spoilt(add)
    assert found.outliers.count == len(found.outliers.rows) == 12
    # 0.3 V of 13.6 mV, less what the fit and the robust scale make of it.
    assert found.outliers.largest == pytest.approx(22.0, rel=0.3)
    assert "12 readings are outliers" in found.verdict


def test_what_depends_on_the_direction_is_named() -> None:
    """A cubic term in channel 3: a fit leaves a third harmonic, 2/5 x 1/sqrt(7) of it, which is 0.4 times the noise."""
    found = spoilt(lambda volts, _: volts + np.array([0.0, 0.0, 0.04]) * ((volts - 2.1) / 1.4) ** 3)
    assert found.by_direction is not None
    assert found.by_direction.p_value < 1e-6
    assert "residuals depend on the direction" in found.verdict
    score = np.nanmean(np.square(found.by_direction.score), axis=0)
    # In the channels that are as they should be a cell's mean has a standard error of one, 162 times: 11 %.
    assert score[:2] == pytest.approx([1.0, 1.0], abs=0.6)
    assert score[2] > 2.0


def test_drift_is_found_by_holding_out() -> None:
    """10 mV in all, less than the noise of a reading: it moves the offset by tens of its standard deviations."""
    found = spoilt(lambda volts, _: volts + np.linspace(0.0, 0.01, len(volts))[:, None])
    assert found.hold_out is not None
    assert found.hold_out.p_value < 1e-10
    assert found.hold_out.worst_s[0] == 0.0 or found.hold_out.worst_s[1] > 0.99 * 6000 / 4.0
    assert "readings that were held out" in found.verdict


def test_noise_with_a_memory_is_named() -> None:
    def add(volts: Array, rng: np.random.Generator) -> Array:
        return np.asarray(volts + lfilter([0.012], [1.0, -0.9], rng.normal(size=volts.shape), axis=0))

    found = spoilt(add)
    assert found.whiteness.inflation > 1.5
    assert "successive residuals are correlated" in found.verdict
    assert "times the noise floor" in found.verdict


def test_parameters_that_cannot_be_told_are_no_good() -> None:
    """However small the residuals are."""
    run = known(500, np.random.default_rng(1))
    own = calibrated(run)["accelerometer"]
    untold = replace(own, identifiable={**own.identifiable, "offset2": "the poses leave it open"})
    found = good(run, Calibration({"accelerometer": untold}))
    assert found.verdict.startswith("not good: because offset2 cannot be told")


def test_metadata_that_are_no_counts_are_ignored() -> None:
    run = known(50, np.random.default_rng(21))
    calibration = calibrated(run)["accelerometer"]
    plain = residuals_of(run, "accelerometer", calibration)
    odd = replace(run, metadata=Metadata(extra={"pose_samples": [1, 2, 3]}))
    assert residuals_of(odd, "accelerometer", calibration).sigma == pytest.approx(plain.sigma)


def judged(gain: Array, count: int, rng: np.random.Generator, parameters: int = 6) -> Goodness:
    readings = unit_vectors(rng, count) @ gain + example.OFFSET + rng.normal(0.0, example.NOISE, (count, 3))
    run = Recording(t=np.arange(float(count)), magnetometer=readings, units={"magnetometer": "V"}, metadata=Metadata())
    options = Options(parameters=parameters, robust=False)  # type: ignore[arg-type]
    return is_it_good(run, estimators.calibrate(run, method="ellipsoid", attitude_free=options))["magnetometer"]


def skewed(size: float) -> Array:
    return example.gain_of(6) + size * np.array([[0.0, 1.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 1.0, 0.0]])


@pytest.mark.parametrize("count", [24, 2000])
def test_cross_terms_that_six_parameters_leave_are_named(count: int) -> None:
    # They leave 0.2 |sum of three products of directions|, about 0.13 V RMS, ten times the noise
    found = judged(skewed(0.2), count, np.random.default_rng(1))
    assert found.cross_terms is not None
    assert found.cross_terms.ratio > 5.0
    assert not found.good
    assert f"six parameters leave {found.cross_terms.ratio:.3g} times what nine do" in found.verdict
    assert found.to_json()["cross_terms"]["ratio"] == found.cross_terms.ratio
    assert judged(skewed(0.2), count, np.random.default_rng(1), parameters=9).cross_terms is None


def test_without_cross_terms_the_p_value_is_uniform() -> None:
    # 200 p-values: their mean has a standard deviation of 1/sqrt(12 x 200) = 0.020; five of it, and one below 1e-4
    # happens in 2 % of the seeds, two in 2e-4
    rng = np.random.default_rng(2)
    found = [judged(example.gain_of(6), 60, rng).cross_terms for _ in range(200)]
    values = np.array([each.p_value for each in found if each is not None])
    assert len(values) == 200
    assert values.mean() == pytest.approx(0.5, abs=0.1)
    assert (values < 1e-4).sum() < 2


def test_too_few_readings_say_nothing() -> None:
    assert judged(example.gain_of(6), 9, np.random.default_rng(3)).cross_terms is None
