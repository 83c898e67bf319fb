"""Commands killed at random moments, and what they must leave: nothing torn, no process, nothing in the way.

``python tests/killing.py KILLS [SEED [NAME]]`` kills as often as it is told, commands whose line has NAME in it.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow.parquet as pq
from hostile_calls import make_good

SIGNALS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
#: Short enough to be killed with the tests; they need small.toml only.
SHORT: Final = (
    "sweep small.toml -o out/run.parquet --locked",
    "study consistency renk2005-table2 -o out/study --draws 10 --counts 2 --workers 1",
    "demo -o out",
)
#: The others need all of ``make_good``.
LONG: Final = (
    *SHORT,
    "study consistency renk2005-table2 -o out/study --draws 40 --counts 3 --workers 2",
    "study subsets run.parquet --subsets 3 -o out/study",
    "diagnose sweep.parquet --out out --save-scenario out/better.toml",
    "diagnose sweep.parquet alone.parquet --out out --jobs 2",
    "diagnose little.parquet sweep.parquet --together --out out",
    "blind solve sealed --jobs 2",
    "study loop -o out --rigs 1 --samples 400 --workers 1",
    "calibrate sweep.parquet alone.parquet -o out/cal.json --coverage out/cal.png",
    "blind make out/set --cases 16 --samples 400 --seed 2 --jobs 2",
    "live log.csv --idle 0.1 --keep-going -o out/live.parquet",
    "import log.csv -o out/run.parquet --map out/map.toml",
    "view run.parquet -o out/view.rrd",
    "plan --seconds 30 -o out/plan.toml --csv out/plan.csv --plot out/plan.png",
    "calibrate sweep.parquet -o out/cal.json --robust",
    "apply cal.json sweep.parquet -o out/applied.parquet",
)
_PATIENCE_S: Final = 3600.0
#: Kills of one command, one after another, before it is left alone.
_SERIES: Final = 4


def started(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """A command in a session of its own, with signals as a terminal gives them."""

    def handlers() -> None:
        for number in SIGNALS[1:]:
            signal.signal(number, signal.SIG_DFL)

    return subprocess.Popen(
        [sys.executable, "-m", "scenarios.cli", *arguments],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=handlers,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(folder / "tmp"), "OMP_NUM_THREADS": "1"},
    )


def processes_of(session: int) -> list[int]:
    """Those that are still alive in a session (Linux)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


@dataclass(frozen=True)
class Kill:
    """A signal and its moment: so long [s] after the command was begun, or after it made a file."""

    how: signal.Signals
    after_s: float
    writing: bool = False

    def strike(self, process: subprocess.Popen[bytes], folder: Path) -> None:
        """Wait for the moment, then send the signal; a command that is done meanwhile is left alone."""
        before = _names(folder)
        while self.writing and process.poll() is None and _names(folder) <= before:
            time.sleep(0.002)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(self.after_s)
        process.send_signal(self.how)


def complaint_about(folder: Path, line: str, kills: Sequence[Kill]) -> str:
    """What a command did wrong that was killed, begun again and killed again, and at last left alone; "" where nothing.

    Args:
        folder: with what it reads; it writes to ``out``.
    """
    for name in ("out", "tmp"):
        (folder / name).mkdir()
    for kill in kills:
        if wrong := _complaint_about_one(folder, line, kill):
            return f"{kill}: {wrong}"
    again = started(folder, *_goes_on(folder, line))
    _, err = again.communicate(timeout=_PATIENCE_S)
    if again.returncode not in (0, 1) or (err and not line.startswith("live")):
        return f"again: status {again.returncode}: {err[-500:]!r}"
    if left_over := torn(folder / "out") + torn(folder / "sealed") + temporaries(folder):
        return f"again: {left_over}"
    return ""


