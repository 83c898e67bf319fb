"""What a scenario's maneuver can tell, before anyone runs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from estimators.design.attitude_free_bound import FreeSensor
from estimators.design.maneuver_bound import Growth, growth, predict
from estimators.design.prediction import Prediction
from estimators.known_angle.identifiability import Told, is_open
from estimators.known_angle.model import Method, SensorParameters
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array, Mask, Rows
from rig.channels import ACCELEROMETER, COLUMNS_OF
from rig.documents import plain
from rig.errors import RigError
from rig.trajectory import PoseTrajectory
from scenarios.scenario import Scenario
from scenarios.shown_units import field_unit

#: The interval of a maneuver whose worth is told apart [s]: a minute, or less so that there are this many.
_INTERVAL_S: Final = 60.0
_FEWEST_INTERVALS: Final = 20
#: A sensor that turns by less [rad, rad/s] is at rest, and a maneuver at rest for more than this share holds poses.
_TURNED: Final = 1e-9
_HELD: Final = 0.1


@dataclass(frozen=True, eq=False)
class FreeGrowth:
    """How the bound of a sensor without attitude falls as a maneuver goes on.

    Attributes:
        gain: (b, 3) or (b, 6) standard deviation relative to the largest gain. offset: (b, 3) [recorded unit].
        share: (b,) of everything learned in the end, what each interval has paid for.
    """

    gain: Array
    offset: Array
    share: Array


@dataclass(frozen=True, eq=False)
class SensorBound:
    """One sensor's bound: at the end of the maneuver, and after each of its intervals."""

    prediction: Prediction
    growth: Growth | FreeGrowth
    reference_magnitude: float
    field_unit: str


@dataclass(frozen=True, eq=False)
class ScenarioBound:
    """The bound of a scenario.

    Attributes:
        scenario: its name.
        attitude: whether the recording will know it.
        time_s: (b,) the ends of the intervals [s].
        sensors: name -> bound.
        given: what no maneuver can tell, so that a calibration takes it as given.
        left_out: names of the scenario's effects, which the bound does not know.
    """

    scenario: str
    attitude: bool
    time_s: Array
    sensors: Mapping[str, SensorBound]
    given: tuple[str, ...]
    left_out: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """A JSON object; what cannot be told is null."""
        return {
            "format": "rig-bound/1",
            "scenario": self.scenario,
            "attitude": self.attitude,
            "sensors": {
                name: {
                    **bound.prediction.to_json(),
                    "reference_magnitude": bound.reference_magnitude,
                    "after": plain(vars(bound.growth)),
                }
                for name, bound in self.sensors.items()
            },
            "time_s": plain(self.time_s),
            "given": list(self.given),
            "effects_left_out": list(self.left_out),
        }


def bound_of(scenario: Scenario, method: Method = "simultaneous") -> ScenarioBound:
    """The Cramer-Rao bound of a scenario's maneuver, truth and white noise; nothing is simulated.

    The converter's rounding counts as noise of step / sqrt(12). Where the recording will have no pose, the bound is
    that of the attitude-free calibration, and of an accelerometer that is held in poses only what it reads at rest
    counts.

    Args:
        scenario: its maneuver is taken as commanded.
        method: of the known-angle calibration.

    Raises:
        RigError: the scenario has no noise, or its maneuver does not suit its arm.
    """
    noise = noise_of(scenario)
    t, rotations, still = _rotations(scenario)
    end = scenario.maneuver.duration_s
    width = min(_INTERVAL_S, end / _FEWEST_INTERVALS)
    edges = np.append(np.arange(1, round(np.ceil(end / width - 1e-9))) * width, end)
    cuts = np.concatenate([[0], np.searchsorted(t, edges - 1e-9), [len(t)]])[: len(edges) + 1]
    cuts[-1] = len(t)
    acquisition = scenario.rig.acquisition
    joints = scenario.rig.arm is not None and acquisition.pose == "joints"
    attitude = acquisition.pose == "tool" or joints
    parts = [Statistics.from_rotations(rotations[a:b]).gram for a, b in pairwise(cuts)]
    sensors: dict[str, SensorBound] = {}
    environment = scenario.rig.environment
    for name, sensor in scenario.truth.sensors.items():
        field = environment.field(name)
        magnitude = float(np.linalg.norm(field))
        truth = SensorParameters.of(sensor, field)
        sigma = noise[COLUMNS_OF[name]]
        unit = field_unit(name, scenario.magnetic_field_unit)
        if attitude:
            predicted: Prediction = predict(np.sum(parts, axis=0), len(t), truth, sigma, method)
            grown: Growth | FreeGrowth = growth(np.array(parts), truth, sigma, method)
        else:
            used = still if name == ACCELEROMETER and still.mean() > _HELD else np.ones_like(still)
            directions = np.einsum("nij,i->nj", rotations[used].reshape(-1, 3, 3), field / magnitude)
            inside = np.concatenate([[0], np.cumsum(used)])[cuts]
            predicted, grown = _free(FreeSensor.of(truth.gain, truth.offset, magnitude), directions, sigma, inside)
        sensors[name] = SensorBound(predicted, grown, magnitude, unit)
    return ScenarioBound(
        scenario.name,
        attitude,
        edges,
        sensors,
        tuple(_given(sensors, attitude, joints)),
        tuple(f"{effect.name} at {effect.where}" for effect in scenario.rig.effects),
    )


