"""What the two kinds of tables on disk have in common, and one without times, whose rows are numbered."""

from __future__ import annotations

import csv
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from rig.arrays import Array
from rig.errors import RigError, one_line
from rig.recording.columns import TIME

SUFFIXES: Final = (".parquet", ".csv")

#: What the library and the decoders raise on a damaged file.
_COMPLAINTS: Final = (
    pa.ArrowException,
    OSError,
    ValueError,
    KeyError,
    IndexError,
    OverflowError,
    csv.Error,
)


@dataclass(frozen=True)
class Table(ABC):
    """A table on disk.

    Attributes:
        path: the file.
        names: of all columns, in order.
        metadata: the JSON text; None where there is none.
        rows: how many there are; None where the file has to be read to know.
    """

    path: Path
    names: tuple[str, ...]
    metadata: str | None
    rows: int | None

    @abstractmethod
    def batches(self, names: Sequence[str], batch_rows: int) -> Iterator[dict[str, Array]]:
        """The named columns, at most ``batch_rows`` rows at a time, as float64; a missing value is a NaN.

        Raises:
            RigError: a damaged file, or a column that does not hold numbers.
        """


def checked_suffix(path: Path) -> str:
    """The ending that tells the format.

    Raises:
        RigError: another ending.
    """
    suffix = path.suffix.casefold()
    if suffix not in SUFFIXES:
        raise RigError(f"{path}: unknown ending {path.suffix!r}, expected {' or '.join(SUFFIXES)}")
    return suffix


def as_float64(column: Any) -> Array:
    """An Arrow array of numbers as (n,) float64, without a copy where it is one; a missing value is a NaN.

    Neither this nor ``from_float64`` calls Arrow's own converters, which load pandas where it is installed, with half a
    second and 50 MiB.
    """
    if column.type != pa.float64():
        column = column.cast(pa.float64(), safe=False)  # integers beyond 2^53 are rounded
    if not len(column):
        return np.empty(0)
    if isinstance(column, pa.ChunkedArray):
        column = pa.concat_arrays(column.chunks) if column.num_chunks > 1 else column.chunk(0)
    if column.null_count:
        column = column.fill_null(np.nan)
    return np.asarray(np.from_dlpack(column), dtype=np.float64)


def from_float64(values: Array) -> Any:
    """Numbers (n,) as an Arrow array, without a copy where they are contiguous."""
    numbers = np.ascontiguousarray(values, dtype=np.float64)
    return pa.Array.from_buffers(pa.float64(), len(numbers), [None, pa.py_buffer(numbers)])


def arrow_file(path: Path) -> Any:
    """A file for Arrow to read: by the bytes of its name, which may be no UTF-8; a text could be taken for a URL."""
    return pa.OSFile(os.fsencode(path))


@contextmanager
def readable(path: Path, kind: str) -> Iterator[None]:
    """Whatever the library makes of a damaged file becomes one line."""
    try:
        yield
    except RigError:
        raise
    except MemoryError as error:  # Arrow's is one, too: nothing is wrong with the file
        raise RigError(f"{path}: not enough memory to read it: {one_line(str(error), 120)}") from error
    except PermissionError as error:
        raise RigError(f"{path}: cannot be read: {error.strerror}") from error
    except _COMPLAINTS as error:
        raise RigError(f"{path}: is not a whole {kind} file: {one_line(str(error), 120)}") from error


@dataclass(frozen=True)
class NumberedTable(Table):
    """A table of poses held still, with a column of times that counts its rows from 0; ``table``: without it."""

    table: Table

    def batches(self, names: Sequence[str], batch_rows: int) -> Iterator[dict[str, Array]]:
        """As of ``Table.batches``; ``names`` hold the time and one column or more of the table."""
        row = 0
        for batch in self.table.batches([name for name in names if name != TIME], batch_rows):
            count = len(next(iter(batch.values())))
            yield {TIME: np.arange(row, row + count, dtype=float), **batch}
            row += count
