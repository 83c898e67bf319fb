"""Text tables as they come: delimiter, decimal comma, comments and header are found by looking."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping as Table
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from rig.arrays import Array
from rig.documents import check_ordinary
from rig.errors import RigError, shown

_DELIMITERS: Final = (";", "\t", ",", "|")
_LOOKED_AT: Final = 1 << 16  # bytes
_COMMENTS: Final = ("#", "%", "//")
_NUMBER: Final = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|nan|-?inf", re.IGNORECASE)
_NOT_A_NUMBER: Final = re.compile(r"CSV column #(\d+): .*invalid value '(.*)'", re.DOTALL)
_MISSING: Final = ("", "nan", "NaN", "NA", "null", "-")
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Log:
    """One table of a log: a text file, or a topic of a bag.

    Attributes:
        name: for messages: the file, or file and topic.
        columns: name -> (n,) numbers; NaN where a cell is empty.
        said: how it was read, in words.
        rate_Hz: of transforms, the rate at which they came; inf: at the readings' own instants.
        unread: name -> what is no number, in words, of columns that hold such cells; where most are numbers, the column
            is among ``columns`` all the same, NaN in these cells.
    """

    name: str
    columns: dict[str, Array]
    said: str = ""
    rate_Hz: float | None = None
    unread: Table[str, str] = field(default_factory=dict)


def read_text_log(path: Path) -> Log:
    """A CSV or TSV file as it comes.

    Raises:
        RigError: it cannot be read, is no text, or has no table of numbers.
    """
    check_ordinary(path, "a table of numbers")
    try:
        with path.open("rb") as file:
            head = file.read(_LOOKED_AT)
    except OSError as error:
        raise RigError(f"{path}: cannot be read: {error.strerror}") from error
    if not head.strip() or b"\0" in head:
        raise RigError(f"{path}: is {'empty' if not head.strip() else 'no text'}, expected a table of numbers")
    encoding = _encoding(head)
    lines = head.decode(encoding, errors="replace").splitlines()
    if len(head) == _LOOKED_AT:
        if len(lines) == 1:
            raise RigError(f"{path}: has a line of more than {_LOOKED_AT} bytes, expected a table of numbers")
        lines = lines[:-1]
    comments = 0
    while comments < len(lines) and (not lines[comments].strip() or lines[comments].lstrip().startswith(_COMMENTS)):
        comments += 1
    body = lines[comments : comments + 50]
    if not body:
        raise RigError(f"{path}: found comments only, expected a table of numbers")
    delimiter = _delimiter(body)
    cells = [_cells(line, delimiter) for line in body]
    first = next(
        (row for row, line in enumerate(cells) if line and all(map(_NUMBER.fullmatch, filter(None, line)))), -1
    )
    if first < 0:
        raise RigError(f"{path}: found no line of numbers among the first {len(cells)}{_no_number(cells[-1])}")
    width = len(cells[first])
    names = _names(cells[:first], lines[:comments], delimiter, width)
    comma = delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell) for line in cells[first:] for cell in line)
    table, unread = _numbers(path, delimiter, comments + first, names, comma, encoding)
    words = {"\t": "tabs", None: "blanks"}.get(delimiter, f"{delimiter!r}")
    said = f"separated by {words}{', decimal comma' if comma else ''}{'' if first else ', no header'}"
    return Log(str(path), table, said, unread=unread)


def _encoding(head: bytes) -> str:
    """UTF-8, or where the head of a file is none what spreadsheets in Western Europe write."""
    try:
        head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        cut = len(head) == _LOOKED_AT and error.start > len(head) - 4  # amid a character
        return "utf-8-sig" if cut else "cp1252"
    return "utf-8-sig"


def _no_number(cells: list[str]) -> str:
    """What a line holds instead of numbers, and what was expected, in words."""
    cell = next((cell for cell in cells if cell and not _NUMBER.fullmatch(cell)), "")
    found = f": the last of them holds {shown(cell)}" if cell else ""
    try:
        datetime.fromisoformat(cell)
    except ValueError:
        return f"{found}, expected a table of numbers"
    return f"{found}, expected times in seconds"


def _delimiter(lines: list[str]) -> str | None:
    """The delimiter that splits most lines into the same number of cells, more than one; None: blanks."""
    best: tuple[int, int, str | None] = (0, 0, None)
    for order, delimiter in enumerate(_DELIMITERS):
        counts = [len(_cells(line, delimiter)) for line in lines]
        common = max(set(counts), key=counts.count)
        if common > 1 and (counts.count(common), -order) > best[:2]:
            best = (counts.count(common), -order, delimiter)
    return best[2]


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def _names(header: list[list[str]], comments: list[str], delimiter: str | None, width: int) -> list[str]:
    """The columns' names: of the header, with a second line of units; of the last comment; else numbers."""
    named = [line for line in header if len(line) == width]
    if not named and comments:
        words = _cells(comments[-1].lstrip().lstrip("#%/ "), delimiter)
        named = [words] if len(words) == width else []
    if not named:
        return [f"column{number}" for number in range(1, width + 1)]
    names = named[0]
    if len(named) > 1:
        names = [f"{name} [{unit.strip('[]()')}]" if unit else name for name, unit in zip(*named[:2], strict=True)]
    unique: dict[str, int] = {}
    result = []
    for number, name in enumerate(names, start=1):
        name = name or f"column{number}"
        unique[name] = unique.get(name, 0) + 1
        result.append(name if unique[name] == 1 else f"{name}.{unique[name]}")
    return result


