"""Hostile files made of good ones, and what every command must do with them.

``python tests/fuzzing.py SECONDS [SEED [NAME]]`` runs for as long as it is told, of calls whose name has NAME in it;
with RIG_FUZZ_KEEP=DIR what was complained about is kept there.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

from hostile_calls import CALLS, Call, a_loop, make_good, make_more, quietly

LONGEST: Final = 300
PATIENCE_S: Final = 60
#: Numbers that a worker tries.
_LIFE: Final = 2000
#: Of a worker that cannot even be interrupted.
_SILENCE_S: Final = 20.0 * PATIENCE_S
#: More memory than this for files of less than a megabyte is a complaint [bytes].
_MEMORY: Final = 3 << 30


def complaint_about(call: Call, good: Path, rng: random.Random) -> str:
    """What a command did wrong with a spoilt file; "" where nothing. The file is kept as ``spoilt`` in that case."""
    with tempfile.TemporaryDirectory(prefix="rig-fuzz-") as name:
        folder = Path(name)
        shutil.copytree(good, folder, dirs_exist_ok=True)
        (folder / "out.csv").unlink(missing_ok=True)
        spoilt = call.spoil(good / call.file, rng)
        (folder / call.file).write_bytes(spoilt)
        if call.forge is not None:
            call.forge(folder / call.file)
        wrong = _wrong(call, folder)
        if wrong and (keep := os.environ.get("RIG_FUZZ_KEEP")):
            Path(keep).mkdir(exist_ok=True)
            (Path(keep) / f"{abs(hash(spoilt)):x}-{Path(call.file).name}").write_bytes(spoilt)
        return f"{call.name}: rig {' '.join(call.arguments)}: {wrong}" if wrong else ""


def _wrong(call: Call, folder: Path) -> str:
    from scenarios.cli._app import run

    before = _files(folder)
    _forget_peak()
    with quietly(folder) as told:
        try:
            with _in_time():
                status = run(list(call.arguments))
        except _TooLong:
            return f"took more than {PATIENCE_S} s"
        except BaseException as error:
            return f"raised {type(error).__name__}: {error}"
    lines = told[1].getvalue().splitlines()
    if status not in (0, 1, 2):
        return f"exit status {status}: {lines[-1] if lines else ''}"
    if status == 2 and sum(line.startswith("rig: ") for line in lines) not in (1, 2):  # a remark may come first
        return f"{len(lines)} lines: {told[1].getvalue()[:500]}"
    if any(len(line) >= LONGEST or not line.isprintable() for line in lines):
        return f"a line of {max(map(len, lines))} letters: {max(lines, key=len)[:500]!r}"
    told[0].flush()
    printed = told[0].buffer.getvalue()  # type: ignore[attr-defined]
    if foreign := re.search(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]", printed):
        return f"prints {foreign[0]!r}"
    if (peak := _peak()) > _MEMORY:
        return f"took {peak / 1e9:.1f} GB"
    after = _files(folder)
    changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    if status == 2 and changed and not call.keeps:
        return f"left or changed {changed}"
    if any(".rig-" in name or "MUJOCO_LOG" in name for name in changed):
        return f"left temporaries {changed}"
    return ""


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    """Names, with size and time of those that are files."""
    found = {}
    for path in folder.rglob("*"):
        about = path.stat()
        found[str(path.relative_to(folder))] = (about.st_size, about.st_mtime_ns) if path.is_file() else (0, 0)
    return found


def _forget_peak() -> None:
    """Count the peak of memory from here (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """Memory [bytes] at most since then; 0 where it is not known."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    return 0


class _TooLong(BaseException):
    """Not one that anything catches."""


@contextlib.contextmanager
def _in_time() -> Iterator[None]:
    """So much of the processor's time, or twenty times as much of the clock's: the machine may be busy."""
    begun = time.process_time()
    alarms = 0

    def late(number: int, frame: FrameType | None) -> None:
        nonlocal alarms
        alarms += 1
        if time.process_time() - begun > PATIENCE_S or alarms == 20:
            raise _TooLong
        signal.alarm(PATIENCE_S)

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def call_of(number: int, calls: Sequence[Call] = CALLS) -> Call | None:
    """The calls by turns, the slow ones every so many rounds; None: passed over."""
    round_, place = divmod(number, len(calls))
    return calls[place] if (round_ + place) % calls[place].slow == 0 else None


def work(good: Path, seed: int, first: int, name: str) -> None:
    """Try inputs from a number on; a line for each on stdout: number, seconds, what went wrong. At last one with null:
    libraries keep threads of their own, so that a worker is not to grow old."""
    import traceback
    import warnings

    from scenarios.cli import _app
    from validation.loop import run as played

    def told(error: Exception) -> int:
        traceback.print_exception(error, limit=-3, file=sys.__stderr__)
        return _app.BUG

    _app._bug = told
    played.trial = a_loop
    warnings.simplefilter("ignore")
    sys.unraisablehook = lambda found: None  # as the command has it
    out = os.fdopen(os.dup(1), "w")
    calls = [call for call in CALLS if name in call.name]
    for number in range(first, first + _LIFE):
        if (call := call_of(number, calls)) is not None:
            begun = time.process_time()
            wrong = complaint_about(call, good, random.Random(f"{seed} {number}"))
            print(json.dumps([number, time.process_time() - begun, wrong]), file=out, flush=True)
    print("null", file=out, flush=True)


def main() -> int:
    """Run for so many seconds; print what went wrong. What crashes or cannot be interrupted ends a worker only."""
    seconds, seed = float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    name = sys.argv[3] if len(sys.argv) > 3 else ""
    calls = [call for call in CALLS if name in call.name]
    tried, complaints, took = 0, 0, Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        make_good(Path(folder))
        make_more(Path(folder))
        end, first = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            arguments = [sys.executable, __file__, "--work", folder, str(seed), str(first), name]
            number = first - 1
            with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as worker:
                ended = False
                for said in _told(worker, end):
                    if ended := said is None:
                        break
                    number, spent, wrong = said
                    call = call_of(number, calls)
                    assert call is not None
                    took[call.name] += spent
                    tried += 1
                    if wrong:
                        complaints += 1
                        print(f"{seed} {number}: {wrong}", flush=True)
                worker.kill()
            if ended:
                first += _LIFE
            elif time.monotonic() < end:
                first = next(after for after in itertools.count(number + 1) if call_of(after, calls)) + 1
                complaints += 1
                print(f"{seed} {first - 1}: {call_of(first - 1, calls)}: {worker.returncode} or a hang", flush=True)
    slowest = ", ".join(f"{name} {spent:.0f} s" for name, spent in took.most_common(5))
    print(f"{tried} inputs, {complaints} complaints; most of the time: {slowest}")
    return int(complaints > 0)


def _told(worker: subprocess.Popen[str], end: float) -> Iterator[Any]:
    """What a worker says until it dies, says nothing for too long, or the time is over."""
    assert worker.stdout is not None
    while time.monotonic() < end:
        ready, _, _ = select.select([worker.stdout], [], [], _SILENCE_S)
        line = worker.stdout.readline() if ready else ""
        if not line:
            return
        yield json.loads(line)


if __name__ == "__main__":
    if sys.argv[1] == "--work":
        work(Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5])
    else:
        sys.exit(main())
