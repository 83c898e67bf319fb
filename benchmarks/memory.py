"""Peak memory of the commands on recordings that are longer than it: calibrate, apply, noise and diagnose.

python -m benchmarks.memory 100000000      so many rows, a tenth of them for the diagnosis
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Final

from benchmarks._child import Spent, spent_by
from benchmarks._measure import Column, Goal, Report, Settings, Table
from benchmarks.stream import ROW_BYTES, alone

TITLE = "peak memory of the commands on long recordings"

#: Command line, of which file, and the memory that it may take [MiB].
_CALLS: Final = (
    ("calibrate long.parquet -o cal.json", "long", 512),
    ("calibrate long.parquet --method ellipsoid -o free.json", "long", 512),
    ("apply cal.json long.parquet -o applied.parquet", "long", 512),
    ("noise rest.parquet --memory 512M", "rest", 512),
    ("diagnose short.parquet --memory 2G --out found", "short", 2048),
)


def run(settings: Settings, rows: int | None = None) -> Report:
    count = settings.of(5_000_000, 300_000) if rows is None else rows
    files = {"long": count, "rest": count, "short": max(count // 10, 10_000)}
    folder = Path(tempfile.mkdtemp(prefix="rig-memory-"))
    try:
        free, wanted = shutil.disk_usage(folder).free, 3.5 * ROW_BYTES * count
        if free < wanted:
            raise OSError(f"{folder}: {free / 1e9:.1f} GB free, {wanted / 1e9:.1f} GB needed for {count:,} rows")
        alone("write", folder / "long.parquet", count, settings.seed)
        alone("write", folder / "short.parquet", files["short"], settings.seed)
        alone("rest", folder / "rest.parquet", count, settings.seed)
        spent = {line: _spent(folder, line) for line, _, _ in _CALLS}
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    columns = (
        Column("rig", ""),
        Column("samples", ""),
        Column("wall [s]"),
        Column("CPU time [s]"),
        Column("peak memory [MiB]", ".0f"),
        Column("at most", "d"),
        Column("exit status", "d"),
    )
    table = Table(
        "whole commands, start and imports included",
        columns,
        tuple(
            (line, f"{files[file]:,}", (one := spent[line]).seconds, one.cpu_s, one.peak_MiB, most, one.status)
            for line, file, most in _CALLS
        ),
        "Exit status 1: the calibration is not good (without the attitude the noise of so many samples shows all).",
    )
    goals = tuple(
        Goal(
            f"rig {line.split()[0]}, {files[file]:,} samples, peak memory [MiB]", spent[line].peak_MiB, "at most", most
        )
        for line, file, most in _CALLS
    )
    return Report((table,), goals)


def _spent(folder: Path, line: str) -> Spent:
    """Run a command in a process of its own.

    Raises:
        RuntimeError: it refuses its input.
    """
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))}
    spent = spent_by([sys.executable, "-m", "scenarios.cli", *line.split()], cwd=folder, env=environment)
    if spent.status not in (0, 1):
        raise RuntimeError(f"rig {line}: exit status {spent.status}")
    return spent


def main() -> None:
    """The benchmark by itself, at the number of rows of the command line."""
    from rich.console import Console

    from benchmarks._run import drawn, drawn_goals

    report = run(Settings(), int(sys.argv[1]) if len(sys.argv) > 1 else None)
    console = Console(highlight=False, width=160)
    for table in report.tables:
        console.print(drawn(table))
    console.print(drawn_goals([("memory", goal) for goal in report.goals]))


if __name__ == "__main__":
    main()
