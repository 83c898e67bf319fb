"""The noise procedure on simulated locked recordings: the paper's figures come back within their own uncertainty."""

from __future__ import annotations

import json

import numpy as np
import pytest
from kinematic_examples import BOTH_NOISES, BOTH_SENSORS, readings, run_of
from scipy.signal import lfilter

import estimators
from estimators.noise import NoiseFloor, held_poses
from rig.acquisition import Acquisition
from rig.arm import Arm
from rig.errors import RigError
from rig.maneuver import LockedPoses
from rig.recording import Recording

DYNAMIC_RANGE_DB = (51.4, 51.3, 50.7, 55.4, 57.3, 52.6)
BITS = (8.54, 8.52, 8.42, 9.20, 9.52, 8.74)


def test_the_papers_figures_come_back() -> None:
    """Three poses of 200 s at 1 kHz with the 14-bit converter, whose steps of 1.2207 mV add their variance over 12.

    Four of its own standard errors for each of six channels: fails by chance for one seed in 2,600. The paper rounds
    its decibels to a tenth and its bits to a hundredth.
    """
    acquisition = Acquisition(noise_V=tuple(BOTH_NOISES.ravel()))
    trajectory = LockedPoses().trajectory()
    rotations = Arm.a465().rotation_map.rotations(trajectory.q)
    volts = np.hstack([readings(rotations, truth) for truth in BOTH_SENSORS.values()])
    volts = acquisition.convert(acquisition.add_noise(volts, np.random.default_rng(0)))
    locked = Recording(t=trajectory.t, q=trajectory.q, accelerometer=volts[:, :3], magnetometer=volts[:, 3:])
    floor = estimators.noise_floor(locked)
    assert floor.pose_rms.shape == (3, 6)
    assert (floor.pose_samples > 199_000).all()
    expected = np.sqrt(BOTH_NOISES.ravel() ** 2 + acquisition.step_V**2 / 12.0)
    assert (np.abs(floor.rms - expected) < 4.0 * floor.rms_std).all()
    white = expected / np.sqrt(2.0 * 600_000)
    assert (floor.rms_std >= 0.99 * white).all()
    assert (floor.rms_std < 2.0 * white).all()
    assert (np.abs(floor.dynamic_range_dB - DYNAMIC_RANGE_DB) < 0.05 + 4.0 * floor.dynamic_range_std_dB).all()
    assert (np.abs(floor.bits - BITS) < 0.015 + 4.0 * floor.bits_std).all()
    content = json.loads(json.dumps(floor.to_json()))
    assert content["channels"]["accel1"]["rms"] == floor.rms[0]


def coloured(rng: np.random.Generator, shape: tuple[int, int], phi: float) -> np.ndarray:
    """AR(1) noise of unit variance."""
    innovations = rng.standard_normal(shape) * np.sqrt(1.0 - phi**2)
    innovations[0] /= np.sqrt(1.0 - phi**2)
    return np.asarray(lfilter([1.0], [1.0, -phi], innovations, axis=0))


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_its_uncertainty_is_right_for_white_and_for_coloured_noise(phi: float) -> None:
    """150 locked recordings of 2 x 4,000 samples, three channels: errors over standard errors have an RMS near one.

    Four standard errors of the RMS are 13 %, and the standard error, as it is never below white noise's, is up to 7 %
    too large; correlated noise leaves it with 19 degrees of freedom a pose, which adds 3 % to the RMS.

    For phi = 0.8 the mean's removal biases each variance by the share 9/4,000 of it, .1 %, against a spread of 2.4 %.
    """
    rng = np.random.default_rng(1)
    q = np.repeat(np.array([[0.0] * 6, [0.5] * 6]), 4000, axis=0)
    scores = []
    for _ in range(150):
        noise = np.vstack([coloured(rng, (4000, 3), phi), coloured(rng, (4000, 3), phi)])
        floor = estimators.noise_floor(Recording(t=np.arange(8000) / 100.0, q=q, accelerometer=2.5 + 0.01 * noise))
        scores.append((floor.rms - 0.01) / floor.rms_std)
    assert 0.80 < np.sqrt(np.mean(np.square(scores))) < 1.15


def held(seconds: tuple[float, ...], rate: float, jitter: float = 0.0, slew: float = 1.0) -> Recording:
    """Poses held one after the other with the way between them recorded, at ``slew`` [rad/s] in joint 5."""
    rng = np.random.default_rng(2)
    pieces, angle = [], 0.0
    for hold in seconds:
        pieces.append(np.full(round(hold * rate), angle))
        pieces.append(np.arange(angle, angle + 0.7, slew / rate))
        angle += 0.7
    joint5 = np.concatenate(pieces[:-1])
    q = np.zeros((len(joint5), 6))
    q[:, 4] = joint5 + jitter * rng.integers(-1, 2, len(joint5))
    return run_of(BOTH_SENSORS, BOTH_NOISES, 3, q, t=np.arange(len(q)) / rate)


