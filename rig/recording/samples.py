"""A recording: time, pose and readings of one run, from the simulator or from a real arm."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rig.arrays import Array, Mask, Rows
from rig.channels import ACCELEROMETER, CHANNELS_OF, MAGNETOMETER, SENSORS
from rig.errors import RigError, check_name
from rig.recording.checks import as_columns, check_finite, check_increasing, check_seconds, check_shape, check_unit
from rig.recording.columns import POSITION, QUATERNION, SUPPLY, TEMPERATURE, TIME, Columns
from rig.recording.metadata import Metadata
from rig.recording.table_io import table_writer
from rig.threads import one_blas_thread
from rig.units import UNITS

if TYPE_CHECKING:
    from rig.arm import Arm


_BLOCK = 2048  # rotations at a time: they stay in the cache
#: The arrays with a row a sample; the currents are more of them.
_ARRAYS: Final = (
    *("t", "q", "tool_quaternion", "tool_position", ACCELEROMETER, MAGNETOMETER),
    *("temperature", "supply"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """The samples of one run. They are checked when it is made, read-only, and contiguous by columns.

    Attributes:
        t: (n,) [s], increasing.
        q: (n, N) [rad] joint angles as the encoders give them; of joints that slide [m].
        slides: the numbers of the joints that slide, from 1.
        tool_quaternion: (n, 4) unit quaternion, scalar first, of R_base_tool, as a tracking system gives it.
        tool_position: (n, 3) [m] the tool in the base frame; only with tool_quaternion.
        accelerometer, magnetometer: (n, 3) in the recorded unit; at least one of them.
        units: sensor -> recorded unit; "V" where nothing is said.
        temperature: (n,) [degC]; currents: joint number -> (n,) [A]; supply: (n,) [V].
        metadata: what the recording says about itself.
        name: the file's name without its ending.
        origin: the file, with which error messages begin; the name where there is none.
        first_row: of the file, in a batch of a larger recording.

    Without q and tool_quaternion nothing is known of the attitude: a sensor tumbled by hand. With both, joint angles
    are used wherever an arm is given for them.

    Raises:
        RigError: no sample, no sensor, arrays that do not fit together, a NaN or infinity, time that does not
            increase, a quaternion that is not a rotation, an unknown unit.
    """

    t: Array
    q: Array | None = None
    slides: tuple[int, ...] = ()
    tool_quaternion: Array | None = None
    tool_position: Array | None = None
    accelerometer: Array | None = None
    magnetometer: Array | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    temperature: Array | None = None
    currents: Mapping[int, Array] = field(default_factory=dict)
    supply: Array | None = None
    metadata: Metadata = field(default_factory=Metadata)
    name: str = "recording"
    origin: str = ""
    first_row: int = 0

    def __post_init__(self) -> None:
        where = self.origin or self.name
        t = self._keep("t", self.t, (-1,), (TIME,))
        if self.first_row == 0:  # a later batch is judged with the first
            check_seconds(t, where)
        check_increasing(t, where, self.first_row)
        n = len(t)
        if self.q is not None:
            q = as_columns(self.q, "q", where)
            self._keep("q", q, (n, -1), tuple(f"q{joint}_rad" for joint in range(1, q.shape[-1] + 1)))
        if self.tool_quaternion is not None:
            turns = self._keep("tool_quaternion", self.tool_quaternion, (n, 4), QUATERNION)
            check_unit(turns, QUATERNION, where, self.first_row)
        if self.tool_position is not None:
            if self.tool_quaternion is None:
                raise RigError(f"{where}: partial pose: found tool_position without tool_quaternion")
            self._keep("tool_position", self.tool_position, (n, 3), POSITION)
        object.__setattr__(self, "units", self._checked_units(where))
        for sensor, unit in self.units.items():
            self._keep(sensor, getattr(self, sensor), (n, 3), tuple(f"{c}_{unit}" for c in CHANNELS_OF[sensor]))
        if self.temperature is not None:
            self._keep("temperature", self.temperature, (n,), (TEMPERATURE,))
        if self.supply is not None:
            self._keep("supply", self.supply, (n,), (SUPPLY,))
        object.__setattr__(self, "currents", self._checked_currents(where))

    def __len__(self) -> int:
        """How many samples."""
        return len(self.t)

    def __repr__(self) -> str:
        """One line: samples, time, pose, sensors."""
        sensors = ", ".join(f"{sensor} [{unit}]" for sensor, unit in self.units.items())
        return f"Recording({self.name!r}: {len(self)} samples, {self.duration_s:g} s, pose: {self.pose}, {sensors})"

    @property
    def sensors(self) -> tuple[str, ...]:
        """Those of SENSORS that were recorded."""
        return tuple(self.units)

    @property
    def pose(self) -> str:
        """How the attitude was recorded: "joints", "tool", "joints and tool" or "none"."""
        kinds = [kind for kind, values in (("joints", self.q), ("tool", self.tool_quaternion)) if values is not None]
        return " and ".join(kinds) or "none"

    @property
    def duration_s(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.t[-1]) - float(self.t[0])

    @property
    def untimed(self) -> bool:
        """Whether the samples are still poses whose numbers stand for their times."""
        return self.metadata.still_poses and bool((self.t == np.arange(len(self))).all())

    @property
    def rate_Hz(self) -> float:
        """The stated sampling rate, else samples per duration [Hz].

        Raises:
            RigError: a single sample without a stated rate.
        """
        if self.metadata.rate_Hz is not None:
            return self.metadata.rate_Hz
        if len(self) < 2:
            raise RigError(f"{self.origin or self.name}: one sample has no rate, expected rate_Hz in the metadata")
        return (len(self) - 1) / self.duration_s

    @property
    def fingerprint(self) -> str:
        """16 hexadecimal digits that only the same times and readings have (SHA-256)."""
        digest = hashlib.sha256(np.ascontiguousarray(self.t).tobytes())
        for sensor in self.sensors:
            digest.update(np.ascontiguousarray(self.readings(sensor)).tobytes())
        return digest.hexdigest()[:16]

    def readings(self, sensor: str) -> Array:
        """(n, 3) in the recorded unit.

        Raises:
            RigError: the sensor is unknown or was not recorded.
        """
        self.unit(sensor)
        readings: Array = getattr(self, sensor)
        return readings

    @property
    def every_reading(self) -> Array:
        """(n, c) of the sensors that were recorded, in the order of their channels."""
        return np.hstack([self.readings(sensor) for sensor in self.sensors])

    def unit(self, sensor: str) -> str:
        """The recorded unit of a sensor.

        Raises:
            RigError: the sensor is unknown or was not recorded.
        """
        check_name("sensor", sensor, SENSORS)
        if sensor not in self.units:
            raise RigError(f"{self.origin or self.name}: has no {sensor}, found {', '.join(self.sensors)}")
        return self.units[sensor]

    def rotations(self, arm: Arm | None) -> Array:
        """(n, 9) R_base_tool, row-major: of the joint angles where an arm is given for them, else of the tool's pose.

        Raises:
            RigError: no pose was recorded, or joint angles only and no arm or one with another number of joints.
        """
        result = np.empty((len(self), 9))
        with one_blas_thread():
            for rows, block in self.rotation_blocks(arm):
                result[rows] = block.T
        return result

    def rotation_blocks(self, arm: Arm | None) -> Iterator[tuple[slice, Array]]:
        """As ``rotations``, in blocks: the samples, and (9, m), overwritten by the next block.

        Wrap the loop in ``rig.threads.one_blas_thread``.

        Raises:
            RigError: as ``rotations``, at the call.
        """
        where = self.origin or self.name
        if self.q is not None and arm is not None:
            if self.q.shape[1] != arm.dof:
                raise RigError(f"{where}: found {self.q.shape[1]} joint angles, expected {arm.dof} of arm {arm.name!r}")
            return arm.rotation_map.blocks(self.q, _BLOCK)
        if self.tool_quaternion is not None:
            return _blocks(self.tool_quaternion)
        if self.q is not None:
            raise RigError(f"{where}: has joint angles, for which an arm is needed: found none")
        raise RigError(f"{where}: has no pose, expected q1_rad..qN_rad or {', '.join(QUATERNION)}")

    def select(self, rows: slice | Array | Mask | Rows) -> Recording:
        """Some of the samples: a slice, a mask or increasing row numbers. The metadata stay as they are.

        Raises:
            RigError: nothing is selected, or not in the order of time.
        """
        pick: Any = rows if isinstance(rows, slice) else np.asarray(rows)
        return replace(self, **arrays_of([self], lambda arrays: arrays[0][pick]), first_row=0)

    def with_fields(self, fields: Mapping[str, Array]) -> Recording:
        """The same run with calibrated readings, and only those: what a calibration made of it.

        Args:
            fields: sensor -> (n, 3): g - a [m/s^2] of the accelerometer, the field [field unit] of the magnetometer.

        The accelerometer's unit becomes "m_s2"; the magnetometer's the metadata's ``magnetic_field_unit``, or "raw"
        where the field's magnitude is relative.
        """
        for sensor in fields:
            self.unit(sensor)
        units = {sensor: self.metadata.field_unit(sensor) for sensor in fields}
        return replace(
            self, accelerometer=fields.get(ACCELEROMETER), magnetometer=fields.get(MAGNETOMETER), units=units
        )

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write to .parquet or .csv, whole or not at all; numbers are read back exactly.

        Raises:
            RigError: another ending, or the file cannot be written.
        """
        with table_writer(path, self.columns.names, self.metadata.to_text(), rows=len(self)) as append:
            append(self.table())

    @property
    def columns(self) -> Columns:
        """The columns it is written with."""
        joints = range(1, 1 + (0 if self.q is None else self.q.shape[1]))
        return Columns(
            joints=tuple((f"q{joint}_{'m' if joint in self.slides else 'rad'}", False) for joint in joints),
            tool=self.tool_quaternion is not None,
            position=self.tool_position is not None,
            readings={s: tuple(f"{channel}_{unit}" for channel in CHANNELS_OF[s]) for s, unit in self.units.items()},
            units=dict(self.units),
            currents={joint: f"current{joint}_A" for joint in self.currents},
            temperature=self.temperature is not None,
            supply=self.supply is not None,
        )

    def table(self) -> dict[str, Array]:
        """Column name -> (n,), in the order in which they are written."""
        blocks = (self.t[:, None], self.q, self.tool_quaternion, self.tool_position)
        readings = (self.readings(sensor) for sensor in self.sensors)
        scalars = (self.temperature, *self.currents.values(), self.supply)
        values = [column for block in (*blocks, *readings) if block is not None for column in block.T]
        values += [scalar for scalar in scalars if scalar is not None]
        return dict(zip(self.columns.names, values, strict=True))

    def _keep(self, attribute: str, values: Array, shape: tuple[int, ...], names: tuple[str, ...]) -> Array:
        """Check an array and keep a read-only one in its place."""
        where = self.origin or self.name
        array = as_columns(values, attribute, where)
        if array.shape[:1] == (0,):
            raise RigError(f"{where}: has no samples")
        check_shape(array, shape, attribute, where)
        check_finite(array, names, where, self.first_row)
        object.__setattr__(self, attribute, array)
        return array

    def _checked_units(self, where: str) -> dict[str, str]:
        recorded = [sensor for sensor in SENSORS if getattr(self, sensor) is not None]
        if not recorded:
            raise RigError(f"{where}: no sensor, expected readings of the accelerometer or the magnetometer")
        for sensor, unit in self.units.items():
            if sensor not in recorded:
                raise RigError(f"{where}: units: found {sensor!r}, which was not recorded")
            if unit not in UNITS[sensor]:
                expected = ", ".join(UNITS[sensor])
                raise RigError(f"{where}: unknown unit {unit!r} of the {sensor}, expected one of {expected}")
        return {sensor: self.units.get(sensor, "V") for sensor in recorded}

    def _checked_currents(self, where: str) -> dict[int, Array]:
        kept = {}
        for joint, values in sorted(self.currents.items()):
            if joint < 1:
                raise RigError(f"{where}: currents: found joint {joint}, expected 1 or more")
            kept[joint] = as_columns(values, f"current{joint}", where)
            check_shape(kept[joint], (len(self.t),), f"current{joint}", where)
            check_finite(kept[joint], (f"current{joint}_A",), where, self.first_row)
        return kept