def noise_of(scenario: Scenario) -> Array:
    """(6,) standard deviation of a reading [V], the converter's rounding included.

    Raises:
        RigError: a channel has none.
    """
    noise = scenario.rig.acquisition.sigma
    for sensor in scenario.truth.sensors:
        if not noise[COLUMNS_OF[sensor]].all():
            raise RigError(
                f"scenario {scenario.name}: the {sensor} has a channel without noise, expected noise_V above zero:"
                " without noise everything is told exactly"
            )
    return noise


def _rotations(scenario: Scenario) -> tuple[Array, Array, Mask]:
    """Of the samples that will be recorded: times (n,) [s], vec R_base_tool (n, 9), and whether the sensor is at rest
    (n,)."""
    trajectory = scenario.maneuver.trajectory()
    kept = slice(None, None, scenario.rig.acquisition.decimation)
    if isinstance(trajectory, PoseTrajectory):
        table = trajectory.R_base_tool.reshape(-1, 9)
        moves = np.abs(np.diff(table, axis=0)).max(axis=1) > _TURNED
        still = ~(np.append(moves, False) | np.append(False, moves))
        return trajectory.t[kept], table[kept], still[kept]
    arm = scenario.rig.arm
    if arm is None:
        raise RigError(f"scenario {scenario.name}: its maneuver moves joints, expected an arm")
    arm.check_limits(trajectory.q, "the maneuver")
    still = np.abs(trajectory.qd[kept]).max(axis=1) <= _TURNED
    return trajectory.t[kept], arm.rotation_map.rotations(trajectory.q[kept]), still


def _free(sensor: FreeSensor, directions: Array, noise: Array, cuts: Rows) -> tuple[Prediction, FreeGrowth]:
    parts = np.array([sensor.information(directions[a:b], noise) for a, b in pairwise(cuts)])
    total = np.cumsum(parts, axis=0)
    std = np.full(total.shape[:2], np.nan)
    for row, matrix in enumerate(total):
        told = Told.of(matrix)
        std[row] = np.where(is_open(told.null), np.nan, np.sqrt(told.covariance.diagonal()))
    final = Told.of(total[-1])
    share = np.einsum("ij,bji->b", final.covariance, parts) / len(final.covariance)
    size = float(sensor.gain.diagonal().max()) * sensor.magnitude
    grown = FreeGrowth(std[:, :-3], std[:, -3:] * size, np.full_like(share, np.nan) if final.null.size else share)
    return sensor.predict(total[-1], len(directions), noise), grown


def _given(sensors: Mapping[str, SensorBound], attitude: bool, joints: bool) -> list[str]:
    """What no maneuver can tell."""
    found = []
    for name, bound in sensors.items():
        letter = "|g|" if name == ACCELEROMETER else "|B|"
        found.append(
            f"{letter} = {bound.reference_magnitude:g} {bound.field_unit}: readings tell sensitivity times {letter}; an"
            " error of 1 % in it is one of 1 % in every sensitivity"
        )
    if attitude:
        found.append("the sign: (field, axes) and (-field, -axes) give the same readings")
        frames = "the zeros of the first and the last joint" if joints else "the base and the tool frame"
        found.append(f"{frames}: an error in them turns the field, or the axes, that is found")
    else:
        found.append("how the sensor sits on its carrier: without attitude, readings tell the axes up to a rotation")
    return found
