"""The report of a diagnosis: a page to look at, tables for the terminal, and the improved rig as a scenario."""

from scenarios.gap_report.improved_rig import improved_rig
from scenarios.gap_report.page import page
from scenarios.gap_report.residuals import GapResiduals, gap_residuals
from scenarios.gap_report.terminal import diagnosis_tables

__all__ = ["GapResiduals", "diagnosis_tables", "gap_residuals", "improved_rig", "page"]
