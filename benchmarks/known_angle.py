"""Calibration of both sensors, beside what no estimator can do without, and beside the paper's way.

A recording of the sweep in Ann Arbor, all 28 parameters of which can be told. From tool poses, the least there is to do
is the Gram product of [vec R, 1, volts], once these lie in memory as a matrix. From joint angles, the least is cosines
and sines of the moving joints, and a Gram product of as many rows.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

import estimators
import scenarios
from benchmarks._measure import Call, Cell, Goal, Report, Settings, Timing, interleaved, timing_table
from benchmarks.baselines import papers_way
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import SensorParameters
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import COLUMNS_OF
from rig.recording import Recording
from scenarios.scenario import Scenario

TITLE = "known-angle calibration of both sensors, beside the bare arithmetic and the paper's way"

_BLOCK: Final = 4096  # samples whose 16 rows stay in the second-level cache
_GRAM = "limit: Gram product"
_TRIGONOMETRY = "limit: sines, cosines, Gram product"
_PAPERS_WAY = "the paper's way (BFGS, numerical gradients)"
_LAID_OUT = "the paper's way, its cost laid out for the cache"
_FROM_JOINTS = "torusrig calibrate, from joint angles"
_FROM_POSES = "torusrig calibrate, from tool poses"
_SEPARATE = "torusrig calibrate, from joint angles, separate"


def run(settings: Settings) -> Report:
    scenario = scenarios.load("ann-arbor").with_acquisition(decimation=1)
    run = scenario.simulate(settings.seed)
    tool = scenario.with_acquisition(pose="tool").simulate(settings.seed)
    arm = Arm.a465()
    assert run.q is not None
    rotations = arm.rotation_map.rotations(run.q)
    fits: dict[str, Any] = {}

    def kept(name: str, call: Call) -> Call:
        def keep() -> None:
            fits[name] = call()

        return keep

    cubes = rotations.reshape(-1, 3, 3)
    laid_out = papers_way.laid_out(cubes)
    volts = {sensor: np.ascontiguousarray(run.readings(sensor)) for sensor in run.sensors}
    across = {sensor: np.ascontiguousarray(run.readings(sensor).T) for sensor in run.sensors}
    magnitudes = {"accelerometer": run.metadata.gravity_m_s2, "magnetometer": run.metadata.magnetic_field}
    rows = _rows(rotations, run)
    moving = np.ascontiguousarray(run.q[:, np.ptp(run.q, axis=0) > 0.0].T)
    calls: dict[str, Call] = {
        _FROM_JOINTS: kept(_FROM_JOINTS, lambda: estimators.calibrate(run)),
        _FROM_POSES: kept(_FROM_POSES, lambda: estimators.calibrate(tool)),
        _SEPARATE: kept(_SEPARATE, lambda: estimators.calibrate(run, method="separate")),
        _GRAM: lambda: _gram(rows),
        _TRIGONOMETRY: lambda: _sines_cosines_gram(moving, len(rows)),
        _PAPERS_WAY: kept(
            _PAPERS_WAY,
            lambda: {sensor: papers_way.fit(cubes, volts[sensor], magnitudes[sensor]) for sensor in run.sensors},
        ),
        _LAID_OUT: kept(
            _LAID_OUT,
            lambda: {
                sensor: papers_way.fit_laid_out(laid_out, across[sensor], magnitudes[sensor]) for sensor in run.sensors
            },
        ),
    }
    rounds = settings.rounds_of(15, 3)
    few = min(rounds, settings.of(3, 1))
    timings = interleaved(calls, rounds, fewer={_PAPERS_WAY: few, _LAID_OUT: few})
    judge = _Judge(scenario, rotations, run)
    errors: dict[str, Cell] = {}
    for name in (_FROM_JOINTS, _FROM_POSES):
        errors[name] = judge.error({sensor: _of_calibration(fits[name].sensors[sensor]) for sensor in run.sensors})
    for name in (_PAPERS_WAY, _LAID_OUT):
        errors[name] = judge.error({sensor: _of_paper(fit, magnitudes[sensor]) for sensor, fit in fits[name].items()})
    evaluations = sum(fit.evaluations for fit in fits[_PAPERS_WAY].values())
    table = timing_table(
        f"both sensors, {len(run):,} samples",
        timings,
        beside=[_GRAM, _TRIGONOMETRY, _PAPERS_WAY],
        further={"RMS error / bound": errors},
        note=(
            "Errors: over all 28 parameters, each over its Cramér–Rao bound, of this one draw"
            f" (1 ± {1 / np.sqrt(56):.2f} expected: the bound is of the mean square over many draws, and one draw may"
            f" lie below it). The paper's way took {evaluations:,} evaluations;"
            " computing its rotations is not in its time."
        ),
    )
    return Report((table,), _goals(timings, len(run)), {table.title: timings})


def _goals(timings: dict[str, Timing], samples: int) -> tuple[Goal, ...]:
    joints, poses, gram = timings[_FROM_JOINTS], timings[_FROM_POSES], timings[_GRAM]
    both = f"both sensors, {samples:,} samples"
    return (
        Goal(f"{both}, from joint angles [ms]", 1e3 * joints.median, "at most", 50.0),
        Goal(
            f"{both}, from joint angles over sines, cosines and Gram product",
            joints.over(timings[_TRIGONOMETRY]),
            "at most",
            2.5,
        ),
        Goal(f"{both}, from tool poses over the Gram product", poses.over(gram), "at most", 2.5),
        Goal(
            f"{both}, the paper's way over ours from joint angles", timings[_PAPERS_WAY].over(joints), "at least", 400.0
        ),
    )


def _rows(rotations: Array, run: Recording) -> Array:
    """(n, 16): vec R, 1 and the volts of both sensors, in memory as the Gram product likes them."""
    volts = [run.readings(sensor) for sensor in run.sensors]
    return np.ascontiguousarray(np.hstack([rotations, np.ones((len(run), 1)), *volts]))


def _gram(rows: Array) -> Array:
    return rows.T @ rows


def _sines_cosines_gram(angles: Array, count: int) -> Array:
    """NumPy's sines and cosines of angles (m, n), and a Gram product of 16 rows, in blocks that stay in the cache."""
    work = np.ones((16, _BLOCK))
    total = np.zeros((16, 16))
    m = len(angles)
    for start in range(0, count, _BLOCK):
        block = angles[:, start : start + _BLOCK]
        rows = work[:, : block.shape[1]]
        np.cos(block, out=rows[:m])
        np.sin(block, out=rows[m : 2 * m])
        total += rows @ rows.T
    return total


