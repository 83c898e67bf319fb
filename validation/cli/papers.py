"""``paper`` and ``gap``: what two papers publish beside what the rig gives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli._options import PATH, json_option, print_json, progress_bar
from scenarios.cli.study import workers_options

if TYPE_CHECKING:
    from validation.paper.compare import Comparison


@click.command(short_help="Every table of both papers beside the rig.")
@click.option("-o", "--output", type=PATH, required=True, metavar="FOLDER", help="Gets paper.md and its pictures.")
@click.option("--draws", type=click.IntRange(min=2), default=2000, show_default=True, help="Of the consistency study.")
@workers_options
@json_option
def paper(output: Path, draws: int, workers: int | None, cluster: str | None, as_json: bool) -> None:
    """Hold every table of Renk et al. (2005) and Camps et al. (2009) against what the rig gives.

    FOLDER/paper.md says of each published row whether it agrees, or why it differs; its consistency study is kept in
    FOLDER/paper, and not made again.

    \b
    Example:
      rig study paper -o docs
    """
    from scenarios.workers import Workers
    from validation.paper.run import make_paper, settings

    where = Workers(workers, cluster)
    with progress_bar("both papers") as progress:
        made = make_paper(output, settings(draws), where, progress)
    if as_json:
        from validation.paper.data import document

        print_json({"files": made.files, **document(made.comparison)})
        return
    _show(made.comparison)
    click.echo(f"\n{made.files[0]}: written, with {len(made.files) - 2} pictures and {made.files[-1]}")


def _show(comparison: Comparison) -> None:
    """How many rows of each table agree, and the findings."""
    from rich.text import Text

    from scenarios.terminal.tables import show, table
    from validation.paper.compare import findings

    columns = ("paper", "table", "rows", "agree", "differ", "cannot be told", "the rig's truth")
    rows = table(*columns, numbers=columns[2:])
    for paper, name in (("renk", "Renk et al."), ("camps", "Camps et al.")):
        for number in comparison.tables(paper):
            own = comparison.table(paper, number)
            words = ("agrees", "differs", "cannot be told", "is the rig's truth")
            found = [sum(row.word == word for row in own) for word in words]
            rows.add_row(name, number, str(len(own)), *(str(count) if count else "" for count in found))
    show(rows, Text(""), *(Text(f"- {finding}") for finding in findings(comparison)))


@click.command(short_help="A rig whose gap looks like the paper's.")
@click.option("-o", "--output", type=PATH, required=True, metavar="FOLDER", help="Gets gap.md and its picture.")
@json_option
def gap(output: Path, as_json: bool) -> None:
    """Hold the gap of Renk et al. against that of the scenario renk2005-gap: fit errors, scatter, diagnosis.

    \b
    Example:
      rig study gap -o docs
    """
    from validation.paper.twin_page import make_gap_page

    with progress_bar("the paper's gap"):
        files = make_gap_page(output)
    if as_json:
        print_json({"files": files})
        return
    for path in files:
        click.echo(f"{path}: written")
