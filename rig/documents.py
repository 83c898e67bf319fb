"""Text files that somebody else may have written, read with bounded time and memory: JSON and TOML."""

from __future__ import annotations

import json
import math
import os
import re
import stat
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from rig.errors import RigError, nearest, one_line, shown

#: A document of this project is far smaller [bytes].
LARGEST_DOCUMENT: Final = 16 << 20
_LARGEST_TOML: Final = 1 << 20
_MOST_DIGITS: Final = 308  # more do not fit a floating-point number
_DEEPEST: Final = 32

# So many names with dots between them: reading a dotted key takes memory with the square of their number.
_DEEP_KEY: Final = re.compile(
    rf"""(?<![A-Za-z0-9_-])(?>(?>[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_DEEPEST}}}"""
)


def read_bytes(path: str | os.PathLike[str], expected: str, largest: int = LARGEST_DOCUMENT) -> bytes:
    """A file's content.

    Args:
        path: of the file.
        expected: what it should be, for messages.
        largest: size of the file [bytes].

    Raises:
        RigError: no such file, a folder, too large, or it cannot be read.
    """
    file = Path(path)
    check_ordinary(file, expected)
    try:
        with file.open("rb") as opened:
            content = opened.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a zero in its name
        raise RigError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(content) > largest:
        raise RigError(f"{file}: found {file.stat().st_size} bytes, expected {expected} of at most {largest}")
    return content


def check_ordinary(file: Path, expected: str) -> None:
    """Refuse what is no ordinary file: a pipe or a device would be waited for.

    Raises:
        RigError: no such file, a folder, or something else.
    """
    try:
        if not os.path.lexists(file):
            beside = os.listdir(file.parent) if file.parent.is_dir() else []
            raise RigError(f"{file}: no such file, expected {expected}{nearest(file.name, beside)}")
        if not stat.S_ISREG(mode := file.stat().st_mode):
            found = "is a folder" if stat.S_ISDIR(mode) else "is no ordinary file"
            raise RigError(f"{file}: {found}, expected {expected}")
    except (OSError, ValueError) as error:  # ValueError: a zero in its name
        raise RigError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def read_json(path: str | os.PathLike[str], expected: str, largest: int = LARGEST_DOCUMENT) -> Any:
    """A JSON file; as ``read_bytes`` and ``parse_json``."""
    return parse_json(read_bytes(path, expected, largest), str(path), expected)


def parse_json(text: str | bytes, where: str, expected: str = "JSON") -> Any:
    """JSON with finite numbers only, and each key of an object once.

    Args:
        text: UTF-8 where it is bytes.
        where: the file, with which messages begin.
        expected: what it should be, for messages.

    Raises:
        RigError: not JSON, nested too deep, a key twice, or a number beyond the floating-point range.
    """
    if isinstance(text, bytes):
        text = _decoded(text, where, expected)
    try:
        return json.loads(
            text, object_pairs_hook=_once, parse_constant=_refuse_constant, parse_float=_finite, parse_int=_integer
        )
    except _TwiceError as error:
        raise RigError(f"{where}: key {error} occurs twice in one object, expected once") from error
    except RecursionError as error:
        raise RigError(f"{where}: is not JSON that can be read: nested too deep, expected {expected}") from error
    except ValueError as error:
        raise RigError(f"{where}: is not JSON: {one_line(str(error), 120)}; expected {expected}") from error


def plain(value: Any) -> Any:
    """A value as JSON has it: arrays, tuples and NumPy's numbers as Python's, null for what is not finite, and objects
    as their ``to_json`` says."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def read_toml(path: str | os.PathLike[str], expected: str) -> str:
    """The text of a TOML file, not larger than any of this project's, without a byte order mark; as ``read_bytes``, and
    RigError where it is no UTF-8 text."""
    return _decoded(read_bytes(path, expected, _LARGEST_TOML), str(path), expected)


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """TOML with integers of at most 64 bits, as its standard has them.

    Args:
        text: of the file.
        where: the file, with which messages begin.

    Raises:
        RigError: not TOML, keys of more than 32 parts, or nested too deep.
    """
    if len(text) > _LARGEST_TOML:
        raise RigError(f"{where}: found {len(text)} letters, expected TOML of at most {_LARGEST_TOML}")
    if found := _DEEP_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise RigError(f"{where}: line {line} has a key of {_DEEPEST} parts or more, expected fewer")
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise RigError(f"{where}: nested too deep, expected TOML") from error
    except ValueError as error:
        raise RigError(f"{where}: not TOML: {one_line(str(error), 160)}") from error
    for value in _leaves(content):
        if isinstance(value, int) and value.bit_length() > 63:
            raise RigError(f"{where}: found an integer of {value.bit_length()} bits, expected at most 64")
    return content


def _decoded(content: bytes, where: str, expected: str) -> str:
    try:
        return content.decode("utf-8-sig")  # some editors put a mark of the byte order first
    except UnicodeDecodeError as error:
        raise RigError(f"{where}: not UTF-8 text (byte {error.start}), expected {expected}") from error


def _leaves(content: Any) -> Iterator[Any]:
    left = [content]
    while left:
        value = left.pop()
        if isinstance(value, dict):
            left.extend(value.values())
        elif isinstance(value, list):
            left.extend(value)
        else:
            yield value


class _TwiceError(Exception):
    """A key, of which one value would have been lost."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise _TwiceError(shown(next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)))
    return found


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is not JSON")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{one_line(text, 40)} is beyond the floating-point range")
    return number


def _integer(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"an integer of {len(text)} digits is beyond the floating-point range")
    return int(text)
