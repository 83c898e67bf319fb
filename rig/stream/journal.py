"""The stream on disk: appended to a CSV as it comes, and closed into Parquet at the end."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from rig.errors import RigError
from rig.recording import Metadata, Recording, RecordingWriter, scan_recording
from rig.recording.csv_table import csv_head, csv_lines

#: The disk is told to keep what it has at least so often [s].
_SYNCED_S: Final = 1.0


class Journal:
    """A recording that grows.

    Whole lines are handed to the system as they come, so that a process that is killed loses none that it has written;
    the disk is told once a second, for the day when the power fails.

    Attributes:
        path: the recording to be made. csv: what it is while it grows.
        total: samples in it.
    """

    def __init__(self, path: Path, metadata: Metadata, resumed: bool = False) -> None:
        """Nothing is written before the first batch.

        Args:
            path: the recording to be made, .parquet or .csv; until it is closed it is a .csv of the same name.
            metadata: of the recording.
            resumed: go on with the one that is there.
        """
        self.path = path
        self.csv = path.with_suffix(".csv")
        self.total = 0
        self._metadata = metadata
        self._resumed = resumed
        self._file: Any = None
        self._names: tuple[str, ...] = ()
        self._synced = 0.0

    def write(self, batch: Recording) -> None:
        """Append samples.

        Raises:
            RigError: the disk is full or gone, or the batch has other columns than the recording.
        """
        if self._file is None:
            self._open(batch)
        if batch.columns.names != self._names:
            raise RigError(f"{self.csv}: found other columns than {', '.join(self._names)}")
        self._append(memoryview(csv_lines(batch.table())))
        self.total += len(batch)

    def _open(self, batch: Recording) -> None:
        self._names = batch.columns.names
        try:
            if self._resumed:
                self._file = self.csv.open("ab", buffering=0)
                return
            self._file = self.csv.open("xb", buffering=0)
        except FileExistsError:
            raise RigError(f"{self.csv}: is there already: expected --resume to go on with it, or another -o") from None
        except OSError as error:
            raise RigError(f"{self.csv}: cannot be written: {error.strerror}") from error
        self._append(memoryview(csv_head(self._metadata.to_text(), self._names)))

    def _append(self, lines: memoryview) -> None:
        """All of them or none: a full disk takes a part before it refuses the rest."""
        whole = os.fstat(self._file.fileno()).st_size
        try:
            while lines:
                lines = lines[self._file.write(lines) :]
            self._sync(_SYNCED_S)
        except BaseException as error:
            with suppress(OSError):
                self._file.truncate(whole)
            if isinstance(error, OSError):
                raise self._refused(error) from error
            raise

    def _refused(self, error: OSError) -> RigError:
        size = os.fstat(self._file.fileno()).st_size
        return RigError(f"{self.csv}: cannot be written: {error.strerror} after {size} bytes, which are kept")

    def _sync(self, after_s: float) -> None:
        if (now := time.monotonic()) - self._synced > after_s:
            os.fsync(self._file.fileno())
            self._synced = now

    def close(self) -> Path | None:
        """Close the recording: a Parquet file takes the CSV's place, if that was asked for; None without a sample."""
        if self._file is not None:
            try:
                self._sync(0.0)
            except OSError as error:
                raise self._refused(error) from error
            finally:
                self._file.close()
                self._file = None
            if not self.total and not self._resumed:
                self.csv.unlink()
        if not self.csv.is_file():
            return None
        if self.path.suffix == ".parquet":
            with RecordingWriter(self.path) as writer:
                for batch in scan_recording(self.csv, joints=-1 if self._metadata.arm != "a465" else None):
                    writer.write(batch)
            self.csv.unlink()
        return self.path


def mended(path: Path) -> int:
    """Cut what a crash left of a last line; returns how many bytes that was.

    Raises:
        RigError: no such file.
    """
    try:
        with path.open("r+b") as file:
            size = file.seek(0, os.SEEK_END)
            back = min(size, 1 << 16)
            file.seek(size - back)
            keep = size - back + file.read(back).rfind(b"\n") + 1
            file.truncate(keep)
            return size - keep
    except OSError as error:
        raise RigError(f"{path}: cannot be resumed: {error.strerror}") from error
