"""A recording of any length, thinned to what fits into memory and time, in stretches that keep their neighbours."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.recording import Recording, RecordingScan, scan_recording

Array = NDArray[np.float64]

#: Samples of a stretch: successive ones are needed to see repeats and correlation, and many stretches to see all
#: orientations.
STRETCH: Final = 64
_STRETCHES: Final = 1024


def thinned(run: Recording | RecordingScan | str | os.PathLike[str], at_most: int) -> Recording:
    """At most so many samples, in evenly spread stretches of up to 64 successive ones.

    A file is read once in constant memory, its length unknown until its end: every stretch is kept first, and every
    other one is dropped whenever there are too many.

    Args:
        run: a recording, or the file of one.
        at_most: samples.

    Raises:
        RigError: the file cannot be read.
    """
    stretch = int(np.clip(at_most // _STRETCHES, 4, STRETCH))
    if isinstance(run, Recording):
        if len(run) <= at_most:
            return run
        return run.select(np.arange(len(run)) // stretch % -(-len(run) // at_most) == 0)
    scan = run if isinstance(run, RecordingScan) else scan_recording(run)
    kept: list[tuple[Recording, NDArray[np.intp]]] = []
    every, count = 1, 0
    for batch in scan:
        numbers = np.arange(count, count + len(batch)) // stretch
        count += len(batch)
        kept += _every(every, batch, numbers)
        while sum(len(part) for part, _ in kept) > at_most:
            every *= 2
            kept = [chosen for part, own in kept for chosen in _every(every, part, own)]
    return joined([part for part, _ in kept])


def _every(every: int, part: Recording, numbers: NDArray[np.intp]) -> list[tuple[Recording, NDArray[np.intp]]]:
    """The part without all but every so many stretches, of the numbers (n,); an empty list if nothing is left."""
    chosen = numbers % every == 0
    if chosen.all():
        return [(part, numbers)]
    return [(part.select(chosen), numbers[chosen])] if chosen.any() else []


def joined(parts: list[Recording]) -> Recording:
    """One recording of several that follow one another in time and have the same columns."""
    first = parts[0]

    def together(values: list[Array | None]) -> Array | None:
        found = [value for value in values if value is not None]
        return np.concatenate(found) if found else None

    return replace(
        first,
        t=np.concatenate([part.t for part in parts]),
        q=together([part.q for part in parts]),
        tool_quaternion=together([part.tool_quaternion for part in parts]),
        tool_position=together([part.tool_position for part in parts]),
        accelerometer=together([part.accelerometer for part in parts]),
        magnetometer=together([part.magnetometer for part in parts]),
        temperature=together([part.temperature for part in parts]),
        currents={joint: np.concatenate([part.currents[joint] for part in parts]) for joint in first.currents},
        supply=together([part.supply for part in parts]),
    )
