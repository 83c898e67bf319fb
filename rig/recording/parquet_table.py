"""Parquet files with a JSON text under the key ``rig`` of the schema's metadata."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet

from rig.arrays import Array
from rig.errors import RigError
from rig.recording.table import Table, arrow_file, as_float64, readable

KEY: Final = b"rig"

_BUFFER: Final = 1 << 20  # read at a time per column [bytes]


class ParquetTable(Table):
    """A Table in a Parquet file."""

    def batches(self, names: Sequence[str], batch_rows: int) -> Iterator[dict[str, Array]]:
        """As of Table."""
        with ExitStack() as opened:
            with readable(self.path, "Parquet"):
                file = opened.enter_context(_parquet_file(self.path))
                for name in names:
                    _check_numbers(file.schema_arrow.field(name), self.path)
                source = file.iter_batches(batch_size=batch_rows, columns=list(names), use_threads=True)
            while True:
                with readable(self.path, "Parquet"):
                    batch = next(source, None)
                    columns = None if batch is None else {name: as_float64(batch.column(name)) for name in names}
                if columns is None:
                    return
                yield columns


@contextmanager
def _parquet_file(path: Path) -> Iterator[Any]:
    # Without pre_buffer and with a buffer, a column is read as it is decoded: a row group of any size needs no memory.
    with arrow_file(path) as source:
        yield pa.parquet.ParquetFile(source, pre_buffer=False, buffer_size=_BUFFER, page_checksum_verification=True)


def open_parquet(path: Path) -> ParquetTable:
    """Read the footer.

    Raises:
        RigError: not a Parquet file, or not all of one.
    """
    with readable(path, "Parquet"), _parquet_file(path) as file:
        schema = file.schema_arrow
        text = (schema.metadata or {}).get(KEY)
        metadata = None if text is None else text.decode("utf-8")
        return ParquetTable(path, tuple(schema.names), metadata, file.metadata.num_rows)


def _check_numbers(column: Any, path: Path) -> None:
    kind = column.type
    numeric = (pa.types.is_floating, pa.types.is_integer, pa.types.is_decimal, pa.types.is_null)
    if not any(is_kind(kind) for is_kind in numeric):
        raise RigError(f"{path}: column {column.name!r} holds {kind}, expected numbers")
