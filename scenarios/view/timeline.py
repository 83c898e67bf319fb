"""The one timeline of a view: the recording's time in seconds."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

#: The timeline's name.
TIMELINE: Final = "t"


def at(t: NDArray[np.float64]) -> list[rr.TimeColumn]:
    """The index of ``send_columns`` for rows at times (m,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=t)]
