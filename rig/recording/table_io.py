"""Tables of numbers with one JSON text of metadata, opened by the ending of their names and written in batches.

Memory does not grow with the number of rows, in either direction.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from rig.arrays import Array
from rig.errors import RigError, nearest
from rig.files import atomic_path
from rig.recording.csv_table import open_csv
from rig.recording.parquet_table import KEY, open_parquet
from rig.recording.table import Table, checked_suffix, from_float64

_ROW_GROUP: Final = 1 << 20  # at most so many rows


def open_table(path: str | os.PathLike[str]) -> Table:
    """Open a Parquet or CSV file, by the ending of its name.

    Raises:
        RigError: no such file, a folder, another ending, a file that is empty, truncated or not what its name says.
    """
    path = Path(path)
    suffix = checked_suffix(path)
    if path.is_dir():
        raise RigError(f"{path}: is a folder, expected a recording")
    try:
        size = path.stat().st_size
    except FileNotFoundError:
        beside = os.listdir(path.parent) if path.parent.is_dir() else []
        raise RigError(f"{path}: no such file{nearest(path.name, beside)}") from None
    except (OSError, ValueError) as error:
        raise RigError(f"{path}: cannot be read: {error}") from error
    if size == 0:
        raise RigError(f"{path}: is empty, expected a recording")
    return open_parquet(path) if suffix == ".parquet" else open_csv(path)


class TableWriter:
    """Write a table batch by batch; the file appears, whole, when the block ends well."""

    def __init__(
        self, path: str | os.PathLike[str], names: Sequence[str], metadata: str, rows: int | None = None
    ) -> None:
        """Nothing is written yet.

        Args:
            path: ending in .parquet or .csv.
            names: of the columns.
            metadata: one line of JSON, an object.
            rows: how many are to come, where that is known; lets a reader of the CSV notice that its end is missing.

        Raises:
            RigError: another ending.
        """
        self._path = Path(path)
        self._suffix = checked_suffix(self._path)
        self._schema = pa.schema([(name, pa.float64()) for name in names], metadata={KEY: metadata.encode()})
        self._comment = metadata if rows is None else json.dumps({**json.loads(metadata), "rows": rows})
        self._opened = ExitStack()

    def __enter__(self) -> Self:
        """Open a temporary file beside the one to be written.

        Raises:
            RigError: the folder does not exist or cannot be written to.
        """
        with ExitStack() as opened:
            temporary = opened.enter_context(atomic_path(self._path))
            if self._suffix == ".parquet":
                sink: Any = opened.enter_context(temporary.open("wb"))
                writer = pa.parquet.ParquetWriter(sink, self._schema, write_page_checksum=True)
            else:
                sink = opened.enter_context(temporary.open("wb"))
                sink.write(f"# rig: {self._comment}\n{','.join(self._schema.names)}\n".encode())
                options = pa.csv.WriteOptions(include_header=False)
                writer = pa.csv.CSVWriter(sink, self._schema, write_options=options)
            self._writer = opened.enter_context(writer)
            self._opened = opened.pop_all()
        return self

    def write(self, columns: Mapping[str, Array]) -> None:
        """Append rows; ``columns`` has every column of the table, all of one length.

        Raises:
            OSError: the disk is full or gone; at the end of the block it is a RigError.
        """
        arrays = [from_float64(columns[name]) for name in self._schema.names]
        batch = pa.record_batch(arrays, schema=self._schema)
        if self._suffix == ".parquet":
            self._writer.write_batch(batch, row_group_size=_ROW_GROUP)
        else:
            self._writer.write_batch(batch)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the file its name, or remove it if the block did not end well."""
        self._opened.__exit__(kind, error, trace)
