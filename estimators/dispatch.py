"""Calibrate whatever recording there is: one or several, in memory or in a file, with its attitude or without."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from estimators.calibration import Calibration, SensorCalibration
from estimators.coverage import coverage
from estimators.ellipsoid import Options, calibrate_attitude_free
from estimators.known_angle.assemble import assemble
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.from_recording import (
    FieldPoints,
    Noise,
    PathLike,
    arm_of,
    chosen_sensors,
    floors_of,
    has_pose,
    points_of,
    reads_of,
    scanned,
    summarise,
)
from estimators.known_angle.model import Method, Weighting
from estimators.known_angle.together import calibrate_together
from rig.errors import RefusedFit, RigError
from rig.recording import Recording, RecordingScan, thinned
from rig.recording.repeated_poses import evenly_posed

if TYPE_CHECKING:
    from rig.arm import Arm

#: In which the directions are looked for that a refused fit has missed.
_SAMPLES_OF_A_REFUSAL: Final = 20_000
_DIRECTIONS: Final = 8  # of them are named


def calibrate(
    run: Recording | PathLike | Sequence[Recording | PathLike],
    method: Method | Literal["ellipsoid"] | None = None,
    noise: Noise | None = None,
    arm: Arm | None = None,
    field_points: FieldPoints = "down",
    weighting: Weighting = "likelihood",
    sensors: Sequence[str] | None = None,
    progress: Callable[[int], None] | None = None,
    attitude_free: Options | None = None,
    stated: Mapping[str, Any] | None = None,
) -> Calibration:
    """Calibrate the sensors of a recording, or of several at once.

    Args:
        run: a recording; a path is read in batches, so that its length does not matter, unless its poses are those of a
            slower log, each repeated (``evenly_posed``): then it is read whole. Several: one calibration holds
            for all of them (``estimators.known_angle.together``); by attitude only.
        method: "simultaneous": one field direction a sensor, Renk (15), (21); "separate": one a channel, (14), (20);
            "ellipsoid": without the attitude, from the constant magnitude of the fields, Camps et al. None:
            simultaneous, or ellipsoid where the recording has no pose.
        noise: the standard deviation of a reading, as a ``NoiseFloor``, as sensor -> (3,) or as (6,) [recorded unit];
            None: the locked recording beside a path, else the residuals; "residuals": these in any case.
        arm: gives the orientations from the joint angles. None: those of the tool if they were recorded, else the A465
            where the metadata name it.
        field_points: "down", "up" or any vector (3,), base frame, within 90 degrees of the field (of gravity, whatever
            the accelerometer reads), or one of these for each sensor: it chooses between (field, axes) and
            (-field, -axes), which give the same readings.
        weighting: "likelihood" or, as in the paper, "equal" for all channels of a simultaneous fit.
        sensors: which of the recorded ones; None: all.
        progress: called with the number of samples of every batch that is done.
        attitude_free: options of "ellipsoid".
        stated: the recording's metadata that are known better than it says: ``gravity_m_s2``, ``magnetic_field``,
            ``magnetic_field_unit``.

    Raises:
        RigError: the recording has no attitude, its arm is not known, a joint is beyond its limit, an option is
            unknown, or there are fewer samples than parameters.
        RefusedFit: the poses cannot determine the parameters, two solutions fit alike, or a channel does not respond.
    """
    if not isinstance(run, Recording | str | os.PathLike):
        if method == "ellipsoid":
            raise RigError("several recordings: found method 'ellipsoid', expected simultaneous or separate")
        return calibrate_together(run, method, noise, arm, field_points, weighting, sensors, progress, stated)
    from_file = not isinstance(run, Recording)
    source: Recording | RecordingScan = run if isinstance(run, Recording) else scanned(run, arm)
    if stated:
        source = replace(source, metadata=replace(source.metadata, **stated))
    chosen = chosen_sensors(source.sensors, sensors)
    if method is None:
        method = "simultaneous" if has_pose(source) else "ellipsoid"
    points = {sensor: points_of(field_points, sensor, source.metadata) for sensor in chosen}
    floors = floors_of(run if from_file else None, noise)
    if method == "ellipsoid":
        units = source.units if isinstance(source, Recording) else source.columns.units
        known = {sensor: floors.of(sensor, units[sensor]) for sensor in chosen}
        options = Options() if attitude_free is None else attitude_free
        found = calibrate_attitude_free(source, chosen, known, floors.source, options, progress)
        sensors_found = {
            sensor: floors.with_loudness(replace(own, reads=reads_of(source.metadata, sensor)))
            for sensor, own in found.sensors.items()
        }
        return Calibration(sensors_found, source.name, None, found.extra)
    source, repeats = evenly_posed(source)
    summed = summarise(source, chosen, arm, progress)
    results: dict[str, SensorCalibration] = {}
    for position, sensor in enumerate(chosen):
        floor = floors.of(sensor, summed.units[sensor])
        try:
            fit = fit_sensor(
                summed.statistics.select(slice(3 * position, 3 * position + 3)),
                summed.metadata.magnitude(sensor),
                method=method,
                noise=None if floor is None else floor[0],
                weighting=weighting,
                field_points=points[sensor],
                name=f"{summed.where}: {sensor}",
            )
        except RefusedFit as refusal:
            raise _explained(refusal, source, points[sensor], arm) from refusal
        made = assemble(
            fit,
            unit=summed.units[sensor],
            noise_source="residuals" if floor is None else floors.source,
            floor_std=0.0 if floor is None else floor[1],
            field_points=points[sensor],
            reads=reads_of(summed.metadata, sensor),
            field_unit=summed.metadata.stated_field_unit(sensor),
        )
        results[sensor] = floors.with_loudness(made.warned(*repeats))
    return Calibration(results, source.name, summed.arm)


def _explained(
    refusal: RefusedFit, source: Recording | RecordingScan, field: Sequence[float], arm: Arm | None
) -> RefusedFit:
    """The refusal with the directions that were not seen, the field (3,) being where it is said to point."""
    some = thinned(source, _SAMPLES_OF_A_REFUSAL)
    vector = np.asarray(field, dtype=float)
    rotations = some.rotations(arm_of(some, arm, some.name)).reshape(-1, 3, 3)
    seen = coverage(np.matmul(vector / np.linalg.norm(vector), rotations))  # R^T f
    names = seen.missing_names
    if not names:
        return refusal
    more = f" and {len(names) - _DIRECTIONS} more" if len(names) > _DIRECTIONS else ""
    return RefusedFit(
        f"{refusal}; the field was seen in {100.0 * seen.share:.0f} % of {seen.cells.count} equal cells of frame 6:"
        f" bring it along {', '.join(names[:_DIRECTIONS])}{more}"
    )
