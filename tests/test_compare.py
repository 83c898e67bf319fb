"""``rig compare``: calibrations, the truth, a recording and its simulation, in standard deviations."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig
from diagnosed_recordings import backlash, recorded, scenario
from scipy.special import chdtri

from estimators import calibrate, noise_floor
from rig.effects import make_effect
from scenarios.comparison import apart, compare, compare_two


def test_two_calibrations_of_one_rig_differ_as_their_covariances_say() -> None:
    total, freedom = 0.0, 0
    for seed in range(10):
        pair = []
        for each in (2 * seed, 2 * seed + 1):
            run, locked = recorded(seed=each)
            pair.append(calibrate(run, noise=noise_floor(locked)))
        rows = compare_two(*pair)
        assert [row.parameter for row in rows if row.sensor == "magnetometer"] == list(
            pair[0]["magnetometer"].parameters
        )
        for found in apart(rows, *pair).values():
            total, freedom = total + found.chi_square, freedom + found.degrees_of_freedom
        one = apart(compare(scenario().truth, pair[0]), pair[0])
        assert all(each.degrees_of_freedom >= 12 for each in one.values())
    # floors of 1,400 samples each; false failures once in 10,000
    wide = (1.0 + 3.0 / np.sqrt(2.0 * 1400.0)) ** 2
    assert chdtri(freedom, 1.0 - 5e-5) / wide < total < wide * chdtri(freedom, 5e-5)


def test_the_other_side_of_the_ambiguity_is_the_same_calibration() -> None:
    run, locked = recorded()
    floor = noise_floor(locked)
    rows = compare_two(calibrate(run, noise=floor), calibrate(run, noise=floor, field_points="up"))
    assert max(abs(row.error_sigmas) for row in rows if row.error_sigmas is not None) < 1e-6


def test_a_recording_is_held_against_the_rig_that_made_it(rig: Rig, here: Path) -> None:
    run, _ = recorded(backlash())
    replace(run, t=run.t + 100.0).write("run.parquet")  # its clock does not matter
    Path("fitted.toml").write_text(scenario().with_effects([backlash()]).to_toml())
    found = json.loads(rig.done("compare", "run.parquet", "fitted.toml", "--json", "-o", "apart.png"))
    assert found["alike"]
    assert Path("apart.png").stat().st_size > 10_000
    for row in found["channels"]:
        # RMS of 600 samples, five sigma of 1/sqrt(1200)
        assert abs(row["rms_sigmas"] - 1.0) < 5.0 / np.sqrt(1200.0)
    result = rig("compare", "small.toml", "run.parquet")
    assert result.status == 1
    assert "they differ by more than the noise that the scenario states" in result.out


def test_noise_of_the_scenario_counts(rig: Rig, here: Path) -> None:
    noisy = scenario().with_effects([make_effect("noise_excess", {"where": "mag1", "extra_sigma": 0.05})])
    noisy.simulate(0).write("run.parquet")
    Path("noisy.toml").write_text(noisy.to_toml())
    assert json.loads(rig.done("compare", "run.parquet", "noisy.toml", "--json"))["alike"]
    assert rig("compare", "run.parquet", "small.toml").status == 1


def test_a_calibration_that_the_gap_has_spoilt_is_not_the_truth(rig: Rig, here: Path) -> None:
    for effects, name in (((), "good"), ((backlash(),), "bad")):
        run, locked = recorded(*effects)
        calibrate(run, noise=noise_floor(locked)).write(f"{name}.json")
    assert json.loads(rig.done("compare", "good.json", "small.toml", "--json"))["alike"]
    result = rig("compare", "bad.json", "small.toml", "-o", "bad.png")
    assert result.status == 1
    assert "they differ" in result.out
    assert Path("bad.png").exists()
    assert rig("compare", "good.json", "bad.json").status == 1


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ("run.parquet", "run.parquet", "found a recording and a recording, expected two calibrations"),
        ("small.toml", "small.toml", "found a scenario and a scenario"),
        ("cal.json", "run.parquet", "found a calibration and a recording"),
        ("cal.json", "other.json", "accelerometer.unit: found V and mV, expected the same"),
        ("run.parquet", "renk2005-accelerometer", "has no magnetometer, expected the sensors of run.parquet"),
        ("run.parquet", "camps2009-accelerometer", "found no arm, expected 6 joints, as run.parquet has"),
        ("missing.json", "small.toml", "missing.json: no such file"),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_line(rig: Rig, here: Path, first: str, second: str, words: str) -> None:
    run, _ = recorded()
    run.write("run.parquet")
    found = calibrate(run)
    found.write("cal.json")
    other = replace(found, sensors={name: replace(each, unit="mV") for name, each in found.sensors.items()})
    other.write("other.json")
    result = rig("compare", first, second)
    assert result.status == 2
    assert words in result.err
    assert result.err.count("\n") == 1
