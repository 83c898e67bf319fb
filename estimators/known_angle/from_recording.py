"""From a recording, in memory or on disk, to its calibration."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.calibration import SensorCalibration
from estimators.known_angle.statistics import Statistics
from estimators.loud_floor import loud_words
from estimators.noise import NoiseFloor, given_floor, noise_floor
from rig.arrays import Array
from rig.channels import ACCELEROMETER, SENSORS
from rig.errors import RigError, check_name, unknown_name
from rig.recording import Metadata, Recording, RecordingScan, locked_beside, scan_recording

if TYPE_CHECKING:
    from rig.arm import Arm

PathLike = str | os.PathLike[str]
FieldPoints = str | Sequence[float] | Mapping[str, str | Sequence[float]]
Noise = NoiseFloor | Mapping[str, ArrayLike] | ArrayLike | Literal["residuals"]

#: The arm that comes with the rig.
BUILT_IN: Final = "a465"
_POINTS: Final = {"down": (0.0, 0.0, -1.0), "up": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Summed:
    """A recording's statistics, and what is needed to interpret them.

    Attributes:
        statistics: of all channels of the chosen sensors, in their order.
        units: sensor -> recorded unit. metadata: of the recording.
        arm: the name of the arm that gave the orientations; None from tool poses.
        where: the file or name, for messages.
    """

    statistics: Statistics
    units: Mapping[str, str]
    metadata: Metadata
    arm: str | None
    where: str


def summarise(
    source: Recording | RecordingScan,
    sensors: Sequence[str],
    arm: Arm | None = None,
    progress: Callable[[int], None] | None = None,
) -> Summed:
    """Sum a recording, or a scan of one in constant memory, into its sufficient statistics.

    Args:
        source: the recording or scan.
        sensors: whose readings.
        arm, progress: as of ``calibrate``.

    Raises:
        RigError: no attitude, an unknown arm, or a joint beyond its limit.
    """
    batches: Iterable[Recording] = (source,) if isinstance(source, Recording) else source
    total: Statistics | None = None
    used: Arm | None = None
    units: Mapping[str, str] = {}
    where = source.name
    for batch in batches:
        if total is None:
            where = batch.origin or batch.name
            used = arm_of(batch, arm, where)
            units = batch.units
        readings = [batch.readings(sensor) for sensor in sensors]
        part = statistics_of(batch, used, readings, where)
        total = part if total is None else total + part
        if progress is not None:
            progress(len(batch))
    if total is None:
        raise RigError(f"{where}: has no samples")
    return Summed(total, units, source.metadata, None if used is None else used.name, where)


def statistics_of(batch: Recording, arm: Arm | None, readings: Sequence[Array], where: str) -> Statistics:
    """The statistics of a batch with a pose, for the arm that ``arm_of`` found.

    Raises:
        RigError: a joint beyond its limit.
    """
    if arm is not None and batch.q is not None:
        _check_limits(arm, batch.q, where)
        return Statistics.from_joints(arm.rotation_map, batch.q, *readings)
    assert batch.tool_quaternion is not None  # as arm_of has found
    return Statistics.from_quaternions(batch.tool_quaternion, *readings)


def has_pose(source: Recording | RecordingScan) -> bool:
    """Whether joint angles or tool poses were recorded."""
    if isinstance(source, Recording):
        return source.q is not None or source.tool_quaternion is not None
    return bool(source.columns.joints or source.columns.tool)


def scanned(path: PathLike, arm: Arm | None) -> RecordingScan:
    """The recording of a file, for an arm with so many joints."""
    return scan_recording(path, joints=None if arm is None else arm.dof)


def chosen_sensors(recorded: Sequence[str], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """The sensors to calibrate.

    Raises:
        RigError: one that was not recorded.
    """
    if wanted is None:
        return tuple(recorded)
    for sensor in wanted:
        check_name("recorded sensor", sensor, recorded)
    return tuple(sensor for sensor in SENSORS if sensor in wanted)


def points_of(given: FieldPoints, sensor: str, metadata: Metadata) -> tuple[float, float, float]:
    """The vector near which a sensor's field points: of an accelerometer that reads a - g the opposite of gravity's.

    Raises:
        RigError: neither a name nor three numbers.
    """
    wanted = given.get(sensor, "down") if isinstance(given, Mapping) else given
    if isinstance(wanted, str) and wanted not in _POINTS:
        raise unknown_name("field_points", wanted, _POINTS)
    vector = np.asarray(_POINTS[wanted] if isinstance(wanted, str) else wanted, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise RigError(f"field_points: found {wanted!r}, expected 'down', 'up' or three numbers, not all zero")
    x, y, z = (float(value) for value in vector)
    return (-x, -y, -z) if reads_of(metadata, sensor) == "a-g" else (x, y, z)


def reads_of(metadata: Metadata, sensor: str) -> str | None:
    """What an accelerometer reads, g - a or a - g; None of a magnetometer."""
    return metadata.accelerometer_reads if sensor == ACCELEROMETER else None


@dataclass(frozen=True)
class Floors:
    """The noise by sensor, from wherever it is known.

    Attributes:
        source: "locked recording", "given" or "residuals". measured, given: one of them, or neither.
    """

    source: str = "residuals"
    measured: NoiseFloor | None = None
    given: Mapping[str, Array] | None = None

    def of(self, sensor: str, unit: str) -> tuple[Array, Array] | None:
        """(3,) standard deviation of a reading, and (3,) of that [unit]; None where it is not known."""
        if self.measured is not None:
            return self.measured.of(sensor, unit)
        if self.given is not None and sensor in self.given:
            return self.given[sensor], np.zeros(3)
        return None

    def with_loudness(self, made: SensorCalibration) -> SensorCalibration:
        """A calibration made with these, warned where they are louder than its residuals."""
        words = self.source
        if self.measured is not None:
            words += f", {int(self.measured.pose_samples.sum()):,} samples at {self.measured.rate_Hz:.4g} Hz"
        return made.warned(*loud_words(made.quality.chi_square, words))


def floors_of(path: PathLike | Recording | None, noise: Noise | None) -> Floors:
    """The noise as it is given, or of the locked recording beside a path."""
    if isinstance(noise, NoiseFloor):
        return Floors("locked recording", measured=noise)
    if isinstance(noise, str):
        if noise != "residuals":
            raise unknown_name("noise", noise, ("residuals",))
        return Floors()
    if noise is not None:
        return Floors("given", given=given_floor(noise))
    if path is None or isinstance(path, Recording):
        return Floors()
    locked = locked_beside(Path(path))
    return Floors() if locked is None else Floors("locked recording", measured=noise_floor(locked))


def arm_of(batch: Recording, arm: Arm | None, where: str) -> Arm | None:
    """The arm whose kinematics give the orientations; None where the tool's are recorded and no arm was asked for.

    Raises:
        RigError: no pose, or joint angles of an arm that is not known.
    """
    if batch.q is None and batch.tool_quaternion is None:
        raise RigError(
            f"{where}: has no pose, expected q1_rad..qN_rad or tool_qw..tool_qz; without a pose only the attitude-free"
            " method 'ellipsoid' can be used"
        )
    if batch.q is None or (arm is None and batch.tool_quaternion is not None):
        return None
    used = arm_or_named(arm, batch.metadata.arm)
    if used is None:
        raise RigError(
            f"{where}: arm {batch.metadata.arm!r} is not built in, expected its model (--arm FILE), or arm {BUILT_IN!r}"
        )
    return used


def arm_or_named(arm: Arm | None, name: str | None) -> Arm | None:
    """The arm that was given, else the one that comes with the rig where a recording or a calibration names that."""
    if arm is not None or name != BUILT_IN:
        return arm
    from rig.arm import Arm  # brings MuJoCo with it: only where it is needed

    return Arm.a465()


def _check_limits(arm: Arm, q: Array, where: str) -> None:
    """As ``Arm.check_limits``, without its intermediate arrays where all is well."""
    if q.shape[1] != arm.dof or (q.min(axis=0) < arm.lower).any() or (q.max(axis=0) > arm.upper).any():
        try:
            arm.check_limits(q, where)
        except RigError as error:
            raise RigError(f"{error} of arm {arm.name!r}; the model of another arm is stated by --arm FILE") from None
