"""Known truths, poses and errors that the tests of the known-angle estimators share."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from directions import unit_vectors
from scipy.spatial.transform import Rotation

from estimators.known_angle.fit import SensorFit
from estimators.known_angle.model import METHODS, Method, SensorParameters, columns_of_channels
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.arrays import Array
from rig.directions import direction_from_angles
from rig.maneuver import TorusSweep
from rig.recording import Recording
from rig.sensor import TriaxialSensor

ACCELEROMETER_NOISE = np.array([0.0134, 0.0136, 0.0146])
MAGNETOMETER_NOISE = np.array([0.0085, 0.0068, 0.0117])

#: Renk et al.: the simulated truth of Table 2 with gravity along -k, and the estimates of Tables 5 and 10.
TABLE_2 = TriaxialSensor((0.1, 0.15, 0.095), (2.45, 2.55, 2.3), (-89.0, 1.0, -3.75), (2.0, 93.5, -2.0))
TABLE_5 = TriaxialSensor(
    (0.14259, 0.14251, 0.14198), (2.3754, 2.4491, 2.1096), (85.3089, -1.2394, 1.2829), (89.8537, 0.8943, 272.1489)
)
TABLE_10 = TriaxialSensor(
    (1.3006, 1.3283, 1.3342), (2.4216, 2.3967, 2.7643), (0.96237, -85.6307, -4.0172), (270.2059, 185.8359, 1.2153)
)
GRAVITY = 9.8 * direction_from_angles(90.0023, 11.0511)
FIELD = direction_from_angles(59.4127, 81.402)

TRUTHS = {
    "table2": (SensorParameters.of(TABLE_2, (0.0, 0.0, -9.8)), ACCELEROMETER_NOISE),
    "table5": (SensorParameters.of(TABLE_5, GRAVITY), ACCELEROMETER_NOISE),
    "table10": (SensorParameters.of(TABLE_10, FIELD), MAGNETOMETER_NOISE),
}


#: Of a test of either method.
BOTH = pytest.mark.parametrize("method", METHODS)


@cache
def sweep_angles() -> Array:
    """(6656, 6) [rad] every 25th sample of the paper's sweep."""
    return TorusSweep().trajectory().q[::25]


#: Orientations (n, 3, 3) or (n, 9) that are less kind than a sweep's, by a generator.
POSE_SETS: dict[str, Callable[[np.random.Generator], Array]] = {
    "three orientations": lambda rng: np.repeat(Rotation.random(3, rng=rng).as_matrix(), 20, axis=0),
    "six orientations": lambda rng: np.repeat(Rotation.random(6, rng=rng).as_matrix(), 10, axis=0),
    "seven orientations": lambda rng: np.repeat(Rotation.random(7, rng=rng).as_matrix(), 10, axis=0),
    "twenty orientations": lambda rng: Rotation.random(20, rng=rng).as_matrix(),
    "within 20 degrees": lambda rng: Rotation.from_rotvec(0.2 * rng.standard_normal((100, 3))).as_matrix(),
    "turns about one axis": lambda rng: Rotation.from_rotvec(rng.uniform(0.0, 6.0, (60, 1)) * [0, 0, 1]).as_matrix(),
    "the sweep's first 400": lambda rng: Arm.a465().rotation_map.rotations(sweep_angles()[:400]),
}


@cache
def sweep_rotations(count: int = 6656) -> Array:
    """(count, 9) vec R_base_tool of so many samples spread evenly over the whole sweep."""
    rows = np.round(np.linspace(0, 6655, count)).astype(int)
    return Arm.a465().rotation_map.rotations(sweep_angles()[rows])


@cache
def sweep_statistics(count: int = 6656) -> Statistics:
    """Their statistics, with readings of zero: poses to draw from."""
    return Statistics.from_rotations(sweep_rotations(count), np.zeros((count, 3)))


def readings(rotations: Array, truth: SensorParameters) -> Array:
    """(n, 3) readings without noise, channel by channel from Renk (13), without the estimators' linear form."""
    R = rotations.reshape(-1, 3, 3)
    result = np.empty((len(R), 3))
    for k in range(3):
        felt = np.einsum("nij,i,j->n", R, truth.fields[k], truth.axes[k])
        result[:, k] = truth.sensitivity[k] * truth.reference_magnitude * felt + truth.offset[k]
    return result


def noiseless(base: Statistics, truth: SensorParameters) -> Statistics:
    """Exact statistics of readings without noise in the same poses."""
    theta = truth.coefficients
    return Statistics(base.count, base.gram, base.gram @ theta, theta.T @ base.gram @ theta)


def random_truth(rng: np.random.Generator) -> SensorParameters:
    """Any axes and any field, sensitivities and offsets like those of the paper's accelerometer."""
    field = unit_vectors(rng, 1)
    return SensorParameters(
        9.8, rng.uniform(0.09, 0.16, 3), rng.uniform(2.0, 3.0, 3), unit_vectors(rng, 3), np.tile(field, (3, 1))
    )


def errors(fit: SensorFit, truth: SensorParameters, method: Method) -> Array:
    """(p,) truth minus estimate in the coordinates of the fit's covariance."""
    estimate = fit.parameters
    axis_bases, field_bases = estimate.bases
    result = np.empty(len(fit.covariance))
    for k, start, of_field in columns_of_channels(method):
        result[[start, start + 1]] = (
            np.array([truth.sensitivity[k] - estimate.sensitivity[k], truth.offset[k] - estimate.offset[k]])
            / estimate.scales[k]
        )
        result[start + 2 : start + 4] = axis_bases[k] @ truth.axes[k]
        result[of_field] = field_bases[k] @ truth.fields[k]
    return result


def largest_difference(found: SensorParameters, expected: SensorParameters) -> float:
    """The largest difference of any S, delta, and component of axes and fields."""
    return max(
        float(np.abs(getattr(found, name) - getattr(expected, name)).max())
        for name in ("sensitivity", "offset", "axes", "fields")
    )


def run_of(
    truths: dict[str, SensorParameters], noise: float | Array, seed: int, q: Array | None = None, **changes: Any
) -> Recording:
    """A recording [V] of a sweep's angles, or others (n, 6) [rad], with white noise; without converter or clipping."""
    angles = sweep_angles() if q is None else q
    rotations = Arm.a465().rotation_map.rotations(angles)
    rng = np.random.default_rng(seed)
    contents: dict[str, Any] = {"t": np.arange(len(angles)) / 4.0, "q": angles}
    for column, (sensor, truth) in enumerate(truths.items()):
        sigma = np.broadcast_to(noise, (len(truths), 3))[column]
        contents[sensor] = readings(rotations, truth) + sigma * rng.standard_normal((len(angles), 3))
    return Recording(**{**contents, **changes})


BOTH_SENSORS = {"accelerometer": TRUTHS["table5"][0], "magnetometer": TRUTHS["table10"][0]}
BOTH_NOISES = np.stack([ACCELEROMETER_NOISE, MAGNETOMETER_NOISE])
