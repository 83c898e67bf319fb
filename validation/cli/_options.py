"""Options that several commands of the validation take."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any, Final

import click

from scenarios.cli._options import json_option
from scenarios.cli.study import workers_options

Command = Callable[..., Any]

#: Rigs or cases of a study at most, each of which takes seconds; and samples of a recording, three days at 4 Hz.
MOST: Final = 10_000
MOST_SAMPLES: Final = 1_000_000


def options(*every: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Several options as one, in the order of the help."""
    return lambda command: reduce(lambda made, option: option(made), reversed(every), command)


def hidden_rigs_options(rigs: int) -> Callable[[Command], Command]:
    """Of a study of hidden rigs: how many, ``rigs`` by default, their recordings, the seed, workers and --json."""
    return options(
        click.option("--rigs", type=click.IntRange(1, MOST), default=rigs, show_default=True, help="Hidden rigs."),
        click.option(
            "--samples",
            type=click.IntRange(400, MOST_SAMPLES),
            default=1664,
            show_default=True,
            help="Of each recording.",
        ),
        click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of everything random."),
        workers_options,
        json_option,
    )
