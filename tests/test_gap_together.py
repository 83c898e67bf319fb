"""Several recordings as one, and diagnosed together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from scipy.spatial.transform import Rotation

import estimators
from estimators.gap.data.basefit import floor_of, learn_floor, set_up
from estimators.gap.data.laid_out import laid_out
from estimators.gap.data.projection import project
from estimators.gap.data.rebase import rebased
from estimators.gap.data.stack import Stack, only_in, part_of, running_on
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arm import Arm
from rig.effects import EFFECTS, Effect, make_effect
from rig.errors import RefusedFit, RigError
from rig.recording import Recording
from scenarios.loader import from_toml

#: A catalogue of three, which takes little time to search.
FEW = [name for name in EFFECTS if name not in ("bias_step", "backlash", "joint_scale")]
#: The same with noise and a tone.
FEW_NOISES = [name for name in EFFECTS if name not in ("mains_hum", "noise_excess", "joint_scale")]
#: As of the scenario: a floor that is known.
NOISE = (0.0134, 0.0136, 0.0146, 0.0085, 0.0068, 0.0117)
FLOOR = tuple(ChannelNoise(sigma**2, samples=100_000) for sigma in NOISE)


def recorded(*effects: Effect, seed: int = 0, name: str = "a") -> Recording:
    return replace(from_toml(SMALL, "small.toml").with_effects(effects).simulate(seed), name=name)


def at_rest(seed: int = 0) -> Recording:
    return from_toml(SMALL, "small.toml").simulate_locked(seed)


def of_known_floor(data: WhitenedData) -> WhitenedData:
    """With the readings at the ends, which no effect with a memory spoils here."""
    return replace(data, noises=FLOOR, floor=FLOOR, kept=None, weights=np.ones_like(data.weights))


def stacked(*parts: Recording) -> Stack:
    """Around the calibration of all of them, whose floor is known."""
    whole = estimators.calibrate(list(parts), noise=floor_of(parts[0], FLOOR))
    laid = laid_out(list(parts), None, None, whole)
    found = laid.together([of_known_floor(each) for each in laid.data])
    assert isinstance(found, Stack)
    return Stack.of(found.each[:-1], found.names, found.pipeline, found.began)


def test_two_halves_are_the_same_problem_as_the_whole() -> None:
    """What the calibration leaves of an effect without memory does not know where the recording was cut."""
    run = recorded(make_effect("joint_eccentricity", {"where": "joint5", "amplitude_rad": 0.01}))
    whole = of_known_floor(set_up(run, FLOOR, Arm.a465()))
    halves = [replace(run.select(rows), name=name) for rows, name in ((slice(0, 300), "a"), (slice(300, None), "b"))]
    both = stacked(*halves)
    effect = make_effect("joint_eccentricity", {"where": "joint5", "amplitude_rad": 1e-3})
    sizes = []
    for data in (whole, both):
        change = project(data.absorbed, data.whiten(data.change([effect])))
        sizes.append([data.whitened @ data.whitened, change @ change, change @ data.whitened])
    assert np.allclose(sizes[0], sizes[1], rtol=1e-4)
    assert both.size == whole.size
    assert np.array_equal(np.sort(np.concatenate([both.rows(0), both.rows(1)])), np.arange(both.size))


def test_what_belongs_to_a_recording_acts_in_it_alone() -> None:
    both = stacked(recorded(seed=1), recorded(seed=2, name="b"))
    warm = only_in(EFFECTS["bias_warmup"], 1)
    assert part_of(warm) == 1
    assert part_of(EFFECTS["bias_warmup"]) is None
    change = both.change([warm(where="accelerometer", coefficient=(1e-3, 0.0, 0.0))])  # type: ignore[call-arg]
    assert not change[:600].any()
    assert change[600, 0] == pytest.approx(1e-3)  # it begins with its recording


def test_clocks_run_on() -> None:
    laid = laid_out([recorded(seed=1), recorded(seed=2, name="b")], None, None, None)
    first, second = (each.base for each in laid.data)
    assert second.t[0] > first.t[-1]
    assert laid.began[1] == pytest.approx(second.t[0])
    again = running_on([first, second])
    assert np.array_equal(again[1].t, second.t)  # which run on already


def test_a_calibration_from_before_counts_as_its_recording_would() -> None:
    """A calibration is all that a recording says of it, to first order: the joint one follows to a tenth of a sigma."""
    runs = [recorded(seed=1), recorded(seed=2, name="b")]
    noise = floor_of(runs[0], FLOOR)
    first, joint = estimators.calibrate(runs[0], noise=noise), estimators.calibrate(runs, noise=noise)
    laid = laid_out([runs[1]], at_rest(2), None, first)
    data = laid.together([of_known_floor(each) for each in laid.data])
    for _ in range(3):
        data = rebased(data, [])
    for name, sensor in data.pipeline.sensors.items():
        own = joint[name]
        std = np.array([[own.std(f"sensitivity{k}"), own.std(f"offset{k}")] for k in (1, 2, 3)])
        found = np.stack([sensor.sensitivity, sensor.offset], axis=1)
        assert (np.abs(found - np.stack([own.sensitivity, own.offset], axis=1)) < 0.1 * std).all()


@pytest.mark.parametrize("unknown", [0.0, np.nan])
def test_a_calibration_without_variances_says_nothing(unknown: float) -> None:
    run = recorded(seed=1)
    found = estimators.calibrate(run, noise=floor_of(run, FLOOR))
    sensor = found["accelerometer"]
    covariance = np.array(sensor.vector_covariance)
    covariance[0] = covariance[:, 0] = unknown
    spoilt = replace(found, sensors={**found.sensors, "accelerometer": replace(sensor, vector_covariance=covariance)})
    with pytest.raises(RigError, match="accelerometer: found parameters without a variance"):
        estimators.diagnose(run, locked=at_rest(2), calibration=spoilt)


def test_an_arm_that_never_rests_has_no_floor() -> None:
    with pytest.raises(RigError, match="the arm is never at rest, expected a locked recording"):
        learn_floor(recorded(seed=1), 0.1)


def turn(seed: int = 5) -> Recording:
    """Joint 1 alone: about one axis, which gravity does not show and no calibration comes from."""
    text = SMALL.replace("[maneuver]", "[maneuver]\npitch_range_deg = 0.01\nroll_deg_per_s = 0.001")
    return replace(from_toml(text, "turn.toml").simulate(seed), name="turn")


def test_a_recording_that_cannot_be_calibrated_is_judged_beside_another() -> None:
    alone = turn()
    with pytest.raises(RefusedFit):
        estimators.diagnose(alone, at_rest(5), without=FEW)
    before = estimators.calibrate(recorded(seed=1), noise=floor_of(alone, FLOOR))
    found = estimators.diagnose(alone, at_rest(5), without=FEW, calibration=before)
    assert found.verdict == "no-gap"
    spoilt = replace(alone, accelerometer=alone.readings("accelerometer") + 0.02 * (alone.t > 30.0)[:, None])
    assert estimators.diagnose(spoilt, at_rest(5), without=FEW, calibration=before).posterior["nothing"] < 1e-6


def test_a_jump_is_found_in_its_recording() -> None:
    """40 mV in the second of two: forty standard deviations."""
    step = make_effect("bias_step", {"where": "accel2", "volts": 0.04, "at_s": 20.0})
    runs = [recorded(seed=1), recorded(step, seed=2, name="b")]
    found = estimators.diagnose(runs, at_rest(1), without=FEW)
    assert found.verdict == "named"
    (cause,) = found.leading
    assert (cause.effect, cause.where, cause.recording) == ("bias_step", "accel2", "b")
    assert cause.parameters["at_s"].value == pytest.approx(20.0, abs=0.5)
    assert cause.evidence["b"] > 50.0


def test_noise_of_one_recording_is_told_by_that_one() -> None:
    noisy = recorded(make_effect("noise_excess", {"where": "accel2", "extra_sigma": 0.02}), seed=2, name="b")
    found = estimators.diagnose([recorded(seed=1), noisy], at_rest(1), without=FEW_NOISES)
    assert found.verdict == "named"
    (cause,) = found.leading
    assert (cause.effect, cause.where) == ("noise_excess", "accel2")
    assert set(cause.evidence) == {"b"}
    assert cause.evidence["b"] > 50.0
    sigma = cause.parameters["extra_sigma"]
    assert sigma.value == pytest.approx(0.02, abs=5.0 * sigma.std)


def test_a_tone_of_one_recording_has_its_phase_on_the_clock_of_that() -> None:
    """Two channels, of signal-to-noise above 20; 5 sigma of the phases: false once in a million."""
    amplitude, phase = (0.0, 0.02, 0.0, 0.015, 0.0, 0.0), (0.0, 1.0, 0.0, 2.0, 0.0, 0.0)
    hum = make_effect(
        "mains_hum", {"where": "acquisition", "freq_Hz": 50.13, "amplitude": amplitude, "phase_rad": phase}
    )
    found = estimators.diagnose([recorded(seed=1), recorded(hum, seed=2, name="b")], at_rest(1), without=FEW_NOISES)
    assert found.verdict == "named"
    (cause,) = found.leading
    assert (cause.effect, cause.recording) == ("mains_hum", "b")
    told = cause.parameters["phase_rad"]
    for channel in (1, 3):
        assert told.value[channel] == pytest.approx(phase[channel], abs=5.0 * told.std[channel])


def test_from_the_command_line(tmp_path: Path, rig: Rig) -> None:
    lash = make_effect("backlash", {"where": "joint5", "width_rad": 0.05})
    for seed, name in ((1, "a"), (2, "b")):
        recorded(lash, seed=seed).write(tmp_path / f"{name}.parquet")
        at_rest(seed).write(tmp_path / f"{name}.locked.parquet")
    runs = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    few = [part for name in FEW for part in ("--without", name)]
    text = rig.done("diagnose", *runs, "--together", "--out", tmp_path / "o", *few)
    assert "for backlash of joint 5" in text
    found = json.loads((tmp_path / "o" / "together.diagnosis.json").read_text())
    assert found["recordings"] == ["a", "b"]
    assert set(found["where"]["channels"]) == {"a", "b"}
    assert set(found["where"]["channels"]["a"]) == {"accel1", "accel2", "accel3", "mag1", "mag2", "mag3"}
    (cause,) = found["causes"]
    assert cause["effect"] == "backlash"
    assert min(cause["evidence"].values()) > 10.0
    page = (tmp_path / "o" / "together.html").read_text()
    assert "Where it lies in b" in page
    assert "expected several" in rig.refused("diagnose", runs[0], "--together")
    assert "--maneuver2" in rig.refused("diagnose", *runs, "--together", "--maneuver2", runs[0])
    other = replace(recorded(seed=3), metadata=replace(recorded(seed=3).metadata, gravity_m_s2=9.7))
    other.write(tmp_path / "c.parquet")
    assert "gravity_m_s2" in rig.refused("diagnose", runs[0], tmp_path / "c.parquet", "--together")


def test_tool_poses_beside_joint_angles_are_tool_poses() -> None:
    """What not all recordings have is left out: with joint angles in one alone, all are known by their tool's poses."""
    runs = [recorded(seed=1), recorded(seed=2, name="b")]
    turns = Rotation.from_matrix(runs[1].rotations(Arm.a465()).reshape(-1, 3, 3)).as_quat(scalar_first=True)
    laid = laid_out([runs[0], replace(runs[1], q=None, tool_quaternion=turns)], at_rest(1), None, None)
    both = laid.together(laid.data)
    assert both.base.q_encoder is None
    assert both.base.R_base_tool.shape == (1200, 3, 3)
    assert both.whitened @ both.whitened < both.size + 6.0 * np.sqrt(2.0 * both.size)  # 6 standard deviations: 1e-9


def test_one_rest_for_all_or_one_each() -> None:
    runs = [recorded(seed=1), recorded(seed=2, name="b")]
    with pytest.raises(RigError, match="found 1 recordings at rest"):
        laid_out(runs, [at_rest(1)], None, None)
    sources = laid_out(runs, [at_rest(1), None], None, None).sources
    assert sources == ("locked recording", "estimated from the recording itself")
