"""Interleaved subsets: noise scatters, what the model misses does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import scenarios
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import COLUMNS_OF
from rig.effects import Effect, make_effect
from rig.errors import RigError
from rig.recording import Recording, scan_recording
from scenarios.studies.store import StudyFolder
from scenarios.studies.subset_results import SubsetStudy, read_subsets, write_subsets
from scenarios.studies.subsets import study

NOISE = np.asarray(scenarios.load("ann-arbor").rig.acquisition.noise_V)


def given(sensor: str, _unit: str) -> Array:
    return NOISE[COLUMNS_OF[sensor]]


def swept(effects: tuple[Effect, ...] = (), decimation: int = 1, seed: int = 3) -> Recording:
    return scenarios.load("ann-arbor").with_effects(effects).with_acquisition(decimation=decimation).simulate(seed)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return swept()


@pytest.fixture(scope="module")
def plain(recording: Recording) -> SubsetStudy:
    return study(recording, noise=given, noise_source="given")


@pytest.fixture(scope="module")
def backlash() -> SubsetStudy:
    """A model that lacks something: 1.1 deg of play in joint 5."""
    effect = make_effect("backlash", {"where": "joint5", "width_rad": 0.02})
    return study(swept((effect,)), noise=given, noise_source="given")


def test_subsets_are_every_25th_sample(recording: Recording, plain: SubsetStudy) -> None:
    """The estimates of one subset are those of a plain fit to every 25th sample from its number on."""
    part = recording.select(slice(7, None, 25))
    rotations = Arm.a465().rotation_map.rotations(part.q)
    statistics = Statistics.from_rotations(rotations, part.accelerometer)
    fit = fit_sensor(statistics, recording.metadata.gravity_m_s2, noise=given("accelerometer", "V"))
    row = next(k for k, one in enumerate(plain.parameters) if one.parameter == "sensitivity2")
    assert plain.estimates[row, 7] == pytest.approx(fit.parameters.sensitivity[1], rel=1e-9)
    assert len(plain.parameters) == 28
    units = [each.unit for each in plain.parameters if each.parameter == "sensitivity1"]
    assert units == ["V/(m/s²)", "V/G"]
    assert plain.estimates.shape == (28, 25)
    assert plain.samples == 166_400


def test_an_elevation_at_the_pole_scatters_less_and_says_so(plain: SubsetStudy) -> None:
    """Gravity along joint 1: Rayleigh's 0.66 of the bound, not an excess of precision; elsewhere nothing is said."""
    found = study(scenarios.load("renk2005-accelerometer").simulate(3))
    told = {row.parameter: row.why for row in found.parameters if row.why}
    assert set(told) == {"phi_deg", "psi_deg"}
    assert "from the pole, where elevations fold over" in told["phi_deg"]
    assert not any(row.why for row in plain.parameters)


def test_with_noise_alone_the_scatter_is_the_bound(plain: SubsetStudy) -> None:
    """Each ratio lies within chi-square at 1e-5 (28 of them: fails once in 3,500 runs)."""
    low, high = np.sqrt(chi2.isf([1.0 - 5e-6, 5e-6], 24) / 24)
    for row in plain.parameters:
        assert low < row.ratio < high, row
        assert row.ratio_low < row.ratio < row.ratio_high
        assert row.std == pytest.approx(row.ratio * row.bound)
        # 25 subsets together are the whole: their mean is its estimate, to a fraction of a standard error.
        assert abs(row.mean - row.whole) < 0.1 * row.std
    assert plain.noise_source == "given"


def test_with_noise_alone_the_fit_error_is_noise_like(plain: SubsetStudy) -> None:
    """144 degrees of freedom: a standard deviation of 6 %, five of which are allowed."""
    for row, sigma in zip(plain.channels, NOISE, strict=True):
        assert row.noise_like == pytest.approx(sigma, rel=0.3)
        assert row.fit_error == pytest.approx(sigma, rel=0.02)
        assert row.floor == sigma
        assert row.noise_low < row.noise_like < row.noise_high
        assert row.share_low <= row.share <= row.share_high <= 1.0
        assert row.systematic_low <= row.systematic <= row.systematic_high
        assert row.p_value > 1e-5
    for agreement in plain.agreements:
        assert agreement.p_value > 1e-5
        assert agreement.disagreeing <= 4  # of 25 at 1 %: five or more once in 20,000
        assert agreement.apart_deg < 6.0 * agreement.uncertainty_deg


