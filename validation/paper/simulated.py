"""What the rig gives under the conditions of Renk et al.: many draws of their experiment, and their 25 subsets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from estimators.batch import ManyParameters, fit_many
from estimators.known_angle.model import Method, SensorParameters, parameter_names
from rig.arrays import Array
from rig.channels import ACCELEROMETER, COLUMNS_OF
from rig.threads import one_blas_thread
from scenarios.loader import load
from scenarios.scenario import Scenario
from scenarios.studies.coordinates import RADIAN_DEG, Coordinates
from scenarios.studies.increments import Increments
from scenarios.studies.settings import Settings, expected
from scenarios.studies.subset_results import SubsetStudy
from scenarios.studies.subsets import study
from validation.paper.published import renk

#: Draws of the whole experiment: standard deviations are good to 2 %.
DRAWS: Final = 1000
_SEED: Final = 2005
_METHODS: Final[tuple[Method, ...]] = ("separate", "simultaneous")


def scenario_of(sensor: str) -> Scenario:
    """The paper's experiment with its own simultaneous estimates as truth."""
    return load(f"renk2005-{sensor}")


@dataclass(frozen=True, eq=False)
class Drawn:
    """Many draws of one sensor's experiment, fitted both ways; the paper's equal weights in the simultaneous fit.

    Attributes:
        sensor: which. truth: what made the readings. gram: (10, 10) of the sweep. noise: (3,) of a reading [V].
        estimates: method -> of all draws, the same ones for both.
    """

    sensor: str
    truth: SensorParameters
    gram: Array
    noise: Array
    estimates: dict[Method, ManyParameters]

    def values(self, method: Method) -> dict[str, Array]:
        """Parameter -> (m,) as a calibration has it."""
        table = self.estimates[method].values(method)
        return dict(zip(parameter_names(method), table.T, strict=True))

    def bound(self, method: Method) -> dict[str, float]:
        """Coordinate -> root of the Cramer-Rao bound."""
        coordinates = Coordinates(self.truth, method)
        spread = np.sqrt(coordinates.bound(self.gram, self.noise).diagonal())
        return dict(zip(coordinates.names, map(float, spread), strict=True))

    def angles_between(self, method: Method) -> dict[str, Array]:
        """Pair -> (m,) angle between the axes [deg]."""
        axes = self.estimates[method].axes
        return {
            f"{i + 1}-{j + 1}": np.degrees(np.arccos((axes[:, i] * axes[:, j]).sum(axis=1)))
            for i, j in ((0, 1), (0, 2), (1, 2))
        }

    def between_methods(self, k: int) -> dict[str, float]:
        """Standard deviation of separate less simultaneous estimate from the same data, of channel k = 0, 1, 2.

        Returns:
            sensitivity, offset, beta, gamma (a displacement on the sphere) -> standard deviation.
        """
        left, right = (Coordinates(self.truth, method).errors(self.estimates[method]) for method in _METHODS)
        difference = left[:, 6 * k : 6 * k + 4] - right[:, 4 * k : 4 * k + 4]
        return dict(zip(("sensitivity", "offset", "beta", "gamma"), map(float, difference.std(axis=0)), strict=True))

    def fields_apart(self, k: int) -> Array:
        """(2, 2) covariance of channel k's separate field direction less the simultaneous one, along growing phi and
        psi at the truth [deg^2]."""
        left, right = (Coordinates(self.truth, method).errors(self.estimates[method]) for method in _METHODS)
        return np.cov((left[:, 6 * k + 4 : 6 * k + 6] - right[:, 12:14]).T)


@cache
def drawn(sensor: str) -> Drawn:
    """The draws of a sensor."""
    settings = Settings.of(scenario_of(sensor), 2, draws=DRAWS)
    poses = expected(settings)
    readings, truth, noise = poses.readings[sensor], poses.truth[sensor], poses.noise[sensor]
    count = len(poses.rotations)
    sums = Increments.of(poses.rotations, readings, np.arange(count), [count])
    rng = np.random.default_rng([_SEED, int(sensor == ACCELEROMETER)])
    with one_blas_thread():
        cross, square = sums.draw(rng, noise, DRAWS)
        estimates = {
            method: fit_many(
                sums.gram[0],
                cross[0],
                square[0],
                count,
                noise,
                method,
                reference_magnitude=truth.reference_magnitude,
                field_points=truth.fields[0],
                weighting="equal",
            ).parameters
            for method in _METHODS
        }
    return Drawn(sensor, truth, sums.gram[0], noise, estimates)


@cache
def subsets(sensor: str) -> SubsetStudy:
    """One simulated experiment at the full rate, in 25 interleaved subsets."""
    scenario = scenario_of(sensor).with_acquisition(decimation=1)
    noise = np.asarray(scenario.rig.acquisition.noise_V)[COLUMNS_OF[sensor]]
    return study(scenario.simulate(_SEED), renk()["subsets"], noise=lambda _sensor, _unit: noise, noise_source="given")


@cache
def noiseless() -> dict[str, float]:
    """Estimates from the simulated accelerometers of Table 2 without noise, by separate fits."""
    settings = Settings.of(load("renk2005-table2"), 2)
    poses = expected(settings)
    readings, truth = poses.readings[ACCELEROMETER], poses.truth[ACCELEROMETER]
    count = len(poses.rotations)
    sums = Increments.of(poses.rotations, readings, np.arange(count), [count])
    fits = fit_many(
        sums.gram[0],
        sums.cross[0][None],
        sums.square[0][None],
        count,
        poses.noise[ACCELEROMETER],
        "separate",
        reference_magnitude=truth.reference_magnitude,
        field_points=truth.fields[0],
    )
    values = fits.parameters.values("separate")[0]
    return dict(zip(parameter_names("separate"), map(float, values), strict=True))


def displacement_deg(direction: Array, other: Array) -> float:
    """The angle between two unit vectors (3,) [deg]."""
    return RADIAN_DEG * float(2.0 * np.arcsin(min(0.5 * float(np.linalg.norm(direction - other)), 1.0)))
