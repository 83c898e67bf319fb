"""Recordings and calibrations in the rerun viewer."""

from __future__ import annotations

from scenarios.view.viewer import open_view
from scenarios.view.write import Detail, write_view

__all__ = ["Detail", "open_view", "write_view"]
