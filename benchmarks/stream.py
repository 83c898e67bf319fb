"""Recordings larger than memory: time beside the disk and the Parquet decoder, and the memory it takes.

python -m benchmarks.stream 100000000      so many rows, instead of the twenty million of ``make bench``
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from benchmarks._measure import Cell, Goal, Report, Settings, Timing, timing_table

TITLE = "calibrating a recording that is read in batches, beside the Parquet decoder and the disk"

_OURS = "torusrig, both sensors from joint angles"
_DECODER = "limit: pyarrow's decoder, every column dropped"
_DISK = "limit: reading the file's bytes"
_STEPS: Final = {_OURS: "calibrate", _DECODER: "decode", _DISK: "read"}
#: Bytes a row at most, with which the temporary folder's free space is checked.
ROW_BYTES: Final = 110


def run(settings: Settings, rows: int | None = None) -> Report:
    count = settings.of(20_000_000, 500_000) if rows is None else rows
    folder = Path(tempfile.mkdtemp(prefix="rig-stream-"))
    try:
        free = shutil.disk_usage(folder).free
        if free < 1.2 * ROW_BYTES * count:
            raise OSError(
                f"{folder}: {free / 1e9:.1f} GB free, {1.2 * ROW_BYTES * count / 1e9:.1f} GB needed for {count:,} rows"
            )
        path = folder / "long.parquet"
        written = alone("write", path, count, settings.seed)
        seconds: dict[str, list[float]] = {name: [] for name in _STEPS}
        peaks: dict[str, float] = dict.fromkeys(_STEPS, 0.0)
        last: dict[str, dict[str, Any]] = {}
        for _ in range(settings.rounds_of(3, 1)):
            for name, step in _STEPS.items():
                last[name] = alone(step, path)
                seconds[name].append(last[name]["seconds"])
                peaks[name] = max(peaks[name], last[name]["peak_MiB"])
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    timings = {name: Timing(tuple(values)) for name, values in seconds.items()}
    memory: dict[str, Cell] = dict(peaks)
    rate: dict[str, Cell] = {name: count / timing.median / 1e6 for name, timing in timings.items()}
    busy: dict[str, Cell] = {name: found["cpu_seconds"] for name, found in last.items()}
    error: dict[str, Cell] = {_OURS: last[_OURS]["largest_error_sigmas"]}
    size = written["bytes"] / 1e9
    table = timing_table(
        f"{count:,} samples in a Parquet file of {size:.2f} GB, from the disk",
        timings,
        beside=[_DECODER, _DISK],
        further={
            "CPU time [s]": busy,
            "million samples/s": rate,
            "peak memory [MiB]": memory,
            "largest error [σ]": error,
        },
        formats={"peak memory [MiB]": ".0f"},
        note=f"Each in a process of its own that has loaded everything ({last[_OURS]['start_MiB']:.0f} MiB); the system"
        " is asked to forget the file before each. Of 28 errors the largest is above 3 σ once in 14 times.",
    )
    return Report(
        tables=(table,),
        goals=(
            Goal(f"{count:,} samples from a file, peak memory [MiB]", peaks[_OURS], "at most", 1024.0),
            Goal(
                f"{count:,} samples from a file, time over the decoder's",
                timings[_OURS].over(timings[_DECODER]),
                "at most",
                1.5,
            ),
        ),
        times={table.title: timings},
    )


def alone(name: str, path: Path, *numbers: int) -> dict[str, Any]:
    """Run one step by itself; what it prints."""
    command = [sys.executable, "-m", "benchmarks._stream", name, str(path), *map(str, numbers)]
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{name}: {done.stderr.strip().splitlines()[-1] if done.stderr.strip() else 'failed'}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def main() -> None:
    """The benchmark by itself, at the number of rows of the command line, in two rounds."""
    from rich.console import Console

    from benchmarks._run import drawn, drawn_goals

    report = run(Settings(rounds=2), int(sys.argv[1]) if len(sys.argv) > 1 else None)
    console = Console(highlight=False, width=160)
    for table in report.tables:
        console.print(drawn(table))
    console.print(drawn_goals([("stream", goal) for goal in report.goals]))


if __name__ == "__main__":
    main()
