"""Where work runs: in this process, in local processes, or on a Dask cluster that is already there.

A trial, one draw of a study or one recording to diagnose, is a plain function of settings and of its own number, so it
does not matter which worker makes it, in which order, or how often.
"""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.synchronize import Event
from typing import Any, Final, Generic, TypeVar

from rig.errors import RigError
from scenarios.version import package_version

Item = TypeVar("Item")
Result = TypeVar("Result")
#: What stands for an item at which its worker dies, even with nothing beside it.
Lost = Callable[[int], Result]

_CLUSTER_TIMEOUT_S: Final = 20.0
#: So long a cluster may be without any worker.
_DESERTED_S: Final = 60.0
#: What a terminal sends to all processes of a command alike.
_FOR_PARENT: Final = tuple(
    number for name in ("SIGINT", "SIGHUP") if (number := getattr(signal, name, None)) is not None
)
#: So often a process looks whether its work is still wanted.
_WATCH_S: Final = 0.2
#: Of pools given up: a process that is still starting opens it, and would say that it is gone.
_GIVEN_UP: Final[list[Event]] = []
_KEPT: Final = "what is finished is kept: run the same command again"


@dataclass(frozen=True)
class Workers:
    """Where to run.

    Attributes:
        processes: local processes; 0 is this process itself, None one for each processor.
        cluster: address of a Dask scheduler, ``tcp://host:port``; then ``processes`` has no meaning.

    Raises:
        RigError: a negative number of processes, or both.
    """

    processes: int | None = None
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.processes is not None and self.cluster is not None:
            raise RigError("--cluster and a number of processes: found both, expected one of them")
        if self.processes is not None and self.processes < 0:
            raise RigError(f"workers: found {self.processes}, expected zero (this process) or more")

    def at_once(self, count: int) -> int:
        """How many of so many trials may run on one machine at the same time, sharing its memory.

        Raises:
            RigError: the cluster cannot be reached.
        """
        if self.cluster is None:
            return max(1, min(processors() if self.processes is None else self.processes, count))
        with _client(self.cluster) as client:
            threads: dict[str, int] = {}
            for worker in client.scheduler_info(n_workers=-1)["workers"].values():
                threads[worker["host"]] = threads.get(worker["host"], 0) + worker["nthreads"]
        return max(1, min(max(threads.values(), default=1), count))

    def completed(
        self, work: Callable[[Item], Result], items: Sequence[Item], lost: Lost[Result] | None = None
    ) -> Iterator[tuple[int, Result]]:
        """The place of every item with what is made of it, as they are done.

        What was under way when a worker died is done again, one after the other: which of them did it, alone tells.

        Args:
            work: a function of a module that the workers can import, or a ``partial`` of one with what is the same for
                all; small, as it is sent with every item.
            items: such as the numbers of trials.
            lost: what stands for an item whose worker dies even alone, by its place; which ends all else by default.

        Raises:
            RigError: an item's worker died twice, the cluster cannot be reached, its workers have another version, or
                what the work itself raises.
        """
        own = _Work(work, items, lost)
        if self.cluster is not None:
            yield from _on_cluster(self.cluster, own)
        elif self.processes == 0 or not items:
            for place, item in enumerate(items):
                yield place, work(item)
        else:
            yield from _in_processes(min(self.processes or processors(), len(items)), own)


@dataclass(frozen=True)
class _Work(Generic[Item, Result]):
    """As of ``Workers.completed``."""

    function: Callable[[Item], Result]
    items: Sequence[Item]
    lost: Lost[Result] | None

    def given_up(self, place: int, why: str) -> Result:
        if self.lost is None:
            raise RigError(f"workers: trial {self.items[place]}: {why}; {_KEPT}, with fewer workers")
        return self.lost(place)


