"""Where the trials of a study run: in this process, in local processes, or on a Dask cluster that is already there.

All three are a ``concurrent.futures.Executor``. A trial is a plain function of the study's settings and of its own
number, so it does not matter which worker makes it, in which order, or how often.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final, TypeVar

from rig.errors import RigError
from scenarios.processes import WorkerPool

Settings = TypeVar("Settings")
Result = TypeVar("Result")
Trial = Callable[[Settings, int], Result]

#: So many times a pool of processes is made anew after one of them has died; more is a fault, not an accident.
_RESTARTS: Final = 3
_CLUSTER_TIMEOUT_S: Final = 20.0
#: So long a cluster may be without any worker.
_DESERTED_S: Final = 60.0


@dataclass(frozen=True)
class Workers:
    """Where to run.

    Attributes:
        processes: local processes; 0 is this process itself, None one for each processor.
        cluster: address of a Dask scheduler, ``tcp://host:port``; then ``processes`` has no meaning.

    Raises:
        RigError: a negative number of processes.
    """

    processes: int | None = None
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.processes is not None and self.processes < 0:
            raise RigError(f"workers: found {self.processes}, expected zero (this process) or more")

    def completed(
        self, trial: Trial[Settings, Result], settings: Settings, numbers: Collection[int]
    ) -> Iterator[tuple[int, Result]]:
        """Every number with the result of its trial, as they are done.

        Args:
            trial: a function of a module that the workers can import.
            settings: the same for all; small, as it is sent with every trial.
            numbers: of the trials to be made.

        Raises:
            RigError: processes keep dying, the cluster cannot be reached, its workers have another version, or what
                the trial itself raises.
        """
        if self.cluster is not None:
            yield from _on_cluster(self.cluster, trial, settings, numbers)
        elif self.processes == 0 or not numbers:
            with _InProcess() as executor:
                yield from _windowed(executor, 1, trial, settings, list(numbers))
        else:
            count = min(self.processes or _processors(), len(numbers))
            yield from _in_processes(count, trial, settings, list(numbers))


class _InProcess(Executor):
    """Does at once what is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def _windowed(
    executor: Executor,
    window: int,
    trial: Trial[Settings, Result],
    settings: Settings,
    numbers: list[int],
    waiting: Callable[[], None] = lambda: None,
    cancel: bool = True,
) -> Iterator[tuple[int, Result]]:
    """Submit no more than ``window`` at a time, so that little is lost or held when the study is ended.

    Args:
        executor, window, trial, settings, numbers: what, where, and how many at a time.
        waiting: called about once a second while nothing is done.
        cancel: what is still to be done when the study is ended.
    """
    left = iter(numbers)
    pending: dict[Future[Result], int] = {}

    def submit() -> None:
        for number in left:
            pending[executor.submit(trial, settings, number)] = number
            if len(pending) >= window:
                return

    try:
        submit()
        while pending:
            done, _ = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED)
            if not done:
                waiting()
            for future in sorted(done, key=pending.__getitem__):
                number = pending.pop(future)
                yield number, future.result()
            submit()
    finally:
        if cancel:
            for future in pending:
                future.cancel()


def _in_processes(
    count: int, trial: Trial[Settings, Result], settings: Settings, numbers: list[int]
) -> Iterator[tuple[int, Result]]:
    """A pool that is made anew, for what is left, when one of its processes has been killed."""
    left = set(numbers)
    for restart in range(_RESTARTS + 1):
        pool = WorkerPool(count)
        try:
            # Its processes are told to end, which breaks the pool; Python's pool stumbles over work cancelled before.
            for number, result in _windowed(pool, 2 * count, trial, settings, sorted(left), cancel=False):
                left.discard(number)
                yield number, result
            return
        except BrokenProcessPool as error:
            if restart == _RESTARTS:
                raise RigError(
                    f"workers: a process died {restart + 1} times (killed, or out of memory?); finished trials are"
                    " kept: run the same command again, with fewer --workers"
                ) from error
        except BaseException:
            pool.give_up()
            raise
        finally:
            pool.shutdown(wait=False)


def _on_cluster(
    address: str, trial: Trial[Settings, Result], settings: Settings, numbers: Collection[int]
) -> Iterator[tuple[int, Result]]:
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
        try:
            yield from _windowed(executor, 2 * threads, trial, settings, sorted(numbers), deserted)
        except KilledWorker as error:
            raise RigError(f"cluster {address}: a trial's workers died one after the other; {_KEPT}") from error
        except (CancelledError, CommClosedError) as error:
            raise RigError(f"cluster {address}: the connection was lost; {_KEPT}") from error
        finally:
            executor.shutdown(wait=False)


_KEPT: Final = "finished trials are kept: run the same command again"


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


def package_version() -> str:
    """The version of this package; "unknown" where it runs from its sources without being installed."""
    try:
        return version("torusrig")
    except PackageNotFoundError:
        return "unknown"


def _processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
