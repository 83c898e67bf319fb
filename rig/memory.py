"""How much memory a command may take: stated by its user, else a share of what the machine has left."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Final

from rig.errors import RigError, shown

#: The limit in bytes, for this process and those that it starts.
VARIABLE: Final = "RIG_MEMORY"
_elsewhere: ContextVar[str | None] = ContextVar("memory that is stated elsewhere", default=None)
#: Where the user of this command can state it, in words.
WHERE: Final[ContextVar[str]] = ContextVar("where memory can be stated", default=VARIABLE)
_SHARE: Final = 0.5
_SMALL: Final = 64 << 20  # always there [bytes]
_UNKNOWN: Final = 4 << 30  # left, on a system that does not say [bytes]
_UNITS: Final = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
_SIZE: Final = re.compile(r"(\d{1,9}(?:\.\d{1,3})?) *([KMGT]?)(?:i?B)?", re.IGNORECASE)


def stated() -> str | None:
    """The size that the user has stated, None where there is none."""
    return _elsewhere.get() or os.environ.get(VARIABLE) or None


@contextmanager
def as_stated(size: str | None) -> Iterator[None]:
    """What the user has stated elsewhere, for a worker that was not started by the command."""
    token = _elsewhere.set(size)
    try:
        yield
    finally:
        _elsewhere.reset(token)


def limit_bytes() -> int:
    """What may be taken [bytes].

    Raises:
        RigError: the variable RIG_MEMORY holds no size.
    """
    size = stated()
    return int(_SHARE * _left()) if size is None else parsed(size, VARIABLE)


def parsed(text: str, where: str) -> int:
    """A size such as ``2G``, ``512MiB`` or ``1.5 GB``, in bytes; K, M, G and T are powers of 1024.

    Raises:
        RigError: something else, or below 64 MiB, in which nothing can be done.
    """
    found = _SIZE.fullmatch(text.strip())
    size = 0 if found is None else int(float(found[1]) * _UNITS[found[2].upper()])
    if size < _SMALL:
        raise RigError(f"{where}: found {shown(text)}, expected a size from 64M on, such as 512M or 2G")
    return size


def check_fits(size: float, what: str) -> None:
    """Refuse what would not fit, before it is asked for.

    Args:
        size: memory that it takes [bytes].
        what: with its numbers, for the message.

    Raises:
        RigError: it is more than the limit.
    """
    if not size <= _SMALL and not size <= (limit := limit_bytes()):
        raise RigError(
            f"{what}: takes {written(size)} of memory, expected {written(limit)} at most: state more with"
            f" {WHERE.get()}, or ask for less"
        )


def written(size: float) -> str:
    """A size in words."""
    for unit, bytes_of in (("TiB", 1 << 40), ("GiB", 1 << 30), ("MiB", 1 << 20)):
        if size >= bytes_of:
            return f"{size / bytes_of:.3g} {unit}"
    return f"{size:.0f} bytes"


def _left() -> int:
    """What the machine, or the group that this process is in, has left [bytes]."""
    found = [_UNKNOWN]
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found = [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")] or found
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        found.append(int((group / "memory.max").read_text()) - int((group / "memory.current").read_text()))
    return max(min(found), 0)
