"""Tables of numbers with one JSON text of metadata, opened by the ending of their names and written in batches.

Memory does not grow with the number of rows, in either direction.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from rig.arrays import Array
from rig.errors import RigError, nearest
from rig.files import atomic_path
from rig.recording.csv_table import csv_head, open_csv
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


@contextmanager
def table_writer(
    path: str | os.PathLike[str], names: Sequence[str], metadata: str, rows: int | None = None
) -> Iterator[Callable[[Mapping[str, Array]], None]]:
    """Write a table batch by batch; the file appears, whole, when the block ends well.

    Args:
        path: ending in .parquet or .csv.
        names: of the columns.
        metadata: one line of JSON, an object.
        rows: how many are to come, where that is known; lets a reader of the CSV notice that its end is missing.

    Yields:
        What appends rows: called with every column of the table, all of one length. Where the disk is full or gone it
        raises an OSError, which is a RigError at the end of the block.

    Raises:
        RigError: another ending, or the folder does not exist or cannot be written to.
    """
    file = Path(path)
    parquet = checked_suffix(file) == ".parquet"
    schema = pa.schema([(name, pa.float64()) for name in names], metadata={KEY: metadata.encode()})
    comment = metadata if rows is None else json.dumps({**json.loads(metadata), "rows": rows})
    with atomic_path(file) as temporary, temporary.open("wb") as sink:
        if parquet:
            opened: Any = pa.parquet.ParquetWriter(sink, schema, write_page_checksum=True)
        else:
            sink.write(csv_head(comment, names))
            opened = pa.csv.CSVWriter(sink, schema, write_options=pa.csv.WriteOptions(include_header=False))
        grouped = {"row_group_size": _ROW_GROUP} if parquet else {}
        with opened as writer:

            def append(columns: Mapping[str, Array]) -> None:
                arrays = [from_float64(columns[name]) for name in names]
                writer.write_batch(pa.record_batch(arrays, schema=schema), **grouped)

            yield append
