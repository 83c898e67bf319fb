"""The improved rig that a diagnosis leaves: its maneuver, calibration and effects, as a scenario that runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed_recordings import backlash, by_hand, cause, recorded, scenario

from estimators.gap.report.fitted_rig import FittedRig
from rig.arm import Arm
from rig.assets import model_path
from rig.effects import make_effect
from rig.maneuver import HandTumble, StaticPoses, TorusSweep
from rig.pose_nodes import quaternions
from rig.recording import Recording
from scenarios.diagnosing.improved_rig import improved_rig
from scenarios.gap_report import gap_residuals
from scenarios.loader import from_toml
from scenarios.plan.closest_maneuver import closest_maneuver

SWEEPS = {
    "the paper's": TorusSweep(),
    "short": TorusSweep(duration_s=60.0, yaw_passes=15, pitch_passes=7, roll_deg_per_s=-21.5, roll_start_deg=30.0),
    "off centre": TorusSweep(
        duration_s=600.0,
        yaw_range_deg=120.0,
        yaw_centre_deg=20.0,
        yaw_passes=5,
        pitch_range_deg=90.0,
        pitch_centre_deg=-15.0,
        pitch_passes=4,
        locked_deg=(80.0, -70.0, 10.0),
    ),
    "roll to and fro": TorusSweep(duration_s=600.0, roll="sweep", roll_range_deg=300.0, roll_deg_per_s=20.0),
    "other joints": TorusSweep(duration_s=300.0, joints=(2, 4, 6), locked_deg=(10.0, -90.0, 5.0), limits_deg=None),
}


@pytest.mark.parametrize("name", SWEEPS)
def test_a_torus_sweep_is_recognised(name: str) -> None:
    made = SWEEPS[name]
    rate = 4.0 if made.duration_s > 100.0 else 10.0
    t = np.arange(int(made.duration_s * rate)) / rate
    arm = replace(Arm.a465(), name="mine") if made.limits_deg is None else Arm.a465()
    found = closest_maneuver(t, made.trajectory(t).q, 100.0, arm).maneuver
    assert isinstance(found, TorusSweep)
    assert (found.yaw_passes, found.pitch_passes, found.roll) == (made.yaw_passes, made.pitch_passes, made.roll)
    assert found.joints == made.joints
    assert found.locked_deg == pytest.approx(made.locked_deg, abs=1e-3)
    assert found.duration_s == pytest.approx(made.duration_s, rel=1e-6)
    # The extremes lie between samples: up to half an interval of travel is missed at either end of a range.
    ranges = {"yaw": (made.yaw_range_deg, made.yaw_passes), "pitch": (made.pitch_range_deg, made.pitch_passes)}
    for joint, (extent, passes) in ranges.items():
        step = extent * passes / made.duration_s / rate
        assert abs(getattr(found, f"{joint}_range_deg") - extent) < step + 2e-3
        assert abs(getattr(found, f"{joint}_centre_deg") - getattr(made, f"{joint}_centre_deg")) < step + 2e-3
    if made.roll == "continuous":
        assert found.roll_deg_per_s == pytest.approx(made.roll_deg_per_s, abs=2e-3)
        assert found.roll_start_deg == pytest.approx(made.roll_start_deg, abs=2e-3)
    else:
        assert found.roll_passes == made.roll_passes


def test_noisy_encoders_add_no_passes() -> None:
    made = TorusSweep()
    t = np.arange(0.0, 1664.0, 0.01)
    q = made.trajectory(t).q
    q += 1e-4 * np.random.default_rng(0).standard_normal(q.shape)
    found = closest_maneuver(t, q, 100.0, Arm.a465()).maneuver
    assert isinstance(found, TorusSweep)
    assert (found.yaw_passes, found.pitch_passes) == (15, 7)
    found.trajectory(t[:10])  # and the joints stay within their limits


def test_another_motion_becomes_stops_on_its_way_and_says_so() -> None:
    made = StaticPoses(count=12, seed=3)
    t = np.arange(int(made.duration_s * 10)) / 10.0
    q = made.trajectory(t).q
    q[:, 5] += 20.0 * np.pi  # ten turns on: the same pose
    found = closest_maneuver(t, q, 100.0, Arm.a465())
    assert isinstance(found.maneuver, StaticPoses)
    assert "no torus sweep" in found.difference
    assert found.maneuver.duration_s == pytest.approx(made.duration_s, rel=0.02)
    there = np.degrees(found.maneuver.angles)
    for pose in there[:, None]:
        off = np.abs((np.degrees(q) - pose + 180.0) % 360.0 - 180.0).max(axis=1)
        assert off.min() < 1e-3  # a pose of the recording, to the rounding


def test_without_joints_a_tumble_stands_in() -> None:
    found = closest_maneuver(np.arange(100) / 10.0, None, 100.0, None)
    assert isinstance(found.maneuver, HandTumble)
    assert found.maneuver.duration_s == pytest.approx(10.0)
    assert "tool poses" in found.difference


def improved(run: Recording, locked: Recording | None, *causes: object) -> str:
    diagnosis = by_hand(causes=causes)  # type: ignore[arg-type]
    return improved_rig(diagnosis, gap_residuals(run, diagnosis, locked), locked).to_toml()


def test_the_improved_rig_has_the_recordings_calibration_floor_and_causes() -> None:
    run, locked = recorded(backlash())
    made = from_toml(improved(run, locked, *by_hand().causes), "better.toml")
    assert made.rig.effects == (backlash(),)
    truth = scenario()
    # From the Cramer-Rao bound of 600 samples (0.06 % of S, 0.5 mV of offset at worst); six of it
    for sensor in ("accelerometer", "magnetometer"):
        found, wanted = getattr(made.rig, sensor), getattr(truth.rig, sensor)
        np.testing.assert_allclose(np.asarray(found.sensitivity) / np.asarray(wanted.sensitivity), 1.0, atol=0.02)
        np.testing.assert_allclose(found.offset, wanted.offset, atol=0.02)
        cosine = np.abs(np.sum(found.axes * wanted.axes, axis=1))
        np.testing.assert_allclose(np.degrees(np.arccos(np.minimum(cosine, 1.0))), 0.0, atol=1.0)
    # Two poses of 2 s at 1 kHz, learned at 100 Hz: 5 sigma of 1/sqrt(2 x 1400)
    np.testing.assert_allclose(made.rig.acquisition.noise_V, truth.rig.acquisition.noise_V, rtol=0.1)
    assert made.rig.acquisition.step_V == pytest.approx(truth.rig.acquisition.step_V, rel=1e-4)
    assert made.rig.acquisition.range_V == (0.0, 5.0)
    again = made.simulate(seed=5)
    assert len(again) == len(run)
    assert again.rate_Hz == pytest.approx(run.rate_Hz)
    assert again.temperature == pytest.approx(run.temperature, abs=0.01)  # type: ignore[arg-type]


def test_instants_and_phases_move_to_a_clock_that_starts_with_the_recording() -> None:
    slip = {"where": "mag1", "volts": 0.05, "at_s": 131.0}
    hum = {"where": "acquisition", "freq_Hz": 49.3, "amplitude": (0.02,) * 6, "phase_rad": (0.4,) * 6}
    run, locked = recorded()
    late = replace(run, t=run.t + 100.0)
    causes = (
        cause("bias_step", "mag1", volts=(0.05, 1e-3, "V"), at_s=(131.0, None, "s")),
        cause(
            "mains_hum",
            "acquisition",
            freq_Hz=(49.3, 1e-3, "Hz"),
            amplitude=((0.02,) * 6, (1e-3,) * 6, "V"),
            phase_rad=((0.4,) * 6, (0.1,) * 6, "rad"),
        ),
    )
    step, tone = from_toml(improved(late, locked, *causes), "late.toml").rig.effects
    assert step == make_effect("bias_step", {**slip, "at_s": 31.0})
    turn = (0.4 + 2.0 * np.pi * 49.3 * 100.0) % (2.0 * np.pi)
    np.testing.assert_allclose(tone.phase_rad, turn, atol=1e-9)  # type: ignore[attr-defined]
    assert tone.amplitude == hum["amplitude"]  # type: ignore[attr-defined]


def test_comments_say_what_the_scenario_is_not() -> None:
    run, locked = recorded(backlash())
    same = {"effect": "latency", "where": "acquisition", "probability": 0.4}
    twin = cause("backlash", "joint5", (same,), width_rad=(0.05, 1e-3, "rad"))
    diagnosis = by_hand("partly", (twin,))
    text = improved_rig(diagnosis, gap_residuals(run, diagnosis, locked), locked).to_toml()
    comments = " ".join(line.removeprefix("# ") for line in text.splitlines() if line.startswith("#"))
    assert "the same as backlash of joint 5: latency of acquisition" in comments
    assert "has no name" in comments
    assert "phases may differ" in comments
    ambiguous = by_hand("ambiguous", rivals=((("joint_scale", "joint5"),),))
    text = improved_rig(ambiguous, gap_residuals(run, ambiguous, locked), locked).to_toml()
    comments = " ".join(line.removeprefix("# ") for line in text.splitlines() if line.startswith("#"))
    assert "Others that the recording allows: joint scale of joint 5 (.38)." in comments


def test_what_the_recording_did_not_feel_is_saved_as_it_was_fitted() -> None:
    """Of the three diagonal numbers of a soft iron only the differences are felt: the calibration takes up the rest.

    The saved rig must do again what was found, and say which numbers are its fit's alone.
    """
    chi = (0.021, -0.012, 0.009, 0.006, 0.0, 0.004)
    run, locked = recorded(make_effect("link_soft_iron", {"where": "link3", "chi": chi}))
    values = (None, None, None, *chi[3:])
    stds = (None, None, None, 1e-5, 1e-5, 1e-5)
    why = "this maneuver does not feel it"
    found = cause("link_soft_iron", "link3", chi=(values, stds, "relative", why, chi))  # type: ignore[arg-type]
    diagnosis = by_hand(causes=(found,))
    residuals = gap_residuals(run, diagnosis, locked)
    text = improved_rig(diagnosis, residuals, locked).to_toml()
    made = from_toml(text, "iron.toml")
    (effect,) = made.rig.effects
    assert effect.chi == chi  # type: ignore[attr-defined]
    assert "chi of link soft iron of link 3: numbers 1, 2 and 3 are not felt by the recording" in " ".join(
        line.removeprefix("# ") for line in text.splitlines() if line.startswith("#")
    )
    assert set(made.fitted_std[0]) == {"chi"}
    # With the true effect only noise is left: of n readings a chi-square, and the floor known to 1/sqrt(2 x 1400)
    white = residuals.white_after[:, 3:]  # type: ignore[index]
    allowed = 5.0 * np.sqrt(2.0 / white.size + 2.0 / 1400.0 / 3.0)
    assert abs(np.mean(white**2) - 1.0) < allowed


def test_a_fitted_rigs_effects_on_a_sensor_that_was_not_recorded_are_left_out() -> None:
    run, locked = recorded(backlash())
    alone, still = (
        replace(each, magnetometer=None, units={"accelerometer": each.unit("accelerometer")}) for each in (run, locked)
    )
    effects = (make_effect("hysteresis", {"where": "mag1"}), backlash(), make_effect("base_dipole", {}))
    base = FittedRig("both", effects, std=({}, {"width_rad": 1e-4}, {}))
    diagnosis = by_hand(causes=())
    made = improved_rig(diagnosis, gap_residuals(alone, diagnosis, still), still, base).scenario
    assert made.rig.effects == (backlash(),)
    assert made.fitted_std == ({"width_rad": 1e-4},)


def test_tool_poses_make_a_rig_without_an_arm() -> None:
    run, locked = recorded()
    poses = Arm.a465().poses(run.q)  # type: ignore[arg-type]
    tool = replace(run, q=None, tool_quaternion=quaternions(poses.R_base_tool), tool_position=poses.position)
    made = from_toml(
        improved(tool, locked, cause("bias_step", "mag1", volts=(0.05, 1e-3, "V"), at_s=(31.0, None, "s"))), "t.toml"
    )
    assert made.rig.arm is None
    again = made.simulate()
    assert again.pose == "tool"
    assert len(again) == len(run)


def test_an_arm_of_ones_own_is_named_by_its_file(tmp_path: Path) -> None:
    urdf, tip = model_path("a465/a465.urdf"), "imu"
    run, locked = recorded()
    diagnosis = by_hand(causes=())
    arm = Arm.from_urdf(urdf, tip)
    text = improved_rig(diagnosis, gap_residuals(run, diagnosis, locked, arm), locked).to_toml()
    made = from_toml(text, str(tmp_path / "mine.toml"))
    assert made.rig.arm is not None
    assert (made.rig.arm.file, made.rig.arm.tip) == (urdf, tip)
    assert made.rig.arm.dof == 6


def test_a_sensor_with_a_digital_output_has_a_rig_in_its_own_unit() -> None:
    run, locked = recorded(backlash())
    in_uT = [
        replace(each, magnetometer=1e2 * each.magnetometer, units={"accelerometer": "V", "magnetometer": "uT"})  # type: ignore[operator]
        for each in (run, locked)
    ]
    made = from_toml(improved(*in_uT, *by_hand().causes), "digital.toml")
    assert made.rig.acquisition.units == ("V", "uT")
    text = made.to_toml()
    assert text.count("noise_V = ") == 1  # the accelerometer's
    assert "\nnoise = " in text
    np.testing.assert_array_equal(from_toml(text, "again.toml").rig.acquisition.noise_V, made.rig.acquisition.noise_V)
    again = made.simulate(seed=3)
    assert again.units == {"accelerometer": "V", "magnetometer": "uT"}
    assert again.magnetometer is not None
    assert again.magnetometer.max() > 5.0  # no board clips it
    same = from_toml(improved(run, locked, *by_hand().causes), "volts.toml")
    # The same rig but for the unit: six of the Cramer-Rao bound, as above
    ratio = np.asarray(made.rig.magnetometer.sensitivity) / same.rig.magnetometer.sensitivity  # type: ignore[union-attr]
    np.testing.assert_allclose(ratio, 1e2, rtol=0.02)


def test_a_fitted_rig_knows_the_recording_that_chose_it() -> None:
    run, locked = recorded(backlash())
    made = from_toml(improved(run, locked, *by_hand().causes), "better.toml")
    assert made.fitted_to == (run.fingerprint,)
    assert [set(each) for each in made.fitted_std] == [{"width_rad"}]
    assert recorded(backlash(), seed=1)[0].fingerprint != run.fingerprint
