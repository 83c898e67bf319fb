"""CSV files whose first line may be ``# rig: {json}``."""

from __future__ import annotations

import codecs
import csv
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

import pyarrow as pa
import pyarrow.csv

from rig.arrays import Array
from rig.documents import parse_json
from rig.errors import RigError, shown
from rig.recording.table import Table, arrow_file, as_float64, from_float64, readable

pa.enable_signal_handlers(False)  # its own would hold Ctrl-C back until a block is parsed, or lose it

_COMMENT: Final = re.compile(r"#\s*rig\s*:\s*(.*)", re.DOTALL)
_LONGEST_LINE: Final = 1 << 20  # of metadata and names [bytes]
_BLOCK: Final = 1 << 19  # parsed at a time, of which the parser reads up to 32 ahead [bytes]

# The parser's complaints that deserve better words.
_NOT_A_NUMBER: Final = re.compile(r"CSV column #(\d+): (?:Row #(\d+): )?.*invalid value '(.*)'", re.DOTALL)
_CELL_COUNT: Final = re.compile(r"(?:Row #(\d+): )?Expected (\d+) columns, got (\d+)")


@dataclass(frozen=True)
class CsvTable(Table):
    """A Table in a CSV file; its rows begin at the byte ``start``, and were so many when written, if that is known."""

    start: int
    rows_written: int | None

    def batches(self, names: Sequence[str], batch_rows: int) -> Iterator[dict[str, Array]]:
        """As of Table; the rows are parsed in blocks of bytes, so that there may be fewer of them than asked for."""
        if self.path.stat().st_size == self.start:
            return
        rows = 0
        for columns in self._blocks(names):
            count = len(columns[names[0]])
            for first in range(0, count, batch_rows):
                yield {name: column[first : first + batch_rows] for name, column in columns.items()}
            rows += count
        if self.rows_written is not None and rows < self.rows_written and not _ends_with_newline(self.path):
            raise RigError(f"{self.path}: is truncated: found {rows} rows, expected {self.rows_written}")

    def _blocks(self, names: Sequence[str]) -> Iterator[dict[str, Array]]:
        wanted, options = numbered(self.names, names, _BLOCK)
        with self._data() as file:
            with self._checked():
                source = pa.csv.open_csv(file, **options)
            while True:
                with self._checked():
                    batch = next(source, None)
                    columns = None if batch is None else {n: as_float64(batch.column(c)) for n, c in wanted.items()}
                if columns is None:
                    return
                yield columns

    def _data(self) -> Any:
        with readable(self.path, "CSV"):
            file = arrow_file(self.path)
            file.seek(self.start)
            return file

    @contextmanager
    def _checked(self) -> Iterator[None]:
        """Say which row and column a complaint of the parser is about."""
        with readable(self.path, "CSV"):
            try:
                yield
            except pa.ArrowInvalid as error:
                if found := _NOT_A_NUMBER.search(str(error)):
                    column, line, text = found.groups()
                    name = self.names[int(column)]
                    raise RigError(f"{self.path}: {name}{_row(line)} holds {shown(text)}, expected a number") from error
                if found := _CELL_COUNT.search(str(error)):
                    line, expected, cells = found.groups()
                    what = f"found {cells} cells{_row(line)}, expected {expected}"
                    raise RigError(f"{self.path}: is truncated or damaged: {what}") from error
                if "straddling object" in str(error):
                    raise RigError(f"{self.path}: has a row of more than {_BLOCK} bytes, expected numbers") from error
                if "Empty CSV" in str(error):  # nothing but blank lines
                    raise RigError(f"{self.path}: has no samples") from error
                raise


def numbered(names: Sequence[str], wanted: Sequence[str], block: int) -> tuple[dict[str, str], dict[str, Any]]:
    """How Arrow reads some columns as float64: by their numbers, as names that are not wanted may occur twice.

    Args:
        names: of all columns. wanted: of those to be read. block: parsed at a time [bytes].

    Returns:
        Name -> number in what is read; Arrow's options.
    """
    every = {name: str(index) for index, name in enumerate(names)}
    numbers = {name: every[name] for name in wanted}
    return numbers, {
        "read_options": pa.csv.ReadOptions(
            column_names=list(map(str, range(len(names)))), block_size=block, use_threads=False
        ),
        "convert_options": pa.csv.ConvertOptions(
            include_columns=list(numbers.values()), column_types=dict.fromkeys(numbers.values(), pa.float64())
        ),
    }


def csv_head(metadata: str, names: Sequence[str]) -> bytes:
    """The two lines that a recording begins with: its metadata, one line of JSON, and the names of its columns."""
    return f"# rig: {metadata}\n{','.join(names)}\n".encode()


def csv_lines(columns: Mapping[str, Array]) -> bytes:
    """The lines of some samples, by column (n,)."""
    rows = pa.record_batch([from_float64(values) for values in columns.values()], names=list(columns))
    sink = pa.BufferOutputStream()
    pa.csv.write_csv(rows, sink, pa.csv.WriteOptions(include_header=False))
    return bytes(sink.getvalue())


def _row(line: str | None) -> str:
    return "" if line is None else f" in row {int(line) - 1} (first row 0)"


def open_csv(path: Path) -> CsvTable:
    """Read the metadata and the names.

    Raises:
        RigError: a first line that is neither, or a file that is not text.
    """
    with readable(path, "CSV"), path.open("rb") as file:
        line = _line(file, path).removeprefix("\ufeff")
        metadata = rows = None
        if line.startswith("#"):
            if not (found := _COMMENT.fullmatch(line)):
                raise RigError(f"{path}: begins with {shown(line)}, expected '# rig: {{json}}' or the column names")
            metadata = found[1].strip()
            rows = _rows_written(metadata)
            line = _line(file, path)
        names = tuple(name.strip() for name in next(csv.reader([line], skipinitialspace=True), []))
        # How many rows there are is not known before reading: lines may have been taken away with good reason.
        return CsvTable(path, names, metadata, None, file.tell(), rows)


def _line(file: BinaryIO, path: Path) -> str:
    line = file.readline(_LONGEST_LINE)
    if line.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise RigError(f"{path}: is UTF-16 text, expected a CSV file in UTF-8")
    if len(line) == _LONGEST_LINE or b"\0" in line:
        raise RigError(f"{path}: is not a CSV file: no line of column names at its beginning")
    if b"\r" in line.rstrip(b"\r\n"):
        raise RigError(
            f"{path}: its lines end with a carriage return alone, expected line feeds; rig import reads them"
        )
    try:
        return line.decode("utf-8").rstrip("\r\n")
    except UnicodeDecodeError as error:
        where = f"byte {error.start} of a line at its beginning"
        raise RigError(f"{path}: not UTF-8 text ({where}), expected CSV") from error


def _rows_written(metadata: str) -> int | None:
    try:
        content = parse_json(metadata, "")
    except RigError:
        return None  # complained about by whoever needs the metadata
    rows = content.get("rows") if isinstance(content, dict) else None
    return rows if isinstance(rows, int) else None


def _ends_with_newline(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"
