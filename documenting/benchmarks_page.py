"""The page of the benchmarks' figures, made from the JSON that ``make bench`` writes.

As a command: ``python -m documenting.benchmarks_page docs/benchmarks.md "what else the machine did" bench.json ...``;
of several files the first one's machine and settings stand for all.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rig.files import write_text

_HEAD: Final = """# Benchmarks

Made by `python -m documenting.benchmarks_page` from what `make bench ARGS="{arguments}"` wrote.{quick}

{machine} {beside}

A column "/ NAME" is the ratio to NAME in the same rounds, which does not depend on the machine's load: to a package, to
a textbook method, or to a limit, such as a bare pass over the same numbers. "/ bound" is the ratio to the Cramér–Rao
bound.

## Goals

{goals}
"""
_QUICK: Final = " Its problems\nare small and its rounds few: it shows which is the faster, not the last digit."
_TAIL: Final = """
```{include} ../benchmarks/README.md
:start-line: 1
```
"""


def page(document: Mapping[str, Any], beside: str) -> str:
    """The page as Markdown.

    Args:
        document: as ``make bench`` writes it (``rig-benchmarks/1``).
        beside: what else the machine did, in a sentence.
    """
    found = document["benchmarks"]
    goals = [
        (name, goal["what"], goal["value"], f"{goal['sense']} {_cell(goal['limit'])}", _met(goal["met"]))
        for name, report in found.items()
        for goal in report.get("goals", ())
    ]
    head = _HEAD.format(
        arguments=f"{'--quick ' if document['quick'] else ''}-o bench.json",
        quick=_QUICK if document["quick"] else "",
        machine=_machine(document["machine"]),
        beside=beside,
        goals=_table(("benchmark", "goal", "measured", "to be", ""), goals),
    )
    return head + "".join(_report(name, report) for name, report in found.items()) + _TAIL


def _machine(machine: Mapping[str, Any]) -> str:
    packages = ", ".join(f"{name} {version or '(missing)'}" for name, version in machine["packages"].items())
    return (
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load'][0]:.1f} at the start; Python"
        f" {machine['python']}, {packages}; {', '.join(machine['blas'])}, {machine['blas_threads']} thread."
    )


def _report(name: str, report: Mapping[str, Any]) -> str:
    parts = [f"\n## {name}: {report['title']}\n"]
    if "failed" in report:
        parts.append(f"It failed: {report['failed']}\n")
    for table in report.get("tables", ()):
        parts.append(f"**{table['title']}**\n\n{_table(list(table['rows'][0]), map(dict.values, table['rows']))}\n")
        if table["note"]:
            parts.append(f"{table['note']}\n")
    return "\n".join(parts)


def _table(header: Sequence[str], rows: Iterable[Iterable[Any]]) -> str:
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *([_cell(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, int | float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value).replace("|", "\\|")


def _met(met: bool | None) -> str:
    return {True: "met", False: "missed", None: "not measured"}[met]


def main() -> None:
    """Write the page."""
    path, beside, *files = sys.argv[1:]
    documents = [json.loads(Path(file).read_text(encoding="utf-8")) for file in files]
    every = {name: report for document in documents for name, report in document["benchmarks"].items()}
    write_text(Path(path), page({**documents[0], "benchmarks": every}, beside))


if __name__ == "__main__":
    main()
