"""Plots of recordings and calibrations, as files."""

from __future__ import annotations

from scenarios.plots.calibration_errors import errors_figure
from scenarios.plots.coverage import coverage_figure
from scenarios.plots.residuals import residuals_figure
from scenarios.plots.style import save
from scenarios.plots.sweep import sweep_figure

__all__ = ["coverage_figure", "errors_figure", "residuals_figure", "save", "sweep_figure"]
