"""The report of a diagnosis: a page to look at, and tables for the terminal; ``page`` is by itself, as it draws."""

from scenarios.gap_report.gap_residuals import GapResiduals, gap_residuals
from scenarios.gap_report.terminal import diagnosis_tables

__all__ = ["GapResiduals", "diagnosis_tables", "gap_residuals"]
