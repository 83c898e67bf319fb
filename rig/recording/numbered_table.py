"""A table without times, whose rows are poses held still: their numbers stand for the time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.arrays import Array
from rig.recording.columns import TIME
from rig.recording.table import Table


@dataclass(frozen=True)
class NumberedTable:
    """The table with a column of times that counts its rows from 0."""

    table: Table

    @property
    def path(self) -> Path:
        """The file."""
        return self.table.path

    @property
    def names(self) -> tuple[str, ...]:
        """Of all columns, the time first."""
        return (TIME, *self.table.names)

    @property
    def metadata(self) -> str | None:
        """The JSON text, None where there is none."""
        return self.table.metadata

    @property
    def rows(self) -> int | None:
        """How many there are; None where the file has to be read to know."""
        return self.table.rows

    def batches(self, names: Sequence[str], batch_rows: int) -> Iterator[dict[str, Array]]:
        """As of ``Table.batches``; ``names`` hold the time and one column or more of the table."""
        row = 0
        for batch in self.table.batches([name for name in names if name != TIME], batch_rows):
            count = len(next(iter(batch.values())))
            yield {TIME: np.arange(row, row + count, dtype=float), **batch}
            row += count
