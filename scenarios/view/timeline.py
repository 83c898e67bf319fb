"""The one timeline of a view: the recording's time in seconds."""

from __future__ import annotations

from typing import Final

import rerun as rr

from rig.arrays import Array

#: The timeline's name.
TIMELINE: Final = "t"


def at(t: Array) -> list[rr.TimeColumn]:
    """The index of ``send_columns`` for rows at times (m,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=t)]
