"""The page of the benchmarks' figures, made from the JSON that ``make bench`` writes.

As a command: ``python -m documenting.benchmarks_page docs/benchmarks.md "what else the machine did" bench.json ...``;
of several files the first one's machine and settings stand for all.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, cast

from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match

from documenting.json_schema import (
    ANY,
    NUMBER,
    TEXT,
    TEXT_OR_NONE,
    TOLD,
    WHOLE,
    YES,
    list_of,
    object_of,
    one_of,
    open_,
    or_null,
    table_of,
)
from rig.documents import read_json
from rig.errors import RigError, one_line
from rig.files import write_text

_EXPECTED: Final = "what `make bench` writes"
_MACHINE: Final = {
    "processor": TEXT,
    "cores": WHOLE,
    "load": or_null({**list_of(NUMBER), "minItems": 1}),
    "python": TEXT,
    "packages": table_of(TEXT_OR_NONE),
    "blas": list_of(TEXT),
    "blas_threads": {"type": ["integer", "null"]},
}
_GOAL: Final = object_of({"what": TEXT, "value": TOLD, "sense": TEXT, "limit": NUMBER, "met": or_null(YES)})
_TABLE: Final = object_of({"title": TEXT, "rows": list_of(table_of(ANY)), "note": TEXT})
_REPORT: Final = object_of({"title": TEXT}, {"failed": TEXT, "tables": list_of(_TABLE), "goals": list_of(_GOAL)})
_DOCUMENT: Final = object_of(
    {
        "format": one_of("rig-benchmarks/1"),
        "quick": YES,
        "machine": open_(object_of(_MACHINE)),
        "benchmarks": table_of(open_(_REPORT)),
    },
    {"seed": WHOLE},
)

_HEAD: Final = """# Benchmarks

Made by `python -m documenting.benchmarks_page` from what `make bench ARGS="{arguments}"` wrote.{quick}

{machine} {beside}

A column "/ NAME" is the ratio to NAME in the same rounds, which does not depend on the machine's load: to a package, to
a textbook method, or to a limit, such as a bare pass over the same numbers. "/ bound" is the ratio to the Cramér–Rao
bound. "± [%]" is half the interquartile range of a call's times over its median: where it is large, something else ran
in some of the rounds, and the ratios say more than the median.

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
    load = "" if machine["load"] is None else f", load {machine['load'][0]:.1f} at the start"
    packages = ", ".join(f"{name} {version or '(missing)'}" for name, version in machine["packages"].items())
    return (
        f"{machine['processor']}, {machine['cores']} cores{load}; Python"
        f" {machine['python']}, {packages}; {', '.join(machine['blas'])}, {machine['blas_threads']} thread."
    )


def _report(name: str, report: Mapping[str, Any]) -> str:
    parts = [f"\n## {name}: {report['title']}\n"]
    if "failed" in report:
        parts.append(f"It failed: {report['failed']}\n")
    for table in report.get("tables", ()):
        if not table["rows"]:
            continue
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


def read(file: str) -> dict[str, Any]:
    """The JSON of a ``make bench``.

    Raises:
        RigError: no such file, not JSON, or something else than ``make bench`` writes.
    """
    document = read_json(file, _EXPECTED)
    wrong = best_match(Draft202012Validator(_DOCUMENT).iter_errors(document))
    if wrong is not None:
        where = wrong.json_path.removeprefix("$").removeprefix(".")
        raise RigError(f"{file}: {where}{': ' if where else ''}{one_line(wrong.message, 120)}; expected {_EXPECTED}")
    return cast("dict[str, Any]", document)


def main(arguments: Sequence[str]) -> int:
    """The command: write the page; returns its exit status."""
    if len(arguments) < 3:
        print("usage: python -m documenting.benchmarks_page PAGE.md BESIDE BENCH.json ...", file=sys.stderr)
        return 2
    path, beside, *files = arguments
    try:
        documents = [read(file) for file in files]
        every = {name: report for document in documents for name, report in document["benchmarks"].items()}
        write_text(path, page({**documents[0], "benchmarks": every}, beside))
    except RigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
