"""``gate``: fitted rigs with wrong and right causes, judged on fresh recordings."""

from __future__ import annotations

from pathlib import Path

import click

from scenarios.cli._options import PATH, print_json, progress_bar
from validation.cli._options import hidden_rigs_options


@click.command(short_help="Is a fitted rig called better only where it is?")
@click.option("-o", "--output", type=PATH, required=True, metavar="FOLDER", help="Gets gate.md and its table.")
@hidden_rigs_options(24)
def gate(
    output: Path, rigs: int, samples: int, seed: int, workers: int | None, cluster: str | None, as_json: bool
) -> None:
    """Force a wrong cause into the model of hidden rigs, and judge it on a fresh recording; so the right one.

    FOLDER/gate.md tells how often the wrong one is refused and the right one called better; the same command goes on
    with a study that was ended.

    \b
    Example:
      python -m validation gate -o docs
      python -m validation gate -o small --rigs 4 --seed 2 --workers 2
    """
    from scenarios.workers import Workers
    from validation.gate.run import Settings, make_gate

    with progress_bar(f"{rigs} hidden rigs") as progress:
        path, rows = make_gate(output, Settings(rigs, samples, seed), Workers(workers, cluster), progress)
    if as_json:
        print_json([vars(row) for row in rows])
        return
    click.echo(f"{path}: written")