@pytest.mark.parametrize(("rate", "jitter", "slew"), [(1000.0, 0.0, 1.0), (1000.0, 1e-4, 0.1), (20.0, 31e-6, 0.02)])
def test_poses_are_found_and_the_way_between_is_left_out(rate: float, jitter: float, slew: float) -> None:
    locked = held((20.0, 10.0, 30.0), rate, jitter, slew)
    labels = held_poses(locked)
    assert labels.max() == 2
    q5 = locked.q[:, 4]
    for pose, (hold, angle) in enumerate(zip((20.0, 10.0, 30.0), (0.0, 0.7, 1.4), strict=True)):
        inside = labels == pose
        assert np.abs(q5[inside] - angle).max() <= 2e-3 + jitter
        assert inside.sum() / rate == pytest.approx(hold, abs=1.0)
    floor = estimators.noise_floor(locked)
    # 60 s: at 20 Hz 1,200 samples, a relative standard error of 2 %; five of it.
    assert np.abs(floor.rms / BOTH_NOISES.ravel() - 1.0).max() < 0.1


def test_tool_poses_and_given_numbers_serve_as_well() -> None:
    locked = held((20.0, 20.0), 100.0)
    half = locked.q[:, 4] / 2.0
    zero = np.zeros_like(half)
    tool = Recording(
        t=locked.t,
        tool_quaternion=np.stack([np.cos(half), zero, np.sin(half), zero], axis=1),
        accelerometer=locked.accelerometer,
    )
    found = estimators.noise_floor(tool)
    assert found.channels == ("accel1", "accel2", "accel3")
    assert len(found.pose_samples) == 2
    labels = held_poses(locked)
    given = estimators.noise_floor(Recording(t=locked.t, accelerometer=locked.accelerometer), poses=labels)
    assert np.array_equal(given.rms, estimators.noise_floor(locked).rms[:3])
    without = estimators.noise_floor(Recording(t=locked.t, accelerometer=locked.accelerometer).select(labels == 0))
    assert len(without.pose_samples) == 1


def test_the_mean_of_the_poses_is_the_papers() -> None:
    """RMS per pose, then their mean, however long each was held."""
    floor = estimators.noise_floor(held((5.0, 20.0), 100.0))
    assert np.allclose(floor.rms, floor.pose_rms.mean(axis=0), rtol=1e-12)


def test_units_go_with_the_numbers() -> None:
    volts = held((10.0,), 100.0)
    other = Recording(
        t=volts.t,
        q=volts.q,
        accelerometer=1e3 * volts.readings("accelerometer"),
        magnetometer=volts.readings("magnetometer"),
        units={"accelerometer": "mV", "magnetometer": "raw"},
    )
    reference, found = estimators.noise_floor(volts), estimators.noise_floor(other)
    assert np.allclose(found.dynamic_range_dB[:3], reference.dynamic_range_dB[:3], rtol=1e-12)
    assert np.isnan(found.dynamic_range_dB[3:]).all()  # raw counts have no 5 V
    in_volts = found.of("accelerometer", "V")
    assert in_volts is not None
    assert np.allclose(in_volts[0], reference.rms[:3], rtol=1e-12)
    with pytest.raises(RigError, match="cannot be converted"):
        found.of("magnetometer", "V")
    assert found.to_json()["channels"]["mag1"]["bits"] is None


def test_a_floor_is_printed_as_a_table() -> None:
    """Each number to the second digit of its standard error; a dash for what a channel does not have."""
    floor = NoiseFloor(
        channels=("accel1", "mag1"),
        units=("V", "uT"),
        rms=np.array([0.0134, 0.25]),
        rms_std=np.array([1.2e-5, 0.0]),
        pose_rms=np.array([[0.0134, 0.25]]),
        pose_samples=np.array([500]),
        dynamic_range_dB=np.array([51.44, np.nan]),
        dynamic_range_std_dB=np.array([0.1, np.nan]),
        bits=np.array([8.544, np.nan]),
        bits_std=np.array([0.01, np.nan]),
    )
    head, titles, *rows = str(floor).splitlines()
    assert head == "Noise at rest, samples in each pose: 500"
    assert titles.split() == ["channel", "RMS", "std", "unit", "dynamic", "range", "[dB]", "bits"]
    assert [row.split() for row in rows] == [
        ["accel1", "0.013400", "0.000012", "V", "51.44", "8.54"],
        ["mag1", "0.25", "-", "uT", "-", "-"],
    ]


def test_a_recording_that_holds_no_pose_is_refused() -> None:
    with pytest.raises(RigError, match=r"no pose is held for 0.5 s and 20 samples, expected a locked-arm recording"):
        estimators.noise_floor(run_of(BOTH_SENSORS, BOTH_NOISES, 4))
    with pytest.raises(RigError, match="no pose is held"):
        estimators.noise_floor(held((10.0,), 1.0))
    with pytest.raises(RigError, match=r"poses: found shape \(3,\)"):
        estimators.noise_floor(held((10.0,), 100.0), poses=[0, 0, 0])


def test_readings_without_noise_have_a_floor_of_zero() -> None:
    locked = held((10.0, 10.0), 100.0)
    still = Recording(t=locked.t, q=locked.q, accelerometer=np.full((len(locked), 3), 2.5))
    floor = estimators.noise_floor(still)
    assert (floor.rms == 0.0).all()
    assert np.isposinf(floor.dynamic_range_dB).all()
    assert floor.to_json()["channels"]["accel1"]["bits"] is None  # type: ignore[index]
