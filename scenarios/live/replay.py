"""A recording as a stream of lines, at its own pace or faster."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from rig.arrays import Array
from rig.recording import Recording, RecordingScan
from rig.recording.csv_table import csv_head, csv_lines

Form = Literal["csv", "json"]

#: Lines are handed over at least so often [s], and at most so many at once.
_SLICE_S: Final = 0.01
_MOST: Final = 8192


def replay(
    scan: RecordingScan,
    write: Callable[[bytes], object],
    speed: float | None = 1.0,
    form: Form = "csv",
    from_s: float | None = None,
    until_s: float | None = None,
    pose: bool = True,
) -> int:
    """Write a recording line by line.

    Args:
        scan: the recording.
        write: takes the bytes; it may block.
        speed: how many times as fast as it was recorded; None: as fast as it is taken.
        form: CSV with its metadata and a header, or a JSON object a line.
        from_s, until_s: of the recording's own time [s]; None: from its begin, to its end.
        pose: with joint angles and tool poses.

    Returns:
        How many samples were written.
    """
    count = 0
    begun: float | None = None
    for whole in scan:
        batch = _within(whole, from_s, until_s)
        if batch is None:
            continue
        if not pose and batch.pose != "none":
            metadata = replace(batch.metadata, arm="none")
            batch = replace(batch, q=None, tool_quaternion=None, tool_position=None, metadata=metadata)
        table = batch.table()
        if begun is None:
            begun = float(batch.t[0])
            started = time.monotonic()
            write(_head(batch, form))
        first = 0
        while first < len(batch):
            if speed is None:
                stop = min(first + _MOST, len(batch))
            else:
                gone = (time.monotonic() - started) * speed
                stop = int(np.searchsorted(batch.t, begun + gone, side="right"))
                if stop <= first:
                    time.sleep(min(_SLICE_S, max((float(batch.t[first]) - begun - gone) / speed, 0.0)))
                    continue
                stop = min(stop, first + _MOST)
            write(_lines({name: column[first:stop] for name, column in table.items()}, form))
            count += stop - first
            first = stop
    return count


def _within(batch: Recording, from_s: float | None, until_s: float | None) -> Recording | None:
    first = 0 if from_s is None else int(np.searchsorted(batch.t, from_s))
    stop = len(batch) if until_s is None else int(np.searchsorted(batch.t, until_s, side="right"))
    return batch.select(slice(first, stop)) if first < stop else None


def _head(batch: Recording, form: Form) -> bytes:
    said = batch.metadata.to_text()
    return f'{{"rig": {said}}}\n'.encode() if form == "json" else csv_head(said, batch.columns.names)


def _lines(columns: Mapping[str, Array], form: Form) -> bytes:
    if form == "csv":
        return csv_lines(columns)
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "".join(json.dumps(dict(zip(columns, row, strict=True))) + "\n" for row in rows).encode()
