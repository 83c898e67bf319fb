"""Averaging a recording over its poses loses nothing; and the poses of measured recordings are found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter
from stillness_examples import NOISE, at_rest, stops

from estimators.stillness import (
    average_poses,
    find_still,
    still_poses,
)
from rig.arrays import Array
from rig.recording import Metadata, Recording, read_recording

REAL = Path(__file__).parents[1].parent / "shared" / "realdata"


# Averaging


def test_the_noise_within_poses_is_told() -> None:
    poses = still_poses(stops()[1])
    # 7,800 samples: 0.8 % a channel; five of these, and the converter's step adds 0.1 %.
    assert poses.noise["accelerometer"] == pytest.approx(NOISE[:3], rel=0.045)
    assert poses.noise["magnetometer"] == pytest.approx(NOISE[3:], rel=0.045)
    assert poses.degrees_of_freedom == poses.counts.sum() - 20
    # White: the inflation is a chi-square of one degree for each of 20 stretches, mean 1, std 0.32.
    inflation = np.concatenate([poses.inflation["accelerometer"], poses.inflation["magnetometer"]])
    assert inflation.mean() == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / 120.0))


def test_noise_with_a_memory_inflates_the_variance_of_means() -> None:
    """A first-order process with r = 0.8: (1 + r) / (1 - r) = 9 times that of white noise."""
    rng = np.random.default_rng(8)
    stretches, n = 60, 400
    readings = lfilter([0.006], [1.0, -0.8], rng.normal(size=(stretches * n, 3)), axis=0)
    readings += np.repeat(rng.normal(size=(stretches, 3)), n, axis=0)
    poses = still_poses(at_rest(stretches * n, accelerometer=readings))
    assert len(poses) == stretches
    # 180 chi-squares of one degree: 11 %; halves of 150 samples know a little less of each other: 3 %.
    assert poses.inflation["accelerometer"].mean() == pytest.approx(9.0, rel=0.5)


def test_everything_recorded_is_averaged(tmp_path: Path) -> None:
    n = 400
    rng = np.random.default_rng(9)
    half = np.repeat([0.0, 1.0], n // 2)
    quaternion = np.column_stack([np.cos(half / 2), np.sin(half / 2), np.zeros(n), np.zeros(n)])
    quaternion *= rng.choice([-1.0, 1.0], n)[:, None]  # the same rotations
    run = at_rest(
        n,
        accelerometer=rng.normal(size=(n, 3)) * 0.01 + half[:, None],
        tool_quaternion=quaternion,
        tool_position=half[:, None] * [1.0, 2.0, 3.0],
        temperature=20.0 + half,
        currents={2: half},
        supply=5.0 + half,
        units={"accelerometer": "mV"},
    )
    poses = still_poses(run, window_s=0.3)
    found = poses.recording
    assert len(poses) == 2
    assert found.metadata.rate_Hz is None
    assert found.units == {"accelerometer": "mV"}
    assert found.tool_position == pytest.approx(np.outer([0.0, 1.0], [1.0, 2.0, 3.0]))
    assert found.temperature == pytest.approx([20.0, 21.0])
    assert found.currents[2] == pytest.approx([0.0, 1.0])
    assert found.supply == pytest.approx([5.0, 6.0])
    assert found.tool_quaternion is not None
    assert np.abs(found.tool_quaternion[:, :2]) == pytest.approx(
        np.array([[1.0, 0.0], [np.cos(0.5), np.sin(0.5)]]), abs=1e-12
    )
    found.write(tmp_path / "poses.csv")
    assert read_recording(tmp_path / "poses.csv").metadata.extra["pose_samples"] == poses.counts.tolist()


def test_merged_stretches_are_one_average() -> None:
    run = at_rest(1000)
    knocked = np.array(run.accelerometer)
    knocked[400:410] += 0.5
    run = replace(run, accelerometer=knocked)
    found = find_still(run)
    poses = average_poses(run, found)
    assert len(found.first) == 2
    assert poses.counts.tolist() == [found.still.sum()]
    assert poses.recording.accelerometer == pytest.approx(knocked[found.still].mean(axis=0)[None], abs=1e-14)


# Measured data


def ellipsoid_residuals(readings: Array, gravity: float) -> Array:
    """(p,) |M (V - b)| - g of the least squares over a symmetric M and b [m/s^2]."""
    upper = np.triu_indices(3)

    def left(x: Array) -> Array:
        matrix = np.zeros((3, 3))
        matrix[upper] = x[:6]
        matrix = matrix + matrix.T - np.diag(matrix.diagonal())
        return np.asarray(np.linalg.norm((readings - x[6:]) @ matrix.T, axis=1) - gravity)

    middle, span = 0.5 * (readings.max(axis=0) + readings.min(axis=0)), np.ptp(readings, axis=0)
    start = np.concatenate([np.diag(2.0 * gravity / span)[upper], middle])
    scale = np.concatenate([np.full(6, gravity / span.mean()), span])
    return np.asarray(least_squares(left, start, x_scale=scale).fun)


@pytest.mark.skipif(not (REAL / "imu_tk_xsens").is_dir(), reason="needs the measured Xsens recording")
def test_the_poses_of_a_measured_recording_are_found() -> None:
    """38 poses by the data's own description (+-2 here), residual 1.0 mm/s^2 (1.2 here)."""
    table = np.loadtxt(REAL / "imu_tk_xsens" / "xsens_acc.mat")
    run = Recording(
        t=table[:, 0], accelerometer=table[:, 1:], units={"accelerometer": "raw"}, metadata=Metadata(rate_Hz=100.0)
    )
    for window_s in (0.5, 1.0, 1.5):
        poses = still_poses(run, window_s=window_s)
        assert len(poses) == pytest.approx(38, abs=2)
        residuals = ellipsoid_residuals(poses.recording.readings("accelerometer"), 9.81744)
        assert np.sqrt(np.square(residuals).mean()) < 1.2e-3
        assert poses.noise["accelerometer"] == pytest.approx([3.3, 3.2, 3.4], abs=0.3)  # 3.3 to 3.9 counts are stated


@pytest.mark.skipif(not (REAL / "mikoff_imu").is_dir(), reason="needs the measured MPU-9150 recordings")
@pytest.mark.parametrize("number", range(5))
def test_the_poses_of_sensors_moved_by_hand_are_found(number: int) -> None:
    """About 24 poses by the data's own description; two pairs of them are the same orientation.

    The residual of a fit to their means is 1.7 to 2.6 mm/s^2 there.
    """
    table = np.loadtxt(REAL / "mikoff_imu" / f"imu{number}.log")
    run = Recording(
        t=np.arange(len(table)) / 100.0,
        accelerometer=table[:, :3],
        units={"accelerometer": "m_s2"},
        metadata=Metadata(rate_Hz=100.0),
    )
    poses = still_poses(run)
    assert 20 <= len(poses) <= 26
    assert len(poses.stillness.first) == pytest.approx(24, abs=3)
    residuals = ellipsoid_residuals(poses.recording.readings("accelerometer"), 9.80665)
    assert np.sqrt(np.square(residuals).mean()) < 3e-3
