"""Signals that ask the command to end: it cleans up, says so in one line, and ends with the status that shells expect.

What was ignored when the command was started (``nohup``, a background job) stays ignored.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

#: Signal -> what is said.
WORDS: Final = {
    number: words
    for name, words in (("SIGINT", "interrupted"), ("SIGTERM", "terminated"), ("SIGHUP", "hung up"))
    if (number := getattr(signal, name, None)) is not None
}
_AGAIN_S: Final = 0.5  # so long a raised end may be lost in a library's clean-up
_IMPORTED_S: Final = 0.02

_wanted: int | None = None
_ended = False


class Ending(KeyboardInterrupt):
    """The process is asked to end by the signal ``number``; to libraries it is Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def debugging() -> bool:
    """Whether errors are to be raised, not told: the environment says RIG_DEBUG=1."""
    return os.environ.get("RIG_DEBUG", "") not in ("", "0")


def install() -> None:
    """Have these signals end the command in order; to be called in the main thread, before anything is imported."""
    for number in WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _asked)
    if hasattr(signal, "SIGALRM"):
        signal.signal(signal.SIGALRM, _reminded)
    sys.unraisablehook = _unraisable


@contextmanager
def heard() -> Iterator[None]:
    """Says and ends what comes before the command line is read: after the imports, during which an end waits."""
    install()
    try:
        yield
    except Ending as early:
        print(f"rig: {WORDS[early.number]}", file=sys.stderr, flush=True)
        os._exit(128 + early.number)


def ended() -> None:
    """All is cleaned up and said: from now on a signal ends the process at once."""
    global _ended
    _ended = True
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _asked(number: int, frame: FrameType | None) -> None:
    global _wanted
    if _ended:
        os._exit(128 + number)
    _wanted = _wanted or number
    _raise(frame)


def _reminded(number: int, frame: FrameType | None) -> None:
    if _wanted is not None and not _ended:
        _raise(frame)


def _raise(frame: FrameType | None) -> None:
    """End, unless that is under way; not in the middle of an import or of the start of a process, which would leave
    half a module or half a process."""
    assert _wanted is not None
    can_wait = hasattr(signal, "setitimer")
    if _cleaning_up():
        return
    if can_wait and _indivisible(frame):
        signal.setitimer(signal.ITIMER_REAL, _IMPORTED_S)
        return
    if can_wait:  # some libraries swallow what is raised inside of them
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S, _AGAIN_S)
    raise Ending(_wanted)


def _cleaning_up() -> bool:
    """Whether the end is on its way through ``finally`` and ``except``."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, Ending):
        error = error.__context__
    return error is not None


def _indivisible(frame: FrameType | None) -> bool:
    while frame is not None:
        code = frame.f_code
        if code.co_filename.startswith("<frozen importlib"):
            return True
        if code.co_name == "start" and frame.f_globals.get("__name__") == "multiprocessing.process":
            return True
        frame = frame.f_back
    return False


def _unraisable(found: Any) -> None:
    """An end that fell into a destructor is raised again; anything else there is for programmers."""
    if not isinstance(found.exc_value, Ending) and debugging():
        sys.__unraisablehook__(found)
