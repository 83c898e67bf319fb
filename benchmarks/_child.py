"""A call in a fresh process: with its peak memory, and with limits on memory and time, so that no benchmark takes the
machine down."""

from __future__ import annotations

import json
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

_MIB: Final = 1024 * 1024
#: Runs a command from a small process: a child's peak begins with the memory of the process that it was forked from.
_SMALL: Final = """
import json, resource, subprocess, sys, time
begun = time.perf_counter()
status = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
unit = 2**20 if sys.platform == "darwin" else 2**10
spent = {"seconds": time.perf_counter() - begun, "cpu_s": used.ru_utime + used.ru_stime}
print(json.dumps({"status": status, **spent, "peak_MiB": used.ru_maxrss / unit}))
"""


@dataclass(frozen=True)
class Spent:
    """What a command took."""

    status: int
    seconds: float
    cpu_s: float
    peak_MiB: float


def spent_by(command: Sequence[str], **options: Any) -> Spent:
    """Run a command, its output thrown away.

    Args:
        options: as of ``subprocess.run``.
    """
    done = subprocess.run([sys.executable, "-c", _SMALL, *command], stdout=subprocess.PIPE, check=True, **options)
    return Spent(**json.loads(done.stdout))


@dataclass(frozen=True)
class Outcome:
    """What came of a call.

    Attributes:
        result: what it returned; None where it did not.
        seconds: that it took, without the process's start and imports; infinite where it did not return.
        peak_MiB: largest memory in use of the whole process, interpreter and imports included; infinite if over
            the limit.
        problem: why there is no result.
    """

    result: Any
    seconds: float
    peak_MiB: float
    problem: str | None = None


def in_child(call: Callable[..., Any], *arguments: Any, most_MiB: int = 3072, most_s: float = 120.0) -> Outcome:
    """Call a module's function with picklable arguments in a fresh process.

    Args:
        most_MiB, most_s: of memory and time, after which it is ended.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(there, call, arguments, most_MiB))
    process.start()
    there.close()
    try:
        if not here.poll(most_s + 30.0):  # the start and the imports have time of their own
            return Outcome(None, float("inf"), float("nan"), f"more than {most_s:g} s")
        try:
            outcome: Outcome = here.recv()
        except EOFError:
            return Outcome(None, float("inf"), float("inf"), "ended without a result")
        return outcome
    finally:
        if process.is_alive():
            process.join(5.0)
        if process.is_alive():
            process.kill()
        process.join()
        here.close()


def _serve(answer: Connection, call: Callable[..., Any], arguments: tuple[Any, ...], most_MiB: int) -> None:
    _limit_memory(most_MiB)
    begun = time.perf_counter()
    try:
        result = call(*arguments)
    except MemoryError:
        answer.send(Outcome(None, float("inf"), float("inf"), f"more than {most_MiB} MiB"))
        return
    except Exception as error:
        answer.send(Outcome(None, float("inf"), peak_MiB(), f"{type(error).__name__}: {error}"))
        return
    answer.send(Outcome(result, time.perf_counter() - begun, peak_MiB()))


def _limit_memory(most_MiB: int) -> None:
    if sys.platform.startswith("linux"):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (most_MiB * _MIB, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def peak_MiB() -> float:
    """Largest memory in use of this process so far; NaN where the system does not say."""
    status = Path("/proc/self/status")  # without that of the process that it was forked from
    if status.exists():
        return int(status.read_text(encoding="ascii").partition("VmHWM:")[2].split()[0]) / 1024.0
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak) / (_MIB if sys.platform == "darwin" else 1024.0)
