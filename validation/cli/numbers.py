"""``numbers``: the constants of a diagnosis, each moved to see what it sways."""

from __future__ import annotations

from pathlib import Path

import click

from scenarios.cli._options import PATH, json_option, print_json, progress_bar
from scenarios.cli.study import workers_options
from validation.cli._options import MOST_SAMPLES


@click.command(short_help="What do the constants of a diagnosis sway?")
@click.option("-o", "--output", type=PATH, required=True, metavar="FOLDER", help="Gets numbers.md and its table.")
@click.option(
    "--samples", type=click.IntRange(400, MOST_SAMPLES), default=416, show_default=True, help="Of each recording."
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of everything random.")
@workers_options
@json_option
def numbers(output: Path, samples: int, seed: int, workers: int | None, cluster: str | None, as_json: bool) -> None:
    """List every constant of the diagnosis with its reason, double it, and diagnose three recordings anew.

    FOLDER/numbers.md tells how far each moves a probability; the same command goes on with a study that was ended.

    \b
    Example:
      python -m validation numbers -o docs
    """
    from scenarios.workers import Workers
    from validation.numbers.run import Settings, make_numbers

    with progress_bar("numbers") as progress:
        path, rows = make_numbers(output, Settings(samples, seed), Workers(workers, cluster), progress)
    if as_json:
        print_json([vars(row) for row in rows])
        return
    click.echo(f"{path}: written")
