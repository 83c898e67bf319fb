"""Is it good? Every test of a calibration in one answer, in words and as data."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from estimators.calibration import Calibration, SensorCalibration
from estimators.coverage.seen import coverage
from estimators.ellipsoid import read_thinned
from estimators.goodness.by_direction import by_direction
from estimators.goodness.cross_terms import SIX, cross_terms
from estimators.goodness.hold_out import hold_out
from estimators.goodness.outliers import outliers
from estimators.goodness.own_optimum import at_optimum
from estimators.goodness.raw_readings import clipped, copies, repeats
from estimators.goodness.residuals import Residuals, residuals_of, selected
from estimators.goodness.whiteness import whiteness
from estimators.goodness.words import Goodness, reasons, remarks
from estimators.known_angle.from_recording import arm_or_named
from estimators.loud_floor import against_floor
from estimators.stillness import still_poses
from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.errors import RefusedFit, RigError
from rig.recording import Recording, scan_recording, thinned
from rig.recording.repeated_poses import evenly_posed

if TYPE_CHECKING:
    from rig.arm import Arm


#: Samples that are looked at: more of them make no test that matters sharper.
MOST_SAMPLES: Final = 1 << 18
#: Two ways to the same sum of squares agree to this.
_SAME: Final = 1e-3


def is_it_good(
    run: Recording | str | os.PathLike[str],
    calibration: Calibration,
    arm: Arm | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    at_most: int = MOST_SAMPLES,
) -> dict[str, Goodness]:
    """Ask a recording whether a calibration is good: its own, or another one's.

    Args:
        run: the recording, or its file, of which stretches are read.
        calibration: made from it, or from an earlier one.
        arm: for joint angles; None: the A465 where the calibration names it.
        limits: sensor -> lowest and highest possible reading [recorded unit].
        at_most: samples to look at, spread evenly in stretches.

    Raises:
        RigError: as of ``residuals_of``, or the file cannot be read.
    """
    posed, _ = evenly_posed(run if isinstance(run, Recording) else scan_recording(run))
    recording = thinned(posed, at_most)
    used = arm_or_named(arm, calibration.arm)
    found: dict[str, Goodness] = {}
    for sensor in recording.sensors:
        if sensor in calibration.sensors:
            own = calibration[sensor]
            still = None if own.axes or sensor != ACCELEROMETER else at_rest(run, own)
            found[sensor] = _judge(
                recording.readings(sensor),
                recording if still is None else still,
                sensor,
                own,
                used,
                recording.name == calibration.recording,
                None if limits is None else limits.get(sensor),
            )
    return found


def judged(
    run: Recording | str | os.PathLike[str],
    calibration: Calibration,
    arm: Arm | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    at_most: int = MOST_SAMPLES,
) -> Calibration:
    """The calibration with ``is_it_good`` written into its quality, as ``verdict`` and beside it.

    The reasons are added to the quality's warnings. Arguments as of ``is_it_good``.
    """
    found = is_it_good(run, calibration, arm, limits, at_most)
    sensors = dict(calibration.sensors)
    for sensor, goodness in found.items():
        own = sensors[sensor]
        known = own.quality.warnings
        quality = replace(
            own.quality,
            chi_square=own.quality.chi_square if own.quality.chi_square is not None else goodness.chi_square,
            coverage=_merged(own.quality.coverage, goodness.coverage.to_json()),
            repeats=_merged(own.quality.repeats, goodness.repeats.to_json()),
            clipped=goodness.clipped.to_json(),
            outliers={**goodness.outliers.to_json(), "left_out": goodness.left_out},
            verdict=goodness.to_json(),
            warnings=(*known, *(reason for reason in goodness.reasons if reason not in known)),
        )
        sensors[sensor] = replace(own, quality=quality)
    return replace(calibration, sensors=sensors)


def _judge(
    readings: Array,
    recording: Recording,
    sensor: str,
    calibration: SensorCalibration,
    arm: Arm | None,
    own: bool,
    limits: tuple[float, float] | None,
) -> Goodness:
    """Hold a sensor's calibration against its readings (n, 3) as they were recorded.

    Args:
        recording: whose residuals count: of these readings, or of means over the poses in which an accelerometer was
            at rest.
        own: whether the calibration seems to come from it, by its name.
        limits: of a reading, where they are known [recorded unit].
    """
    if calibration.axes and recording.tool_quaternion is not None and recording.q is not None and arm is None:
        recording = replace(recording, q=None)
    given = residuals_of(recording, sensor, calibration, arm)
    if not (np.isfinite(given.standardised).all() and np.isfinite(given.part(0, len(given)).information).all()):
        raise RefusedFit(
            f"{recording.origin or recording.name}: {sensor}: its readings and their noise differ by too many orders of"
            " magnitude to be judged"
        )
    odd = outliers(given)
    left_out = left_out_by(calibration)
    if left_out and len(odd.rows):  # as the calibration has left them out
        rest = np.ones(len(recording), dtype=bool)
        rest[odd.rows] = False
        given = residuals_of(selected(recording, rest), sensor, calibration, arm)
    without_cross_terms = own and not calibration.axes and len(calibration.vector_parameters) == SIX
    residuals, transfer = at_optimum(given, calibration.samples)
    goodness = Goodness(
        sensor,
        (),
        (),
        _against_floor(given, calibration, own),
        calibration.quality.condition,
        transfer,
        coverage(residuals.directions),
        by_direction(residuals),
        cross_terms(given, calibration.reference_magnitude) if without_cross_terms else None,
        hold_out(residuals),
        whiteness(residuals),
        repeats(readings, calibration.noise),
        clipped(readings, calibration.noise, limits),
        odd,
        copies(readings),
        left_out,
        len(readings),
    )
    return replace(goodness, reasons=tuple(reasons(goodness, calibration)), remarks=tuple(remarks(goodness)))


def at_rest(run: Recording | str | os.PathLike[str], calibration: SensorCalibration) -> Recording | None:
    """The means over the poses that an attitude-free calibration of an accelerometer comes from.

    None where it comes from all samples, or no poses are found.
    """
    recording = run if isinstance(run, Recording) else read_thinned(scan_recording(run))
    if calibration.samples >= len(recording) or "pose_samples" in recording.metadata.extra:
        return None
    try:
        return still_poses(recording, sensors=(ACCELEROMETER,)).recording
    except RigError:
        return None


def left_out_by(calibration: SensorCalibration) -> int:
    """How many outliers the estimator, or ``robust_calibrate``, says it has left out."""
    known = calibration.quality.outliers
    if not isinstance(known, dict):
        return 0
    return int(known.get("left_out") or (0 if "expected" in known else known.get("count") or 0))


def _merged(known: Any, found: dict[str, Any]) -> dict[str, Any]:
    return {**known, **found} if isinstance(known, dict) else found


def _against_floor(residuals: Residuals, calibration: SensorCalibration, own: bool) -> Mapping[str, Any] | None:
    """The estimator's, which knows how well the floor is known, if it is of these samples; else made anew."""
    known = calibration.quality.chi_square
    if not residuals.sigma_given:
        return known if own else None
    per_channel = np.square(residuals.standardised).sum(axis=0)
    freedom = float(residuals.values.size - residuals.parameters)
    found = against_floor(float(per_channel.sum()), freedom, np.sqrt(per_channel * len(per_channel) / freedom))
    if known is None or not own:
        return found
    thinner = residuals.readings < calibration.samples
    return known if thinner or abs(known["value"] / found["value"] - 1.0) < _SAME else found
