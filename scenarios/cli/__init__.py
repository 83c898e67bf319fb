"""The console command ``rig``."""

from __future__ import annotations

from typing import NoReturn

from scenarios.cli import _signals

__all__ = ["main"]


def main() -> NoReturn:
    """Run the command line; nothing but the signals is ready before, so that Ctrl-C during the imports is heard."""
    with _signals.heard():
        from scenarios.cli._app import main as command

        command()