def _numbers(
    path: Path, delimiter: str | None, skipped: int, names: list[str], comma: bool, encoding: str
) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns that hold numbers, others, such as texts, left out; and of all others a cell that is no number."""
    if delimiter is None:
        try:
            values = np.loadtxt(path, skiprows=skipped, ndmin=2, encoding=encoding)
        except ValueError as error:
            raise RigError(f"{path}: not a table of numbers: {' '.join(str(error).split())[:120]}") from error
        return dict(zip(names, np.ascontiguousarray(values.T), strict=False)), {}
    try:
        with path.open("rb") as file:  # Arrow itself opens no name that is not UTF-8
            table = pa.csv.read_csv(
                file,
                read_options=pa.csv.ReadOptions(skip_rows=skipped, column_names=names, use_threads=False),
                parse_options=pa.csv.ParseOptions(delimiter=delimiter, invalid_row_handler=lambda row: "error"),
                convert_options=pa.csv.ConvertOptions(decimal_point="," if comma else ".", null_values=list(_MISSING)),
            )
    except (pa.ArrowInvalid, OSError) as error:
        if bad := _NOT_A_NUMBER.search(str(error)):
            raise RigError(f"{path}: {names[int(bad[1])]} holds {shown(bad[2])}, expected a number") from error
        raise RigError(f"{path}: not a whole table: {' '.join(str(error).split())[:120]}") from error
    found, unread = {}, {}
    for name, column in zip(names, table.columns, strict=True):
        if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            found[name] = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=float)
        elif pa.types.is_null(column.type):
            unread[name] = "is empty"
        else:
            values, unread[name] = _mixed(_texts(column), comma)
            if 2 * np.isfinite(values).sum() > len(values) - column.null_count:
                found[name] = values
    if not found:
        raise RigError(f"{path}: found no column of numbers among {', '.join(names[:8])}")
    return found, unread


def _texts(column: pa.ChunkedArray) -> pa.StringArray:
    """The cells as texts; bytes that are no UTF-8 as a mark."""
    if not pa.types.is_binary(column.type):
        return column.cast(pa.string()).combine_chunks()
    return pa.array(
        [None if cell is None else cell.decode("utf-8", "replace") for cell in column.to_pylist()], pa.string()
    )


def _mixed(cells: pa.StringArray, comma: bool) -> tuple[Array, str]:
    """The numbers of a column with texts, NaN where there is none; and the first text, in words."""
    number = pc.match_substring_regex(cells, rf"(?i)^\s*(?:{_NUMBER.pattern})\s*$")
    numbers = pc.if_else(number, pc.utf8_trim_whitespace(cells), None)
    values = pc.cast(pc.replace_substring(numbers, ",", ".") if comma else numbers, pa.float64())
    row = pc.index(pc.fill_null(number, True), False).as_py()
    return np.asarray(values.to_numpy(zero_copy_only=False), dtype=float), (
        f"holds {shown(cells[max(row, 0)].as_py())} in row {max(row, 0)} (first row 0)"
    )
