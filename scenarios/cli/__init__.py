"""The console command ``rig``."""

from __future__ import annotations

from scenarios.cli._app import main

__all__ = ["main"]
