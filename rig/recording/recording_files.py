"""Recordings on disk: read whole or in batches, written in batches, and the locked-arm recording beside one."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER, SENSORS
from rig.errors import RigError
from rig.files import in_utf8
from rig.memory import check_fits
from rig.recording.checks import check_finite, check_increasing
from rig.recording.columns import (
    JOINTS_OF_ARM,
    POSITION,
    QUATERNION,
    SUPPLY,
    TEMPERATURE,
    TIME,
    Columns,
)
from rig.recording.metadata import Metadata
from rig.recording.samples import Recording
from rig.recording.table import SUFFIXES, NumberedTable, Table
from rig.recording.table_io import open_table, table_writer

_COPIES = 3  # of every number, at most, while a file is read whole
_WHOLE_FILE_BATCH = 1 << 18  # rows; what does not matter for a recording that is to be in memory anyway


@dataclass(frozen=True)
class RecordingScan:
    """A recording on disk, as an iterable of Recordings of at most ``batch_rows`` samples in constant memory.

    Every batch is checked like any recording, and that time increases from batch to batch. It can be iterated over
    again.

    Attributes:
        table: the file.
        metadata: what the recording says about itself.
        columns: those that are read.
        batch_rows: at most so many samples a batch.
    """

    table: Table
    metadata: Metadata
    columns: Columns
    batch_rows: int

    @property
    def path(self) -> Path:
        """The file."""
        return self.table.path

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return in_utf8(self.table.path.stem)

    @property
    def unused(self) -> tuple[str, ...]:
        """The table's columns that are no part of the recording."""
        known = set(Columns.parse(self.table.names, str(self.path)).names)
        return tuple(name for name in self.table.names if name not in known)

    @property
    def stated(self) -> frozenset[str]:
        """The keys of the metadata that the file states itself; not those whose default it has assumed."""
        if self.table.metadata is None:
            return frozenset()
        return frozenset(json.loads(self.table.metadata)) - set(self.metadata.assumed)

    @property
    def rows(self) -> int | None:
        """How many samples; None for CSV, which has to be read to know."""
        return self.table.rows

    @property
    def sensors(self) -> tuple[str, ...]:
        """Those of SENSORS that are read."""
        return tuple(sensor for sensor in SENSORS if sensor in self.columns.readings)

    def __iter__(self) -> Iterator[Recording]:
        """The batches; a thread decodes and checks the next one while the last one is used.

        Raises:
            RigError: a damaged file, no samples, or samples that make no recording; rows are counted from 0.
        """
        batches = self._batches()
        with ThreadPoolExecutor(max_workers=1) as worker:
            coming = worker.submit(next, batches, None)
            while (batch := coming.result()) is not None:
                coming = worker.submit(next, batches, None)
                yield batch

    def _batches(self) -> Iterator[Recording]:
        row = 0
        before = -np.inf
        for table in self.table.batches(self.columns.names, self.batch_rows):
            if not len(table[TIME]):
                continue
            batch = self._recording(table, row)
            check_increasing(np.array([before, batch.t[0]]), str(self.path), row - 1)
            yield batch
            row += len(batch)
            before = float(batch.t[-1])
        if row == 0:
            raise RigError(f"{self.path}: has no samples")

    def read(self) -> Recording:
        """The whole recording.

        Raises:
            RigError: as in iteration.
        """
        size = 8 * _COPIES * len(self.columns.names)
        if self.rows is not None:
            self._check_fits(self.rows, size)
        tables, rows = [], 0
        for table in self.table.batches(self.columns.names, max(self.batch_rows, _WHOLE_FILE_BATCH)):
            tables.append(table)
            rows += len(table[TIME])
            self._check_fits(rows, size)
        if not any(len(table[TIME]) for table in tables):
            raise RigError(f"{self.path}: has no samples")
        if len(tables) == 1:
            return self._recording(tables[0], 0)
        return self._recording({name: np.concatenate([t[name] for t in tables]) for name in self.columns.names}, 0)

    def _check_fits(self, rows: int, size: int) -> None:
        check_fits(rows * size, f"{self.path}: {rows} rows of {len(self.columns.names)} columns")

    def _recording(self, table: dict[str, Array], first_row: int) -> Recording:
        return recording_of(table, self.columns, self.metadata, self.name, str(self.path), first_row)


