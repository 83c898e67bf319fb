"""How a good file becomes a bad one, by what it is: text, table or bytes, each in ways of its own."""

from __future__ import annotations

import contextlib
import io
import json
import random
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

NUMBERS: Final = (
    *("0", "-0", "1e308", "-1e308", "1e999", "5e-324", "nan", "inf", "-1", "3", "true", "null", '""', "[]", "{}", "''"),
    *("9" * 400, "0x" + "f" * 300, "1" * 5000, "1_000", "٣", "1e-400", "2147483648", "9223372036854775808", "-1e-12"),
)
TEXTS: Final = (
    *("", "\x1b[31m", "\x00", "a" * 100_000, "é", "\ud800", "../../x", "/etc/passwd", "$HOME", "\r\n", "\n" * 50),
    *("[" * 5000, "{" * 5000, "a." * 3000, '"' * 50, "#", "NaN", "none", "q1_rad,", "mag1_uT", "accel1_V", "t_s"),
    *("Infinity", "<!--", "-"),
)
#: Of JSON.
VALUES: Final = (None, True, -1, 0, 2**70, 1e308, float("nan"), "", "../x", [], {}, [[]], [None])
_NUMBER: Final = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_WORD: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


def mutated_text(text: str, rng: random.Random) -> bytes:
    """One to three changes of a text."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        text = rng.choice(_TEXT_WAYS)(text, rng)
    return text.encode("utf-8", "surrogatepass")


def mutated_bytes(content: bytes, rng: random.Random) -> bytes:
    """Flipped, lost, doubled or foreign bytes."""
    data = bytearray(content)
    way = rng.randrange(6)
    at = rng.randrange(max(len(data), 1))
    if way <= 1 and data:
        for _ in range(rng.choice((1, 1, 8, 200))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif way == 2:
        del data[at:]
    elif way == 3:
        del data[at : at + rng.choice((1, 10, 1000))]
    elif way == 4:
        data[at:at] = rng.randbytes(rng.choice((1, 4, 300)))
    else:
        data[at:at] = data[max(0, at - rng.choice((4, 100, 5000))) : at]
    return bytes(data)


def _numbers(text: str, rng: random.Random) -> str:
    return _replaced(_NUMBER, text, rng, rng.choice(NUMBERS))


def _words(text: str, rng: random.Random) -> str:
    words = _WORD.findall(text) or [""]
    return _replaced(_WORD, text, rng, rng.choice((*TEXTS, rng.choice(words), rng.choice(words))))


def _replaced(pattern: re.Pattern[str], text: str, rng: random.Random, by: str) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return by
    chosen = rng.choice(found)
    return f"{text[: chosen.start()]}{by}{text[chosen.end() :]}"


def _lines(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(4)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(other, lines[at])
    elif way == 2:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        del lines[at:]
    return "\n".join(lines)


def _letters(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return f"{text[:at]}{rng.choice(TEXTS)}{text[at + rng.choice((0, 1, 5)) :]}"


_TEXT_WAYS: Final = (_numbers, _numbers, _numbers, _words, _words, _lines, _letters)


def mutated_table(table: pa.Table, rng: random.Random) -> pa.Table:
    """A column lost, doubled, renamed, of another type, or with values that occur."""
    names = table.column_names
    index = rng.randrange(len(names))
    values = table.column(index).to_numpy().copy()
    way = rng.randrange(9) if values.dtype.kind == "f" else rng.choice((0, 1, 2, 7))
    if way == 0:
        return table.remove_column(index)
    if way == 1:
        return table.append_column(names[index], table.column(index))
    if way == 2:
        return table.rename_columns(
            [rng.choice(TEXTS)[:2000].replace("\ud800", "") if n == index else name for n, name in enumerate(names)]
        )
    if way == 3:
        kind = rng.choice((pa.string(), pa.int64(), pa.float32(), pa.bool_()))
        column = [None if rng.random() < 0.1 else str(v) for v in values] if kind == pa.string() else values.astype(int)
        with contextlib.suppress(pa.ArrowException):
            return table.set_column(index, names[index], pa.array(column).cast(kind, safe=False))
        return table
    if way == 4:
        values[rng.randrange(len(values))] = rng.choice((np.nan, np.inf, 1e308, -1e308, 5e-324, 1e18))
    elif way == 5:
        values[:] = rng.choice((0.0, values[0], 1e308, 1e-320, -1.0))
    elif way == 6:
        values = values * rng.choice((1e300, 1e-300, -1.0, 1e9, 0.0))
    elif way == 7:
        return table.slice(0, rng.choice((0, 1, 2, 5, 13, 40)))
    else:
        values = table.column(rng.randrange(len(names))).to_numpy().copy()
    return table.set_column(index, names[index], pa.array(values))


def text_of(path: Path, rng: random.Random) -> bytes:
    """A spoilt text file, one time in five by its bytes."""
    if rng.random() < 0.2:
        return mutated_bytes(path.read_bytes(), rng)
    return mutated_text(path.read_text(), rng)


def bytes_of(path: Path, rng: random.Random) -> bytes:
    """A file of which nothing is known but its bytes."""
    return mutated_bytes(path.read_bytes(), rng)


def document_of(path: Path, rng: random.Random) -> bytes:
    """A spoilt JSON document, half the time by one of its values, which are lost, doubled or become another's."""
    if rng.random() < 0.5:
        return text_of(path, rng)
    document = json.loads(path.read_text())
    places = list(_places(document))
    for _ in range(rng.choice((1, 1, 2))):
        holder, key = rng.choice(places)
        other, its = rng.choice(places)
        way = rng.randrange(4)
        if way == 0 and isinstance(holder, dict):
            holder.pop(key, None)
        elif way == 1 and isinstance(holder, list):
            holder.insert(key, holder[key] if key < len(holder) else None)
        elif way == 2:
            with contextlib.suppress(LookupError):  # lost already
                holder[key] = json.loads(json.dumps(other[its]))
        else:
            with contextlib.suppress(LookupError):
                holder[key] = rng.choice(VALUES)
    return json.dumps(document).encode()


def _places(document: Any) -> Iterator[tuple[Any, Any]]:
    """Every value of a document, by what holds it and its key there."""
    items: Iterable[tuple[Any, Any]] = ()
    if isinstance(document, dict | list):
        items = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in items:
        yield document, key
        yield from _places(value)


def table_of(path: Path, rng: random.Random) -> bytes:
    """A spoilt Parquet file, by its bytes or by what it holds."""
    if rng.random() < 0.4:
        return mutated_bytes(path.read_bytes(), rng)
    table = pq.read_table(path)
    metadata = dict(table.schema.metadata or {})
    if rng.random() < 0.3 and b"rig" in metadata:
        metadata[b"rig"] = mutated_text(metadata[b"rig"].decode(), rng)
        table = table.replace_schema_metadata(metadata)
    else:
        table = mutated_table(table, rng).replace_schema_metadata(metadata)
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()
