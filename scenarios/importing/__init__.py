"""Logs as they come (CSV, TSV, MCAP, ROS 2 bags; several files and clocks) into recordings."""

from scenarios.importing.convert import Imported, import_logs
from scenarios.importing.mapping import Mapping

__all__ = ["Imported", "Mapping", "import_logs"]