def test_what_the_model_lacks_is_systematic(plain: SubsetStudy, backlash: SubsetStudy) -> None:
    """It is in the fit error and in the fields, not in the scatter."""
    for row, without in zip(backlash.channels[3:], plain.channels[3:], strict=True):
        assert row.fit_error > 1.1 * without.fit_error
        assert row.noise_like == pytest.approx(without.noise_like, rel=0.05), "the same noise, drawn from the same seed"
        assert row.share_high < 1.0
        assert row.systematic_low > 0.0
        assert row.systematic == pytest.approx(np.sqrt(row.fit_error**2 - row.noise_like**2))
    magnetometer = backlash.agreements[1]
    assert magnetometer.p_value < 1e-10
    assert magnetometer.disagreeing >= 5  # a subset alone sees a 25th of it
    assert magnetometer.apart_deg > 10.0 * magnetometer.uncertainty_deg


def test_without_a_floor_the_split_is_the_same(recording: Recording, plain: SubsetStudy) -> None:
    found = study(recording)
    assert found.noise_source == "residuals"
    for row, known in zip(found.channels, plain.channels, strict=True):
        assert row.noise_like == pytest.approx(known.noise_like, rel=1e-3)
        assert np.isnan(row.floor)
        assert np.isnan(row.p_value)


def test_gravity_along_joint_1_is_said_not_to_tell_psi() -> None:
    scenario = scenarios.load("renk2005-accelerometer")
    found = study(scenario.simulate(0), 5)
    psi = found.parameters[-1]
    assert psi.parameter == "psi_deg"
    assert np.isnan(psi.ratio)
    assert "base z axis" in psi.why
    assert psi.std > 20.0
    assert not found.parameters[0].why


@pytest.mark.parametrize("rows", [997, 4096, 200_000])
def test_a_file_is_read_in_batches_of_any_length(rows: int, tmp_path: Path) -> None:
    recording = swept(decimation=10)
    recording.write(tmp_path / "run.parquet")
    done: list[int] = []
    found = study(scan_recording(tmp_path / "run.parquet", rows), 7, noise=given, progress=done.append)
    at_once = study(recording, 7, noise=given)
    assert sum(done) == len(recording)
    np.testing.assert_allclose(found.estimates, at_once.estimates, rtol=1e-9)


def test_files_round_trip(plain: SubsetStudy, tmp_path: Path) -> None:
    folder = write_subsets(plain, tmp_path / "study")
    back = read_subsets(StudyFolder.read(folder.path))
    assert back.parameters == plain.parameters
    assert back.channels == plain.channels
    assert back.agreements == plain.agreements
    assert np.array_equal(back.estimates, plain.estimates)
    assert write_subsets(plain, tmp_path / "study").path == folder.path
    (folder.path / "channels.parquet").unlink()
    with pytest.raises(RigError, match=r"channels\.parquet: is missing, expected a finished study"):
        read_subsets(StudyFolder.read(folder.path))


@pytest.mark.parametrize(
    ("samples", "subsets", "message"),
    [
        (600, 1, "subsets: found 1, expected 2 or more"),
        (500, 25, "found 500 samples for 25 subsets, expected at least 24 each"),
        (20, 25, "found 20 samples, expected at least 24 for each of 25 subsets"),
    ],
)
def test_too_few_are_refused(samples: int, subsets: int, message: str) -> None:
    part = swept(decimation=100).select(slice(0, samples))
    with pytest.raises(RigError, match=message):
        study(part, subsets)


def test_without_an_attitude_there_is_no_known_angle_fit(recording: Recording) -> None:
    blind: Callable[[], Recording] = lambda: replace(recording.select(slice(0, 6000)), q=None)  # noqa: E731
    with pytest.raises(RigError, match="has no pose"):
        study(blind())