def _windowed(
    executor: Executor,
    window: int,
    work: _Work[Item, Result],
    numbers: Collection[int],
    deaths: tuple[type[Exception], ...],
    died: list[int],
    waiting: Callable[[], None] = lambda: None,
) -> Iterator[tuple[int, Result]]:
    """Submit no more than ``window`` at a time, so that little is lost or held when the work is ended.

    Args:
        executor, window: where, and how many at a time. work, numbers: what, and the places of its items.
        deaths: what is raised where a worker died. died: gets the places of what was under way then.
        waiting: called about once a second while nothing is done.
    """
    left = iter(numbers)
    pending: dict[Future[Result], int] = {}
    breaks = isinstance(executor, WorkerPool)  # as a whole, with one of its processes

    def submit() -> None:
        while len(pending) < window and not (breaks and died):
            number = next(left, None)
            if number is None:
                return
            try:
                pending[executor.submit(work.function, work.items[number])] = number
            except deaths:
                return

    try:
        submit()
        while pending:
            done, _ = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED)
            if not done:
                waiting()
            for future in sorted(done, key=pending.__getitem__):
                number = pending.pop(future)
                try:
                    result = future.result()
                except deaths:
                    died.append(number)
                else:
                    yield number, result
            submit()
    finally:
        if not breaks:  # Python's pool stumbles over work cancelled before it breaks
            for future in pending:
                future.cancel()


def _in_processes(count: int, work: _Work[Item, Result]) -> Iterator[tuple[int, Result]]:
    """A pool that is made anew, for what is left, when one of its processes has been killed."""
    left = set(range(len(work.items)))
    suspects: list[int] = []
    while left:
        pool = WorkerPool(1 if suspects else count)
        window, wanted = (1, suspects) if suspects else (2 * count, sorted(left))
        died: list[int] = []
        try:
            for number, result in _windowed(pool, window, work, wanted, (BrokenProcessPool,), died):
                left.discard(number)
                yield number, result
        except BaseException:
            pool.give_up()  # its processes are told to end, which breaks it
            raise
        finally:
            pool.shutdown(wait=False)
        if suspects:
            for number in died:
                left.discard(number)
                yield number, work.given_up(number, "its process was killed twice (out of memory?)")
            suspects = [number for number in suspects if number in left]
        else:
            suspects = died


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
        _GIVEN_UP.append(self._given_up)


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


def _on_cluster(address: str, work: _Work[Item, Result]) -> Iterator[tuple[int, Result]]:
    with _client(address) as client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise RigError(f"cluster {address}: has no worker, expected at least one")
        _check_versions(client, address)
        alone = 0.0

        def deserted() -> None:
            nonlocal alone
            alone = 0.0 if client.scheduler_info(n_workers=-1)["workers"] else alone + 1.0
            if alone > _DESERTED_S:
                raise RigError(f"cluster {address}: has had no worker for {_DESERTED_S:g} s; {_KEPT}")

        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker

        executor = client.get_executor(pure=False)

        def run(window: int, wanted: Collection[int], died: list[int]) -> Iterator[tuple[int, Result]]:
            return _windowed(executor, window, work, wanted, (KilledWorker,), died, deserted)

        try:
            suspects: list[int] = []
            yield from run(2 * threads, range(len(work.items)), suspects)
            died: list[int] = []
            yield from run(1, suspects, died)
            for number in died:
                yield number, work.given_up(number, f"its workers on {address} died one after the other")
        except (CancelledError, CommClosedError) as error:
            raise RigError(f"cluster {address}: the connection was lost; {_KEPT}") from error
        finally:
            executor.shutdown(wait=False)


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError as error:
        raise RigError("--cluster needs Dask: install it with pip install 'torusrig[cluster]'") from error
    try:
        get_address_host_port(address, strict=True)  # a client made with no proper address hangs when it goes
        client = Client(address, timeout=_CLUSTER_TIMEOUT_S, set_as_default=False, name="torusrig")
    except (OSError, ValueError) as error:
        raise RigError(f"cluster {address}: no Dask scheduler answers, expected one at tcp://host:port") from error
    with client:
        yield client


def _check_versions(client: Any, address: str) -> None:
    try:
        found = client.run(package_version)
    except ImportError as error:
        raise RigError(
            f"cluster {address}: a worker cannot import torusrig ({error}), expected it installed"
        ) from error
    for worker, other in found.items():
        if other != package_version():
            raise RigError(f"cluster {address}: worker {worker} has torusrig {other}, expected {package_version()}")


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