def arrays_of(runs: Sequence[Recording], make: Callable[[list[Array]], Array]) -> dict[str, Any]:
    """Every array of samples, for ``dataclasses.replace`` on the first of the runs.

    Args:
        runs: recordings of the same columns.
        make: the new array from those of the runs, (n, ..) each.
    """

    def made(name: str) -> Array | None:
        there = [values for run in runs if (values := getattr(run, name)) is not None]
        return make(there) if there else None

    currents = {joint: make([run.currents[joint] for run in runs]) for joint in runs[0].currents}
    return {name: made(name) for name in _ARRAYS} | {"currents": currents}


def _blocks(quaternion: Array) -> Iterator[tuple[slice, Array]]:
    """Of unit quaternions (n, 4), scalar first, what ``Recording.rotation_blocks`` gives: fast enough not to be noticed
    beside the calibration that needs it. The norm need not be exactly one."""
    count = len(quaternion)
    buffer = np.empty((9, min(_BLOCK, count)))
    for first in range(0, count, _BLOCK):
        span = slice(first, min(first + _BLOCK, count))
        block = buffer[:, : span.stop - first]
        _fill(quaternion[span], block)
        yield span, block


def _fill(quaternion: Array, block: Array) -> None:
    w, x, y, z = np.ascontiguousarray(quaternion.T)
    scale = 2.0 / (w * w + x * x + y * y + z * z)
    sx, sy, sz = scale * x, scale * y, scale * z
    xx, yy, zz = sx * x, sy * y, sz * z
    xy, xz, yz = sx * y, sx * z, sy * z
    wx, wy, wz = sx * w, sy * w, sz * w
    np.subtract(1.0, yy + zz, out=block[0])
    np.subtract(xy, wz, out=block[1])
    np.add(xz, wy, out=block[2])
    np.add(xy, wz, out=block[3])
    np.subtract(1.0, xx + zz, out=block[4])
    np.subtract(yz, wx, out=block[5])
    np.subtract(xz, wy, out=block[6])
    np.add(yz, wx, out=block[7])
    np.subtract(1.0, xx + yy, out=block[8])
