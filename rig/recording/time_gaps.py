"""Gaps in a recording's times."""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array

#: Median steps from which on a step is a gap.
_GAP: Final = 10.0


def gap_words(t: Array) -> list[str]:
    """The longest gap between the times (n,) [s] of a recording, in words; empty where there is none."""
    steps = np.diff(t)
    if not len(steps) or steps.max() <= _GAP * np.median(steps):
        return []
    row = int(np.argmax(steps))
    return [f"a gap of {steps[row]:.4g} s after row {row}; the median step is {np.median(steps):.4g} s"]
