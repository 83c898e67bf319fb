"""The command: which benchmarks there are, running them, and what is printed and written."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
import traceback
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, Final

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Drawn
from threadpoolctl import threadpool_info

from benchmarks._measure import Goal, Report, Settings, Table
from rig.errors import RigError
from rig.files import atomic_path

FORMAT: Final = "rig-benchmarks/1"
_PACKAGES: Final = ("mujoco", "numpy", "scipy", "magyc", "magcc", "magcal", "circuitpython-mag-cal")
_WIDTH: Final = 160  # where the output is no terminal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmarks that were asked for; exit status 0 if all ran, whatever they found; 1 if one failed."""
    choices = discover()
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="What things cost and how good they are, beside today's packages and the machine's limits.",
        epilog='example: make bench ARGS="ellipsoid stillness -o out.json"',
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one or more of {', '.join(choices)}; all without")
    parser.add_argument("--quick", action="store_true", help="smaller and fewer: to see that all of it runs")
    parser.add_argument("--rounds", type=int, help="interleaved rounds of timing, instead of each benchmark's own")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default 0)")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write all of it as JSON, every timing included"
    )
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in choices]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}, expected one of {', '.join(choices)}")
    if options.rounds is not None and options.rounds < 1:
        parser.error(f"--rounds: found {options.rounds}, expected 1 or more")
    if options.output is not None and not options.output.absolute().parent.is_dir():
        parser.error(f"{options.output}: folder {options.output.parent} does not exist")
    settings = Settings(options.quick, options.rounds, options.seed)
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_WIDTH)
    machine = machine_facts()
    console.print(f"[bold]{escape(_machine_line(machine))}[/bold]")
    found: dict[str, Any] = {}
    goals: list[tuple[str, Goal]] = []
    failed = False
    for name in options.names or choices:
        module = import_module(f"benchmarks.{name}")
        console.rule(f"[bold]{name}[/bold]: {escape(module.TITLE)}", align="left")
        begun = time.perf_counter()
        try:
            report: Report = module.run(settings)
        except Exception as error:  # one broken benchmark shall not cost the others
            failed = True
            found[name] = {"title": module.TITLE, "failed": f"{type(error).__name__}: {error}"}
            console.print(f"[red]failed[/red]: {escape(f'{type(error).__name__}: {error}')}")
            traceback.print_exc()
            continue
        seconds = time.perf_counter() - begun
        for table in report.tables:
            console.print(drawn(table))
        goals += [(name, goal) for goal in report.goals]
        found[name] = {"title": module.TITLE, "seconds": seconds, **report.to_dict()}
    if goals:
        console.rule("[bold]goals[/bold]", align="left")
        console.print(drawn_goals(goals))
    if options.output is not None:
        document = {
            "format": FORMAT,
            "quick": settings.quick,
            "seed": settings.seed,
            "machine": machine,
            "benchmarks": found,
        }
        try:
            with atomic_path(options.output) as path:
                path.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        except RigError as error:
            parser.error(str(error))
    return 1 if failed else 0


def discover() -> list[str]:
    """The names of the modules beside this one that are benchmarks: not private, and no package."""
    folder = str(Path(__file__).parent)
    return sorted(found.name for found in iter_modules([folder]) if not found.ispkg and not found.name.startswith("_"))


def machine_facts() -> dict[str, Any]:
    """What the figures depend on."""
    import scipy.linalg  # noqa: F401  (its BLAS must be loaded to be found)

    packages: dict[str, str | None] = {}
    for package in _PACKAGES:
        try:
            packages[package] = version(package)
        except PackageNotFoundError:
            packages[package] = None
    np.ones((2, 2)) @ np.ones((2, 2))
    blas = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "packages": packages,
        "blas": sorted({f"{pool['internal_api']} {pool['version']}" for pool in blas}),
        "blas_threads": max((pool["num_threads"] for pool in blas), default=None),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _machine_line(machine: dict[str, Any]) -> str:
    load = "" if machine["load"] is None else f", load {machine['load'][0]:.1f}"
    packages = ", ".join(f"{name} {found or '(missing)'}" for name, found in machine["packages"].items())
    return (
        f"{machine['processor']}, {machine['cores']} cores{load}; Python {machine['python']}, {packages};"
        f" {', '.join(machine['blas'])}, {machine['blas_threads']} thread"
    )


def drawn(table: Table) -> Drawn:
    """A table for the terminal."""
    caption = escape(table.note) if table.note else None
    result = Drawn(
        title=escape(table.title), caption=caption, box=box.SIMPLE_HEAD, title_justify="left", caption_justify="left"
    )
    for index, column in enumerate(table.columns):
        result.add_column(escape(column.heading), justify="left" if index == 0 else "right")
    for row in table.rows:
        result.add_row(*(escape(column.text(cell)) for column, cell in zip(table.columns, row, strict=True)))
    return result


def drawn_goals(goals: Sequence[tuple[str, Goal]]) -> Drawn:
    """What was to be reached, and whether it was."""
    words = {True: "[green]met[/green]", False: "[red]missed[/red]", None: "not measured"}
    result = Drawn(box=box.SIMPLE_HEAD)
    for heading, justify in (
        ("benchmark", "left"),
        ("goal", "left"),
        ("measured", "right"),
        ("to be", "right"),
        ("", "left"),
    ):
        result.add_column(heading, justify=justify)  # type: ignore[arg-type]
    for name, goal in goals:
        value = "–" if goal.met is None else f"{goal.value:.4g}"
        result.add_row(name, escape(goal.what), value, f"{goal.sense} {goal.limit:g}", words[goal.met])
    return result
