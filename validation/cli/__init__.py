"""The commands of ``python -m validation``; a module is imported when one of its commands is wanted."""

from __future__ import annotations

import click

from scenarios.cli._app import SETTINGS, Group
from scenarios.cli._checkout import BLIND, GAP, GATE, LOOP, NUMBERS, PAPER


@click.group(cls=Group, context_settings=SETTINGS)
def validation() -> None:
    """Hold the rig against sealed truths (blind, loop, gate), its own numbers (numbers), and two papers (paper, gap).

    \b
    Example:
      python -m validation blind make set1 --cases 100
      python -m validation paper -o docs
    """


for _command in (BLIND, PAPER, GAP, LOOP, GATE, NUMBERS):
    validation.add_command(_command)
