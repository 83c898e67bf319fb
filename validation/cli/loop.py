"""``loop``: hidden rigs, diagnosed again and again with what the diagnosis asks for."""

from __future__ import annotations

from collections.abc import Sequence
from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli._options import PATH, print_json, progress_bar
from validation.cli._options import hidden_rigs_options

if TYPE_CHECKING:
    from validation.loop.summary import Summary


@click.command(short_help="Does what the diagnosis proposes end in the right name?")
@click.option("-o", "--output", type=PATH, required=True, metavar="FOLDER", help="Gets loop.md and its picture.")
@hidden_rigs_options(12)
def loop(
    output: Path, rigs: int, samples: int, seed: int, workers: int | None, cluster: str | None, as_json: bool
) -> None:
    """Record hidden rigs, diagnose, record the next maneuver, diagnose together, until they are named.

    The next maneuver is the proposed one, stops at random poses, or another torus sweep. FOLDER/loop.md tells how many
    end with the right name, and after how many minutes of arm time; the same command goes on with a study that was
    ended.

    \b
    Example:
      rig study loop -o docs
      rig study loop -o small --rigs 4 --seed 2 --workers 2
    """
    from scenarios.workers import Workers
    from validation.loop.play import Settings
    from validation.loop.run import make_loop

    settings = Settings(rigs, samples, seed)
    with progress_bar(f"{rigs} hidden rigs") as progress:
        made = make_loop(output, settings, Workers(workers, cluster), progress)
    if as_json:
        print_json({"files": made.files, "summaries": [each.to_json() for each in made.summaries]})
        return
    _show(made.summaries)
    click.echo(f"\n{', '.join(map(str, made.files))}: written")


def _show(found: Sequence[Summary]) -> None:
    """One line for each way to choose the next maneuver."""
    from scenarios.terminal.tables import show, table
    from validation.loop.summary import ENDS

    numbers = (*ENDS, "open, then rightly", "minutes a name")
    result = table("next maneuver", *numbers, numbers=numbers)
    for each in found:
        cost = "–" if isinf(each.minutes_a_name) else f"{each.minutes_a_name:.0f}"
        then = f"{each.rightly_open.hits:g} of {each.rightly_open.count}"
        result.add_row(each.strategy, *(str(each.ends[name]) for name in ENDS), then, cost)
    show(result)
