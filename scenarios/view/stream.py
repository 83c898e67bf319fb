"""An .rrd file for the viewer, written by the viewer's own library: whole or not at all, and in bounded time."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import rerun as rr
from rerun.chunk import RrdReader

from rig.arrays import Array
from rig.errors import RigError, one_line
from rig.files import atomic_path
from rig.patience import in_time

#: The name that the viewer keeps layouts under.
APPLICATION: Final = "torusrig"
#: The library's writer may wait for ever, and is deaf to signals.
_PATIENCE_S: Final = 120.0
_CLOSING_S: Final = 10.0

#: The one timeline of a view: the recording's time in seconds.
TIMELINE: Final = "t"


def at(t: Array) -> list[rr.TimeColumn]:
    """The index of ``send_columns`` for rows at times (m,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=t)]


def new_stream(application: str) -> rr.RecordingStream:
    """A stream under the name that the viewer keeps its layouts by.

    Raises:
        RigError: logging is switched off in the environment.
    """
    stream = rr.RecordingStream(application)
    if not rr.is_enabled(stream):
        raise RigError("the rerun logger is switched off: found RERUN=off in the environment, expected it unset")
    return stream


@contextmanager
def written_stream(path: str | os.PathLike[str]) -> Iterator[rr.RecordingStream]:
    """A stream into an .rrd file, which takes its name when the block ends well and the file can be read back.

    Raises:
        RigError: the file cannot be written whole or not in time, or logging is switched off in the environment.
    """
    with atomic_path(path) as temporary:
        name = _in_utf8(path, temporary)
        stream = new_stream(APPLICATION)
        try:
            _in_time(lambda: stream.save(name), path, temporary)
            yield stream
            _in_time(lambda: stream.flush(timeout_sec=_PATIENCE_S), path, temporary)
        except BaseException:
            with suppress(RigError):
                _in_time(stream.disconnect, path, temporary, _CLOSING_S)
            raise
        _in_time(stream.disconnect, path, temporary)  # writes the file's footer
        _in_time(lambda: _read_back(name), path, temporary)


def _in_utf8(path: str | os.PathLike[str], temporary: Path) -> str:
    """The temporary file by the name that the library takes, whatever the locale's letters are."""
    try:
        return os.fsencode(temporary).decode("utf-8")
    except UnicodeDecodeError:
        raise RigError(f"{path}: the viewer's files need a folder whose name is UTF-8, found another") from None


def _in_time(
    work: Callable[[], None], path: str | os.PathLike[str], temporary: Path, patience_s: float = _PATIENCE_S
) -> None:
    try:
        in_time(work, patience_s)
    except Exception as error:  # the library has no error class of its own
        size = temporary.stat().st_size if temporary.exists() else 0
        why = one_line(str(error), 100).replace(str(temporary), "the file")
        raise RigError(f"{path}: cannot be written whole (is the disk full?): {size} bytes were; {why}") from error


def _read_back(file: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # without its end a file is read with a warning
        reader = RrdReader(file)
        for _ in reader.stream():
            pass
