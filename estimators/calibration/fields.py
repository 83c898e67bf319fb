"""Using a calibration: readings become m/s^2 and field units."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from estimators.calibration.contract import Calibration, SensorCalibration
from rig.arrays import Array
from rig.errors import RigError
from rig.recording import Recording, RecordingWriter, scan_recording
from rig.units import conversion_factor


def field_of(calibration: SensorCalibration, readings: ArrayLike, unit: str | None = None) -> Array:
    """The field that a sensor felt, in its own frame (frame 6 if the calibration knows the attitude).

    Args:
        calibration: of the sensor.
        readings: (n, 3) [unit].
        unit: of the readings; None: the calibration's.

    Returns:
        (n, 3) [m/s^2, field unit]; of an accelerometer what it reads, g - a or a - g.

    Raises:
        RigError: the unit cannot be converted to the calibration's, or the axes do not span space.
    """
    if not np.isfinite(calibration.matrix).all():
        raise RigError("calibration: has no matrix, as its axes do not span space")
    values = np.asarray(readings, dtype=float)
    if unit is not None and unit != calibration.unit:
        values = values * conversion_factor(unit, calibration.unit)
    return np.asarray((values - calibration.bias) @ calibration.matrix.T)


def apply(calibration: Calibration, recording: Recording) -> Recording:
    """The recording with fields in place of readings; sensors that were not calibrated are left out.

    Raises:
        RigError: no sensor of the recording was calibrated, or as of ``field_of``.
    """
    sensors = [sensor for sensor in recording.sensors if sensor in calibration.sensors]
    if not sensors:
        raise RigError(
            f"{recording.origin or recording.name}: found {', '.join(recording.sensors)},"
            f" expected a sensor that was calibrated: {', '.join(calibration.sensors)}"
        )
    fields = {}
    for sensor in sensors:
        own, stated = calibration[sensor], recording.metadata.stated_field_unit(sensor)
        fields[sensor] = field_of(own, recording.readings(sensor), recording.units[sensor])
        if own.field_unit is not None and stated is not None:  # the recording's columns have the unit that it states
            fields[sensor] *= conversion_factor(own.field_unit, stated)
    return recording.with_fields(fields)


def apply_file(
    calibration: Calibration,
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    progress: Callable[[int], None] | None = None,
) -> int:
    """``apply`` from file to file in constant memory; the target appears whole or not at all.

    Args:
        calibration: to be used.
        source, target: recordings, .parquet or .csv.
        progress: called with the number of samples of every batch that is done.

    Returns:
        The number of samples.

    Raises:
        RigError: a file cannot be read or written, or as of ``apply``.
    """
    count = 0
    with RecordingWriter(target) as writer:
        for batch in scan_recording(source):
            writer.write(apply(calibration, batch))
            count += len(batch)
            if progress is not None:
                progress(len(batch))
    return count
