"""Recordings and calibrations that the tests of goodness share."""

from __future__ import annotations

import numpy as np
from kinematic_examples import ACCELEROMETER_NOISE, TABLE_5
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import estimators
from estimators.calibration import Calibration, SensorCalibration
from estimators.calibration.parts import Quality
from estimators.goodness import (
    Goodness,
    is_it_good,
)
from rig.arrays import Array
from rig.recording import Recording

GRAVITY = 9.8 * np.array([0.05, 0.02, -1.0]) / np.linalg.norm([0.05, 0.02, -1.0])


def known(n: int, rng: np.random.Generator, noise: Array = ACCELEROMETER_NOISE) -> Recording:
    """An accelerometer in random orientations that are known, by a tracking system."""
    turns = Rotation.random(n, rng=rng)
    volts = TABLE_5.volts(TABLE_5.components(turns.as_matrix(), GRAVITY)) + rng.normal(size=(n, 3)) * noise
    return Recording(t=np.arange(n) / 4.0, tool_quaternion=turns.as_quat(scalar_first=True), accelerometer=volts)


def unknown(n: int, rng: np.random.Generator) -> tuple[Recording, Calibration]:
    """One in random orientations that are not known, and the nine parameters of greatest likelihood."""
    gain, offset, H = np.array([[1.8, 0.02, -0.01], [0.02, 1.7, 0.03], [-0.01, 0.03, 1.75]]), np.full(3, 0.1), 1.0
    sigma, upper = np.array([0.02, 0.025, 0.03]), np.triu_indices(3)
    u = Rotation.random(n, rng=rng).as_matrix()[:, 0]
    readings = u @ gain.T + offset + rng.normal(size=(n, 3)) * sigma

    def model(x: Array) -> tuple[Array, Array]:
        matrix = np.zeros((3, 3))
        matrix[upper] = x[:6]
        return matrix + matrix.T - np.diag(matrix.diagonal()), x[6:]

    def left(x: Array) -> Array:
        matrix, centre = model(x)
        fields = (readings - centre) @ matrix.T
        length = np.linalg.norm(fields, axis=1)
        along = np.square((fields / length[:, None]) @ matrix) @ sigma**2
        across = np.square(matrix) @ sigma**2
        return np.asarray((length - H - 0.5 * (across.sum() - along)) / np.sqrt(along))

    start = np.concatenate([np.linalg.inv(gain)[upper], offset])
    matrix, centre = model(least_squares(left, start).x)
    found = SensorCalibration(
        method="ellipsoid",
        unit="V",
        reference_magnitude=H,
        matrix=matrix,
        bias=centre,
        parameters=("offset1",),
        values=centre[:1],
        covariance=np.eye(1),
        identifiable={"offset1": True},
        samples=n,
        fit_rms=sigma,
        noise=sigma,
        noise_source="given",
        quality=Quality(condition=1.0),
    )
    return Recording(t=np.arange(n) / 4.0, accelerometer=readings), Calibration({"accelerometer": found})


def calibrated(run: Recording) -> Calibration:
    return estimators.calibrate(run, noise={"accelerometer": ACCELEROMETER_NOISE})


def good(run: Recording, calibration: Calibration | None = None) -> Goodness:
    return is_it_good(run, calibration or calibrated(run))["accelerometer"]