def _complaint_about_one(folder: Path, line: str, kill: Kill) -> str:
    before = temporaries(folder)
    process = started(folder, *_goes_on(folder, line))
    kill.strike(process, folder)
    _, err = process.communicate(timeout=_PATIENCE_S)
    told = err.decode().splitlines()
    # It was done, or a live session that was stopped; or the interpreter had not yet begun, or was at its end.
    said = told and not line.startswith("live")
    ended = process.returncode in (0, 1) or (process.returncode == -kill.how and not said)
    heard = kill.how != signal.SIGKILL
    if heard and not ended and (process.returncode != 128 + kill.how or not told[-1].startswith("rig: ")):
        return f"status {process.returncode}: {err[-500:]!r}"
    if heard and not ended and len(told) != 1 and not line.startswith("live"):
        return f"{len(told)} lines: {err[-500:]!r}"
    deadline = time.monotonic() + 20.0
    while processes_of(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    if left := processes_of(process.pid):
        for number in left:
            os.kill(number, signal.SIGKILL)
        return f"{len(left)} processes were left"
    if heard and (temporary := sorted(set(temporaries(folder)) - set(before))):
        return f"left {temporary}"
    if found := torn(folder / "out") + torn(folder / "sealed"):
        return f"torn: {found}"
    return ""


def _goes_on(folder: Path, line: str) -> list[str]:
    return [*line.split(), *(("--resume",) if (folder / "out" / "live.csv").exists() else ())]


def _names(folder: Path) -> set[Path]:
    found = set()
    for name in ("out", "sealed"):
        with contextlib.suppress(OSError):  # it changes while it is looked at
            found |= set((folder / name).rglob("*"))
    return found


def temporaries(folder: Path) -> list[str]:
    """What is left of work that was not done."""
    found = [*folder.rglob("*.rig-*"), *(folder / "tmp").glob("rig-*"), *folder.rglob("MUJOCO_LOG.TXT")]
    return [str(path.relative_to(folder)) for path in found]


def torn(folder: Path) -> list[str]:
    """Files that cannot be read to their end; a session's journal grows line by line and may lack one's end."""
    files = [path for path in folder.rglob("*") if path.is_file() and ".rig-" not in path.name]
    return [str(path.relative_to(folder)) for path in files if not _whole(path)]


def _whole(path: Path) -> bool:
    try:
        if path.suffix == ".parquet":
            pq.read_table(path)
        elif path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".toml":
            tomllib.loads(path.read_text())
        elif path.suffix == ".html":
            return path.read_text().rstrip().endswith("</html>")
        elif path.suffix == ".png":
            return path.read_bytes().endswith(b"IEND\xaeB`\x82")
        elif path.suffix == ".csv" and path.name != "live.csv":
            return path.read_bytes().endswith(b"\n")
        elif path.suffix == ".rrd":
            from rerun.chunk import RrdReader

            for _ in RrdReader(str(path)).stream():
                pass
    except Exception:
        return False
    return True


def main() -> int:
    """Kill so often; print what went wrong."""
    kills, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    lines = [line for line in LONG if len(sys.argv) < 4 or sys.argv[3] in line]
    lasts: dict[str, float] = {}
    count: Counter[str] = Counter()
    found = 0
    with tempfile.TemporaryDirectory() as name:
        good = Path(name)
        make_good(good)
        for number in itertools.count():
            if count.total() >= kills:
                break
            rng = random.Random(f"{seed} {number}")
            line = lines[number % len(lines)]
            with tempfile.TemporaryDirectory() as place:
                folder = Path(place) / "here"
                shutil.copytree(good, folder)
                begun = time.monotonic()
                series = [Kill(signal.SIGKILL, 0.0)]
                if line in lasts:
                    series = [a_kill(rng, lasts[line]) for _ in range(_SERIES)]
                wrong = complaint_about(folder, line, series)
                lasts.setdefault(line, time.monotonic() - begun)  # how long it takes if it is left alone
            count[line] += len(series)
            if wrong:
                found += 1
            print(f"{seed} {number}: {line}: {wrong or len(series)}", flush=True)
    for line, killed in count.items():
        print(f"{killed:4d} {line}")
    print(f"{count.total()} kills, {found} complaints")
    return int(found > 0)


def a_kill(rng: random.Random, lasts: float) -> Kill:
    """At any time of a command that lasts so long [s], or soon after it wrote."""
    how = rng.choice(SIGNALS)
    return Kill(how, rng.uniform(0.0, 0.3), True) if rng.random() < 0.5 else Kill(how, rng.uniform(0.1, 1.0) * lasts)


if __name__ == "__main__":
    sys.exit(main())
