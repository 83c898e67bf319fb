"""The comparison with both papers as a table for the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from scenarios.terminal.tables import table
from validation.paper.compare import Comparison, findings


def paper_report(comparison: Comparison) -> RenderableType:
    """How many rows of each table agree, and the findings."""
    columns = ("paper", "table", "rows", "agree", "differ", "cannot be told", "the rig's truth")
    rows = table(*columns, numbers=columns[2:])
    for paper, name in (("renk", "Renk et al."), ("camps", "Camps et al.")):
        for number in comparison.tables(paper):
            own = comparison.table(paper, number)
            words = ("agrees", "differs", "cannot be told", "is the rig's truth")
            found = [sum(row.word == word for row in own) for word in words]
            rows.add_row(name, number, str(len(own)), *(str(count) if count else "" for count in found))
    return Group(rows, Text(""), *(Text(f"- {finding}") for finding in findings(comparison)))
