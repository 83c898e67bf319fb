"""A recording of any length, thinned to what fits into memory and time, in stretches that keep their neighbours."""

from __future__ import annotations

import os
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.memory import limit_bytes
from rig.recording.block_means import joined
from rig.recording.recording_files import RecordingScan, scan_recording
from rig.recording.samples import Recording

#: Samples of a stretch: successive ones are needed to see repeats and correlation, and many stretches to see all
#: orientations.
STRETCH: Final = 64
_STRETCHES: Final = 1024
_FEWEST: Final = 4096


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
    return _thinned(run, at_most)[0]


def _thinned(run: Recording | RecordingScan | str | os.PathLike[str], at_most: int) -> tuple[Recording, int]:
    """As ``thinned``, and of how many stretches one is kept."""
    stretch = int(np.clip(at_most // _STRETCHES, 4, STRETCH))
    if isinstance(run, Recording):
        if len(run) <= at_most:
            return run, 1
        every = -(-len(run) // at_most)
        return run.select(np.arange(len(run)) // stretch % every == 0), every
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
    return joined([part for part, _ in kept]), every


def _every(every: int, part: Recording, numbers: NDArray[np.intp]) -> list[tuple[Recording, NDArray[np.intp]]]:
    """The part without all but every so many stretches, of the numbers (n,); an empty list if nothing is left."""
    chosen = numbers % every == 0
    if chosen.all():
        return [(part, numbers)]
    return [(part.select(chosen), numbers[chosen])] if chosen.any() else []


def whole_or_thinned(scan: RecordingScan, bytes_a_sample: float) -> tuple[Recording, str]:
    """A recording whole, or thinned to what may be taken of memory.

    Args:
        scan: the file.
        bytes_a_sample: what is to be done with it takes so much memory.

    Returns:
        The recording, and a word about what was left out; "" where nothing was.

    Raises:
        RigError: as of ``thinned``.
    """
    at_most = max(int(limit_bytes() / bytes_a_sample), _FEWEST)
    if scan.rows is not None and scan.rows <= at_most:
        return scan.read(), ""
    found, every = _thinned(scan, at_most)
    if every == 1:
        return found, ""
    return found, f"{scan.path}: one in {every} stretches is used, {len(found):,} samples: memory allows no more"
