"""Commands that are part of the repository and not of the installed package.

They check the product and are run by those who change it, so the wheel does without them. In a checkout the package
``validation`` lies beside this one.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any, Final

import click

from rig.errors import RigError

_CHECKOUT: Final = Path(__file__).parents[2]


class CheckoutCommand(click.Command):
    """Stands in the help for a command of ``validation``, which is imported when the command is called."""

    def __init__(self, name: str, module: str, short_help: str) -> None:
        super().__init__(name, short_help=short_help)
        self.module = module

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context of the command itself."""
        return self.command.make_context(info_name, args, parent, **extra)

    @property
    def command(self) -> click.Command:
        """The command itself.

        Raises:
            RigError: This is not a checkout.
        """
        if not (_CHECKOUT / "validation" / "__init__.py").is_file():
            raise RigError(
                f"{self.name}: a part of the repository, which the installed package in {_CHECKOUT} is without;"
                f" run it from a checkout: python -m validation {self.name}"
            )
        command = getattr(import_module(f"validation.cli.{self.module}"), str(self.name))
        assert isinstance(command, click.Command)
        return command


BLIND: Final = CheckoutCommand("blind", "blind", "The check on sealed recordings: make, solve, score.")
PAPER: Final = CheckoutCommand("paper", "papers", "Every table of both papers beside the rig.")
GAP: Final = CheckoutCommand("gap", "papers", "A rig whose gap looks like the paper's.")
LOOP: Final = CheckoutCommand("loop", "loop", "Does what the diagnosis proposes end in the right name?")
GATE: Final = CheckoutCommand("gate", "gate", "Is a fitted rig called better only where it is?")
NUMBERS: Final = CheckoutCommand("numbers", "numbers", "What do the constants of a diagnosis sway?")
