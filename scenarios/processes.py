"""Processes that work for a command: they end with it, and leave to it what it has to say."""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.synchronize import Event
from typing import Any, Final

#: What a terminal sends to all processes of a command alike.
_FOR_PARENT: Final = tuple(
    number for name in ("SIGINT", "SIGHUP") if (number := getattr(signal, name, None)) is not None
)
#: So often a process looks whether its work is still wanted.
_WATCH_S: Final = 0.2


class WorkerPool(ProcessPoolExecutor):
    """A pool whose processes end with their parent, however that ends, and leave signals to it.

    They are spawned, not forked: the same on every system, and safe beside the threads of a progress bar.
    """

    def __init__(self, processes: int) -> None:
        """So many processes, started as they are needed."""
        context = get_context("spawn")
        self._given_up = context.Event()
        super().__init__(processes, mp_context=context, initializer=_begin, initargs=(self._given_up,))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As of every executor; a process that is started is deaf to signals from its first moment."""
        with _signals_held():
            return super().submit(fn, *args, **kwargs)

    def give_up(self) -> None:
        """Nobody wants the work any more: the processes end at once, in the middle of it."""
        self._given_up.set()


@contextmanager
def _signals_held() -> Iterator[None]:
    """What is started meanwhile inherits it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _FOR_PARENT)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(given_up: Event) -> None:
    """The first thing in a process. Without the watch it would finish its work before it ends, or, with its parent
    killed, wait for more of it for ever."""
    for number in _FOR_PARENT:
        signal.signal(number, signal.SIG_IGN)
    warnings.simplefilter("ignore")  # what a library tells its programmer is not for the user
    parent = parent_process()

    def watch() -> None:
        while (parent is None or parent.is_alive()) and not given_up.wait(_WATCH_S):
            pass
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
