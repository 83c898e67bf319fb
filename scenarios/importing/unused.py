"""The columns of logs that no recording came to hold."""

from __future__ import annotations

from collections.abc import Mapping as Table
from collections.abc import Sequence
from typing import Final

from rig.channels import SENSORS
from rig.recording import Recording
from scenarios.importing.quantities import kind_of
from scenarios.importing.text_log import Log

_LISTED: Final = 24


def unused_columns(logs: Sequence[Log], targets: Table[str, str], recording: Recording) -> dict[str, tuple[str, ...]]:
    """By log, the columns that are nothing in the mapping, or nothing that this recording holds.

    Args:
        targets: column -> what it is.
    """
    idle = {name for name, text in targets.items() if recording.tool_position is None and kind_of(text) == "position"}
    found: dict[str, tuple[str, ...]] = {}
    for log in logs:
        every = dict.fromkeys((*log.columns, *log.unread))
        if left := tuple(name for name in every if name not in targets or name in idle):
            found[log.name] = left
    return found


def unused_words(unused: Table[str, Sequence[str]], recording: Recording) -> tuple[list[str], bool]:
    """A line a log, and whether the recording lacks a sensor or the pose, which these columns may be."""
    lacking = [f"no {sensor}" for sensor in SENSORS if sensor not in recording.sensors]
    lacking += ["no pose"] * (recording.pose == "none")
    said = f"{' and '.join(lacking)} was recognised: name the columns in --map MAP.toml if they hold it"
    meant = f"; {said}" if lacking else ""
    found = []
    for log, names in unused.items():
        listed = ", ".join(map(repr, names[:_LISTED]))
        more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
        found.append(f"{log}: {len(names)} column{'s' * (len(names) > 1)} not used: {listed}{more}{meant}")
    return found, bool(lacking)