def _of_calibration(fit: estimators.SensorCalibration) -> SensorParameters:
    assert fit.field_direction is not None
    field = np.tile(fit.field_direction.vector, (3, 1))
    return SensorParameters(fit.reference_magnitude, fit.sensitivity, fit.offset, fit.axis_vectors, field)


def _of_paper(fit: papers_way.Fit, magnitude: float) -> SensorParameters:
    return SensorParameters(magnitude, fit.sensitivity, fit.offset, fit.axes, np.tile(fit.field, (3, 1)))


class _Judge:
    """Errors against the truth, in units of the Cramer-Rao bound."""

    def __init__(self, scenario: Scenario, rotations: Array, run: Recording) -> None:
        gram = Statistics.from_rotations(rotations).gram
        self._truth = {
            name: SensorParameters.of(sensor, scenario.rig.environment.field(name))
            for name, sensor in scenario.truth.sensors.items()
        }
        self._std = {
            name: np.sqrt(
                Information.of(gram, truth, scenario.rig.acquisition.noise_V[COLUMNS_OF[name]]).covariance.diagonal()
            )
            for name, truth in self._truth.items()
        }

    def error(self, found: dict[str, SensorParameters]) -> float:
        """Root mean square of all parameters' errors over their bounds; the sign of field and axes is free."""
        scores = []
        for name, estimate in found.items():
            truth = self._truth[name]
            sign = np.sign(estimate.fields[0] @ truth.fields[0])
            of_axes, of_fields = truth.bases
            errors = np.zeros(14)
            for k in range(3):
                errors[4 * k] = estimate.sensitivity[k] / truth.sensitivity[k] - 1.0
                errors[4 * k + 1] = (estimate.offset[k] - truth.offset[k]) / (
                    truth.sensitivity[k] * truth.reference_magnitude
                )
                errors[4 * k + 2 : 4 * k + 4] = of_axes[k] @ (sign * estimate.axes[k])
            errors[12:] = of_fields[0] @ (sign * estimate.fields[0])
            scores.append(errors / self._std[name])
        return float(np.sqrt(np.mean(np.square(scores))))
