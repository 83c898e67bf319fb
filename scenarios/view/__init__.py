"""Recordings and calibrations in the rerun viewer."""

from __future__ import annotations

from scenarios.view.diagnosed import write_diagnosis_view
from scenarios.view.viewer import open_view, serve_view
from scenarios.view.write import write_view

__all__ = ["open_view", "serve_view", "write_diagnosis_view", "write_view"]
