"""Work of a library that may never come back, and is deaf to signals meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

_STUCK: Final = "stuck"
_LOOK_S: Final = 0.1


def in_time(work: Callable[[], None], patience_s: float) -> None:
    """Do it in a thread of its own, so that signals are heard.

    Args:
        work: what to do; raises what it raises.
        patience_s: how long to wait for it [s].

    Raises:
        TimeoutError: it has not come back; the thread stays.
    """
    failed: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=guarded, daemon=True)
    thread.start()
    waited = 0.0
    while thread.is_alive() and waited < patience_s:
        thread.join(_LOOK_S)
        waited += _LOOK_S
    if thread.is_alive():
        thread.name = _STUCK
        raise TimeoutError(f"nothing came of it in {patience_s:g} s")
    if failed:
        raise failed[0]


def is_stuck() -> bool:
    """Whether some work has never come back: the process cannot end but by ``os._exit``."""
    return any(thread.name == _STUCK for thread in threading.enumerate())