def recording_of(
    table: Mapping[str, Array], columns: Columns, metadata: Metadata, name: str, origin: str, first_row: int = 0
) -> Recording:
    """A recording from the columns of a table, (n,) each.

    Raises:
        RigError: samples that make no recording.
    """

    def stacked(names: tuple[str, ...]) -> Array:
        return np.stack([table[name] for name in names]).T  # columns contiguous

    return Recording(
        t=table[TIME],
        q=_joint_angles(table, columns, origin, first_row) if columns.joints else None,
        slides=columns.slides,
        tool_quaternion=stacked(QUATERNION) if columns.tool else None,
        tool_position=stacked(POSITION) if columns.position else None,
        accelerometer=stacked(columns.readings[ACCELEROMETER]) if ACCELEROMETER in columns.readings else None,
        magnetometer=stacked(columns.readings[MAGNETOMETER]) if MAGNETOMETER in columns.readings else None,
        units=columns.units,
        temperature=table[TEMPERATURE] if columns.temperature else None,
        currents={joint: table[name] for joint, name in columns.currents.items()},
        supply=table[SUPPLY] if columns.supply else None,
        metadata=metadata,
        name=name,
        origin=origin,
        first_row=first_row,
    )


def _joint_angles(table: Mapping[str, Array], columns: Columns, where: str, first_row: int) -> Array:
    angles = np.empty((len(columns.joints), len(table[TIME])))
    for angle, (name, degrees) in zip(angles, columns.joints, strict=True):
        if degrees:
            check_finite(table[name], (name,), where, first_row)  # under the name it has in the file
            np.deg2rad(table[name], out=angle)
        else:
            angle[:] = table[name]
    return angles.T


def scan_recording(
    path: str | os.PathLike[str],
    batch_rows: int = 65536,
    joints: int | None = None,
) -> RecordingScan:
    """Open a recording to be read in batches.

    Args:
        path: .parquet or .csv. Without metadata it is taken as Renk et al. have it: 9.8 m/s^2, relative field, A465.
        batch_rows: at most so many samples a batch.
        joints: how many joints the arm has; None: six if the metadata's arm is the A465, else not checked.

    Raises:
        RigError: a file that cannot be read, metadata or columns that make no recording.
    """
    if batch_rows < 1:
        raise RigError(f"batch_rows: found {batch_rows}, expected 1 or more")
    table = open_table(path)
    where = str(table.path)
    metadata = Metadata() if table.metadata is None else Metadata.from_text(table.metadata, where)
    if metadata.still_poses and TIME not in table.names:
        table = NumberedTable(table.path, (TIME, *table.names), table.metadata, table.rows, table)
    expected = JOINTS_OF_ARM.get(metadata.arm) if joints is None else joints
    columns = Columns.parse(table.names, where, expected)
    return RecordingScan(table, metadata, columns, batch_rows)


def read_recording(path: str | os.PathLike[str], joints: int | None = None) -> Recording:
    """Read a recording into memory; arguments and errors as of ``scan_recording``."""
    recording = scan_recording(path, joints=joints).read()
    pa.default_memory_pool().release_unused()  # what the file's pages took: arrow would keep it
    return recording


def locked_beside(path: str | os.PathLike[str]) -> Path | None:
    """The locked-arm recording NAME.locked.parquet or .csv beside NAME.parquet or .csv, the same ending first."""
    run = Path(path)
    for suffix in (run.suffix, *SUFFIXES):
        locked = run.with_name(f"{run.stem}.locked{suffix}")
        if locked.is_file():
            return locked
    return None


class RecordingWriter(ExitStack):
    """Write a recording batch by batch in constant memory; the file appears, whole, when the block ends well.

    The first batch decides columns, units and metadata; without a batch there is no file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Nothing is written yet; ``path`` ends in .parquet or .csv."""
        super().__init__()
        self._path = path
        self._first: Recording | None = None
        self._append: Callable[[Mapping[str, Array]], None] | None = None

    def write(self, batch: Recording) -> None:
        """Append a batch.

        Raises:
            RigError: the file cannot be written, or the batch has other columns than the first.
        """
        if self._first is None or self._append is None:
            writer = table_writer(self._path, batch.columns.names, batch.metadata.to_text())
            self._first, self._append = batch, self.enter_context(writer)
        elif batch.columns != self._first.columns:
            raise RigError(
                f"{self._path}: a batch has the columns {', '.join(batch.columns.names)}, "
                f"expected {', '.join(self._first.columns.names)}"
            )
        self._append(batch.table())
