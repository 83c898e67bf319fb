"""Calibrating in spite of outliers: find them with a fit they cannot move, leave them out, fit the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from estimators.calibration import Calibration, SensorCalibration
from estimators.dispatch import calibrate
from estimators.goodness.outliers import CUT, robust_scale
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.from_recording import FieldPoints, Noise, arm_or_named, statistics_of
from estimators.known_angle.model import Method, Weighting
from rig.arrays import Array, Mask
from rig.errors import RefusedFit, RigError
from rig.recording import Recording
from rig.recording.repeated_poses import evenly_posed
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm


_SAMPLE: Final = 20_000
_PASSES: Final = 30
_REFITS: Final = 20
#: Where more than this share has to go, it is not a matter of outliers.
MOST_REJECTED: Final = 0.3


@dataclass(frozen=True, eq=False)
class Rejection:
    """What was left out of a sensor's readings.

    Attributes:
        kept: (n,) whether a sample was used.
    """

    kept: Mask

    @property
    def rejected(self) -> int:
        """How many samples."""
        return int((~self.kept).sum())


def robust_calibrate(
    run: Recording,
    method: Method = "simultaneous",
    noise: Noise | None = None,
    arm: Arm | None = None,
    field_points: FieldPoints = "down",
    weighting: Weighting = "likelihood",
    sensors: Sequence[str] | None = None,
    cut: float = CUT,
) -> tuple[Calibration, dict[str, Rejection]]:
    """``estimators.calibrate`` without outliers, sensor by sensor.

    Args:
        run: a recording in memory that knows its attitude.
        method, noise, arm, field_points, weighting, sensors: as of ``estimators.calibrate``.
        cut: see ``reject_outliers``.

    Returns:
        The calibration, and what was left out for each sensor; a warning in the quality says how much.

    Raises:
        RigError, RefusedFit: as of ``estimators.calibrate`` and ``reject_outliers``.
    """
    run, repeats = evenly_posed(run)
    needed = run.q is not None and run.tool_quaternion is None
    used = arm_or_named(arm, run.metadata.arm) if needed else arm  # ``calibrate`` says what is missing
    found: dict[str, SensorCalibration] = {}
    rejected: dict[str, Rejection] = {}
    name: str | None = None
    for sensor in run.sensors if sensors is None else sensors:
        rejection = reject_outliers(run, sensor, used, cut)
        part = run if rejection.kept.all() else run.select(rejection.kept)
        result = calibrate(part, method, noise, arm, field_points, weighting, (sensor,))
        own = result[sensor].warned(*repeats)
        if rejection.rejected:
            words = (
                f"{rejection.rejected} of {len(run)} samples were left out as outliers (beyond {cut:g} standard"
                " deviations)"
            )
            left_out = {"count": rejection.rejected, "share": rejection.rejected / len(run)}
            own = replace(own, quality=replace(own.quality, outliers=left_out)).warned(words)
        found[sensor], rejected[sensor], name = own, rejection, result.arm
    return Calibration(found, run.name, name), rejected


def reject_outliers(run: Recording, sensor: str, arm: Arm | None = None, cut: float = CUT) -> Rejection:
    """Which samples of a sensor to use.

    The readings are linear in the ten entries of [vec R, 1], which are bounded: no sample has much leverage, so that
    the least absolute deviations of this linear form, which are convex and need no start, resist gross errors. From
    there: the samples within ``cut`` robust standard deviations in all channels are fitted, and chosen anew by that
    fit, until they stay the same.

    Args:
        run: a recording that knows its attitude.
        sensor: whose readings.
        arm: for joint angles.
        cut: in robust standard deviations; from five on next to nothing is lost where there are no outliers.

    Raises:
        RigError: the cut is below two, a joint beyond its limit, or as of ``Recording.rotations``.
        RefusedFit: more than 30 % would have to go.
    """
    if not cut >= 2.0:
        raise RigError(f"cut: found {cut}, expected 2 standard deviations or more")
    readings = run.readings(sensor)
    coefficients = _least_absolute(run, sensor, arm)
    kept = _near(run, readings, coefficients, arm, cut)
    magnitude = run.metadata.magnitude(sensor)
    for _ in range(_REFITS):
        if kept.mean() < 1.0 - MOST_REJECTED:
            raise RefusedFit(
                f"{run.origin or run.name}: {sensor}: {100.0 * (1.0 - kept.mean()):.0f} % of the samples lie beyond"
                f" {cut:g} robust standard deviations, expected at most {100.0 * MOST_REJECTED:.0f} %: these are no"
                " outliers, the model does not hold"
            )
        part = run if kept.all() else run.select(kept)
        summed = statistics_of(part, arm, [part.readings(sensor)], run.origin or run.name)
        fit = fit_sensor(summed, magnitude, name=sensor, refuse=False)
        before, kept = kept, _near(run, readings, fit.parameters.coefficients, arm, cut)
        if (kept == before).all():
            break
    return Rejection(kept)


def _least_absolute(run: Recording, sensor: str, arm: Arm | None) -> Array:
    """(10, 3) least absolute deviations of [vec R, 1], by iteratively reweighted least squares, of enough samples."""
    some = run if len(run) <= _SAMPLE else run.select(slice(None, None, -(-len(run) // _SAMPLE)))
    terms = np.column_stack([some.rotations(arm), np.ones(len(some))])
    readings = some.readings(sensor)
    result = np.empty((10, 3))
    with one_blas_thread():
        for k in range(3):
            weights = np.ones(len(some))
            for _ in range(_PASSES):
                weighted = terms * weights[:, None]
                values, vectors = np.linalg.eigh(weighted.T @ terms)
                told = values > 1e-10 * values[-1]
                theta = vectors[:, told] @ ((vectors[:, told].T @ (weighted.T @ readings[:, k])) / values[told])
                left = np.abs(readings[:, k] - terms @ theta)
                weights = 1.0 / np.maximum(left, max(0.01 * float(np.median(left)), np.finfo(float).tiny))
                weights /= weights.max()
            result[:, k] = theta
    return result


def _near(run: Recording, readings: Array, coefficients: Array, arm: Arm | None, cut: float) -> Mask:
    left = np.empty((3, len(run)))
    with one_blas_thread():
        for rows, block in run.rotation_blocks(arm):
            np.matmul(coefficients[:9].T, block, out=left[:, rows])
    left = readings - left.T - coefficients[9]
    rounding = 1e-12 * np.abs(readings).max(axis=0)
    return np.asarray((np.abs(left) <= np.maximum(cut * robust_scale(left), rounding)).all(axis=1))
