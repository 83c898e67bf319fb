"""Lines of text, CSV or JSON, into columns of numbers; a broken line costs itself only.

Whole chunks go through Arrow's parsers. Where one of them complains the chunk is halved until the broken lines are
alone, so that a million good lines with a bad one among them are still read at full speed.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.json

from rig.arrays import Array
from rig.errors import RigError, nearest, one_line, shown
from rig.recording.columns import TIME, Columns
from rig.recording.csv_table import numbered
from rig.recording.metadata import Metadata
from rig.recording.table import as_float64

#: A line without an end that is longer than this is none of ours [bytes].
LONGEST_LINE: Final = 1 << 16
#: So few lines are looked at one by one.
_FEW: Final = 16
#: What separates cells, the likeliest first.
_DELIMITERS: Final = (b",", b";", b"\t")
_COMMENT: Final = re.compile(rb"#\s*rig\s*:\s*(\{.*\})\s*")
_BLANKS: Final = re.compile(rb"[ \t]+")
#: A column of this name is passed over.
IGNORED: Final = "-"


@dataclass(frozen=True)
class Layout:
    """What the lines hold.

    Attributes:
        names: of the cells in their order, or keys; the time's column may be missing.
        columns: those that make the recording.
        metadata: what the stream says about itself.
        timed: whether the lines hold the time.
    """

    names: tuple[str, ...]
    columns: Columns
    metadata: Metadata
    timed: bool

    @classmethod
    def of(cls, names: Sequence[str], metadata: Metadata, where: str, joints: int | None = None) -> Layout:
        """From the names of a header.

        Raises:
            RigError: as of ``Columns.parse``, but a missing time is none of its.
        """
        kept = [name for name in names if name != IGNORED]
        timed = TIME in kept
        columns = Columns.parse(kept if timed else [TIME, *kept], where, joints)
        return cls(tuple(names), columns, metadata, timed)

    @property
    def wanted(self) -> tuple[str, ...]:
        """The columns that are read from the lines."""
        return self.columns.names if self.timed else self.columns.names[1:]


class LineReader:
    """Bytes in, columns out, in constant memory; the first lines decide the layout.

    Attributes:
        layout: None until it is known.
        broken: lines that were left out so far. example: the first of them.
    """

    def __init__(
        self,
        where: str,
        names: Sequence[str] | None = None,
        metadata: Metadata | None = None,
        joints: int | None = None,
        renamed: Mapping[str, tuple[str, float]] | None = None,
    ) -> None:
        """Nothing is read yet.

        Args:
            where: the source, with which messages begin.
            names: of the cells, of lines without a header.
            metadata: for a stream that says nothing about itself.
            joints: how many the arm has, where that is known.
            renamed: name in the lines -> the recording's name and the factor that makes its unit; others are passed
                over. None: the lines have the recording's names.
        """
        self.layout: Layout | None = None
        self.broken = 0
        self.example = ""
        self._where = where
        self._given = None if names is None else tuple(names)
        self._metadata = metadata
        self._joints = joints
        self._renamed = renamed
        self._keys: dict[str, str] = {}
        self._rest = b""
        self._json = False
        self._delimiter = b","
        self._header = b""

    def restart(self) -> None:
        """The source began anew: what was left of a line is broken, and a header may come again."""
        if self._rest:
            self._spoilt(self._rest)
        self._rest = b""

    def feed(self, data: bytes, last: bool = False) -> dict[str, Array]:
        """The complete lines of ``data`` and of what was left before it, by column; none of them before the header.

        Args:
            data: as many bytes as came.
            last: nothing follows: a last line without an end is complete.

        Raises:
            RigError: the first line is no header, or its columns make no recording.
        """
        data = self._rest + data
        cut = len(data) if last else data.rfind(b"\n") + 1
        self._rest = data[cut:]
        if len(self._rest) > LONGEST_LINE:
            self._spoilt(self._rest)
            self._rest = b""
        whole = data[:cut]
        while whole and self.layout is None:
            line, _, whole = whole.partition(b"\n")
            whole = self._begin(line.strip(b"\r\n \t\xef\xbb\xbf"), whole)
        if not whole.strip() or self.layout is None:
            return {}
        parts = self._parsed(self._cleaned(whole))
        if not parts:
            return {}
        names = self.layout.wanted
        factors = {} if self._renamed is None else dict(self._renamed.values())
        found = {name: np.concatenate([part[name] for part in parts]) for name in names}
        return {
            name: values * factors[name] if factors.get(name, 1.0) != 1.0 else values for name, values in found.items()
        }

    def _begin(self, line: bytes, rest: bytes) -> bytes:
        """One of the first lines; what is left to be read as samples."""
        if not line:
            return rest
        if found := _COMMENT.fullmatch(line):
            if self._metadata is None:
                self._metadata = Metadata.from_text(found[1], self._where)
            return rest
        if line.startswith(b"{"):
            return self._begin_json(line, rest)
        if line.startswith(b"#"):
            return rest
        self._delimiter = next((mark for mark in _DELIMITERS if mark in line), b" ")
        text = self._cells(line).decode("utf-8", "replace")
        try:
            cells = next(csv.reader(io.StringIO(text)), [])
        except csv.Error:
            raise RigError(f"{self._where}: found {shown(text[:40])}, expected lines of text: CSV or JSON") from None
        names = [cell.strip() for cell in cells]
        numeric = all(_is_number(name) for name in names)
        if self._given is not None:
            if len(names) != len(self._given):
                raise RigError(
                    f"{self._where}: found {len(names)} cells in {shown(line.decode('utf-8', 'replace'))},"
                    f" expected the {len(self._given)} of --columns"
                )
            names = list(self._given)
        elif numeric:
            raise RigError(
                f"{self._where}: begins with {shown(line.decode('utf-8', 'replace'))}, expected column names such as"
                " t_s,accel1_V,accel2_V,accel3_V (or --columns)"
            )
        self._start(names)
        if numeric:
            return line + b"\n" + rest
        self._header = self._cells(line)
        return rest

    def _begin_json(self, line: bytes, rest: bytes) -> bytes:
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            self._spoilt(line)
            return rest
        if set(content) == {"rig"}:
            if self._metadata is None:
                self._metadata = Metadata.from_text(json.dumps(content["rig"]), self._where)
            return rest
        self._json = True
        self._start(tuple(content) if self._given is None else self._given)
        return line + b"\n" + rest

    def _start(self, names: Sequence[str]) -> None:
        if self._renamed is not None:
            for name in self._renamed:
                if name not in names:
                    raise RigError(f"{self._where}: has no column {shown(name)}{nearest(name, names)}")
            self._keys = {target: name for name, (target, _) in self._renamed.items()}
            names = [self._renamed.get(name, (IGNORED, 1.0))[0] for name in names]
        metadata = Metadata() if self._metadata is None else self._metadata
        self.layout = Layout.of(names, metadata, self._where, self._joints)

    def _cells(self, line: bytes) -> bytes:
        """A line with commas between its cells."""
        if self._delimiter == b" ":
            return _BLANKS.sub(b",", line.strip(b" \t"))
        return line if self._delimiter == b"," else line.replace(self._delimiter, b",")

    def _cleaned(self, whole: bytes) -> bytes:
        """The same for many lines, without headers and comments that come again."""
        if self._json:
            return whole
        if self._delimiter != b",":
            if self._delimiter == b" ":
                whole = b"\n".join(_BLANKS.sub(b",", line.strip(b" \t\r")) for line in whole.split(b"\n"))
            else:
                whole = whole.replace(self._delimiter, b",")
        if b"#" in whole or (self._header and self._header in whole):
            lines = whole.split(b"\n")
            whole = b"\n".join(line for line in lines if line[:1] != b"#" and line.strip() != self._header)
        return whole

    def _parsed(self, whole: bytes) -> list[dict[str, Array]]:
        """The columns of good lines, in parts."""
        if not whole.strip():
            return []
        try:
            return [self._json_columns(whole) if self._json else self._csv_columns(whole)]
        except (pa.ArrowException, ValueError, KeyError):
            pass
        lines = whole.split(b"\n")
        if lines and not lines[-1]:
            lines.pop()
        if len(lines) > _FEW:
            middle = len(lines) // 2
            return [part for half in (lines[:middle], lines[middle:]) for part in self._parsed(b"\n".join(half))]
        rows = [row for line in lines if line.strip() and (row := self._row(line)) is not None]
        assert self.layout is not None
        table = np.array(rows, dtype=float).reshape(len(rows), len(self.layout.wanted))
        return [dict(zip(self.layout.wanted, table.T, strict=True))] if rows else []

    def _csv_columns(self, whole: bytes) -> dict[str, Array]:
        assert self.layout is not None
        numbers, options = numbered(self.layout.names, self.layout.wanted, max(len(whole), 1))
        table = pa.csv.read_csv(pa.BufferReader(whole), **options)
        return {name: as_float64(table.column(number)) for name, number in numbers.items()}

    def _json_columns(self, whole: bytes) -> dict[str, Array]:
        assert self.layout is not None
        keys = {name: self._keys.get(name, name) for name in self.layout.wanted}
        schema = pa.schema([(key, pa.float64()) for key in keys.values()])
        options = pa.json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore")
        read = pa.json.ReadOptions(use_threads=False, block_size=max(len(whole) + 1, 64))
        table = pa.json.read_json(pa.BufferReader(whole), read_options=read, parse_options=options)
        return {name: as_float64(table.column(key)) for name, key in keys.items()}

    def _row(self, line: bytes) -> list[float] | None:
        """One line's numbers; None, and counted, where it is broken."""
        assert self.layout is not None
        try:
            if self._json:
                content = json.loads(line)
                return [float(content[self._keys.get(name, name)]) for name in self.layout.wanted]
            cells = line.split(b",")
            if len(cells) == len(self.layout.names):
                values = dict(zip(self.layout.names, cells, strict=True))
                return [float(values[name]) for name in self.layout.wanted]
        except (ValueError, KeyError, TypeError, RecursionError):
            pass
        self._spoilt(line)
        return None

    def _spoilt(self, line: bytes) -> None:
        self.broken += 1
        if not self.example:
            self.example = one_line(line[:200].decode("utf-8", "replace"), 80)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
