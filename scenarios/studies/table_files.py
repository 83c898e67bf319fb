"""Tables of a study's folder: written with checksums, and read only if they are what was written."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from rig.errors import RigError, one_line, shown
from rig.files import atomic_path, file_hash

Row = TypeVar("Row")

#: Cells of a table at most; a file of a few bytes can say that it holds any number [cells].
_LARGEST: Final = 1 << 28
_KINDS: Final[Mapping[Any, tuple[type, ...]]] = {float: (float, int), int: (int,), str: (str,), bool: (bool,)}


def write_table(path: Path, table: pa.Table) -> str:
    """Write a Parquet file, whole or not at all; gives its SHA-256 in hexadecimal."""
    with atomic_path(path) as temporary:
        with temporary.open("wb") as sink:
            pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
        return file_hash(temporary)


def read_table(path: Path, wanted: str | None = None) -> pa.Table:
    """Read a table.

    Args:
        path: of the file.
        wanted: its SHA-256, where that is known.

    Raises:
        RigError: the file is missing or is not what was written.
    """
    if not path.is_file():
        raise RigError(f"{path}: is missing, expected a finished study: run it again")
    if wanted is not None and file_hash(path) != wanted:
        raise RigError(f"{path}: is damaged or was changed (another SHA-256): run the study again to mend it")
    with opened_table(path) as file:
        return file.read()


@contextmanager
def opened_table(path: Path) -> Iterator[pq.ParquetFile]:
    """A Parquet file whose pages are checked as they are read.

    Raises:
        RigError: it is damaged, or larger than any table of a study.
    """
    try:
        with path.open("rb") as source:
            file = pq.ParquetFile(source, page_checksum_verification=True)
            rows, columns = file.metadata.num_rows, file.metadata.num_columns
            if rows * columns > _LARGEST:
                raise RigError(f"{path}: found {rows} rows of {columns} columns, expected {_LARGEST} cells at most")
            yield file
    except (pa.ArrowException, OSError, ValueError, KeyError, OverflowError) as error:
        raise RigError(f"{path}: is damaged ({one_line(str(error), 100)}): run the study again to mend it") from error


def rows_of(kind: type[Row], table: pa.Table) -> list[Row]:
    """The rows of a table as a dataclass of numbers and texts, whose fields are its columns.

    Raises:
        RigError: a column is missing or holds something else, or there is no row.
    """
    hints = typing.get_type_hints(kind)
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    if missing := [name for name in names if name not in table.column_names]:
        raise RigError(f"{kind.__name__}: column {missing[0]!r} is missing")
    rows = table.select(names).to_pylist()
    if not rows:
        raise RigError(f"{kind.__name__}: found no row")
    for row in rows:
        for name, value in row.items():
            if not _fits(value, hints[name]):
                raise RigError(f"{kind.__name__}: {name}: found {shown(value)}")
    return [kind(**row) for row in rows]


@contextmanager
def fitting_together(path: Path) -> Iterator[None]:
    """Whatever cannot be made of tables that are well formed, but not of one study, becomes one line."""
    try:
        yield
    except RigError as error:
        if one_line(str(path)) in str(error):
            raise
        raise RigError(f"{path}: no study that can be read: {error}") from error
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, ArithmeticError, pa.ArrowException) as error:
        raise RigError(f"{path}: its tables do not make one study: {one_line(str(error), 120)}") from error


def _fits(value: Any, hint: Any) -> bool:
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        return value in parts
    if origin in (typing.Union, types.UnionType):
        return any(value is None if part is type(None) else _fits(value, part) for part in parts)
    return isinstance(value, _KINDS[hint]) and not (isinstance(value, bool) and hint is not bool)
