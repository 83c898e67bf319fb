"""A source of lines as recordings, batch by batch, with what there is to say about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.errors import RigError
from rig.recording import Metadata, Recording
from rig.recording.checks import NORM_TOLERANCE
from rig.recording.columns import QUATERNION, TIME
from rig.recording.recording_files import recording_of
from rig.stream.clock import Clock
from rig.stream.lines import LineReader
from rig.stream.sources import ANEW, Source

#: Samples that are needed to know the rate, if nothing says it.
_FIRST: Final = 20


class Feed:
    """Reads a source. Bad lines, gaps and clocks that jump are told by ``words`` and survived.

    Attributes:
        ended: whether the source has come to its end.
        clock: of the stream. reader: of its lines.
    """

    def __init__(
        self,
        source: Source,
        names: Sequence[str] | None = None,
        metadata: Metadata | None = None,
        rate_Hz: float | None = None,
        joints: int | None = None,
        renamed: Mapping[str, tuple[str, float]] | None = None,
    ) -> None:
        """Args:
        source: of bytes.
        names: of the cells, of lines without a header. metadata: of a stream that has none.
        rate_Hz: of lines without a time.
        joints: of the arm, where that is known.
        renamed: as of ``LineReader``.
        """
        self.reader = LineReader(source.name, names, metadata, joints, renamed)
        self.ended = False
        self.clock = Clock(rate_Hz)
        self._source = source
        self._rate_Hz = rate_Hz
        self._words: list[str] = []
        self._waiting: list[dict[str, Array]] = []
        self._begun = False
        self._told = 0
        self._rows = 0

    def words(self) -> list[str]:
        """What there is to say since the last call."""
        said = [*self._words, *self._source.words()]
        self._words = []
        return said

    def next(self, timeout_s: float) -> Recording | None:
        """The next samples; None where none came within the time.

        Raises:
            RigError: the first lines make no recording.
        """
        data = self._source.read(timeout_s)
        self._listen()
        self.ended = data is None
        table = self.reader.feed(data or b"", last=self.ended)
        self._count_broken()
        if table and (good := self._good(table)):
            self._waiting.append(good)
        count = sum(len(part[TIME]) for part in self._waiting)
        if not count or (not self._begun and count < _FIRST and not self.ended):
            return None
        joined = {name: np.concatenate([part[name] for part in self._waiting]) for name in self._waiting[0]}
        self._waiting, self._begun = [], True
        return self._recording(joined)

    def _listen(self) -> None:
        said = self._source.words()
        if any(ANEW in words for words in said):
            self.reader.restart()
        self._words += [words.replace(f"{ANEW}: ", "") for words in said]

    def _count_broken(self) -> None:
        if self.reader.broken > self._told:
            more = self.reader.broken - self._told
            example = f", such as {self.reader.example!r}" if self._told == 0 else ""
            self._words.append(f"{more} broken line{'s' if more > 1 else ''} left out{example}")
            self._told = self.reader.broken

    def _good(self, table: dict[str, Array]) -> dict[str, Array]:
        """Rows of numbers whose pose is a rotation and whose time goes on."""
        layout = self.reader.layout
        assert layout is not None
        whole = np.ones(len(next(iter(table.values()))), dtype=bool)
        for values in table.values():
            if not np.isfinite(values.sum()):
                whole &= np.isfinite(values)
        if layout.columns.tool:
            norm = np.sqrt(sum(np.square(table[name]) for name in QUATERNION))
            whole &= np.abs(norm - 1.0) <= 0.9 * NORM_TOLERANCE
        if not whole.all():
            self.reader.broken += int(len(whole) - whole.sum())
            table = {name: values[whole] for name, values in table.items()}
            self._count_broken()
        if not whole.any():
            return {}
        if not layout.timed:
            if self._rate_Hz is None:
                raise RigError(
                    f"{self._source.name}: column {TIME!r} is missing, expected it or, for evenly timed samples, --rate"
                )
            made = self.clock.made(int(whole.sum()))
            self.clock.last = float(made[-1])
            return {TIME: made, **table}
        ticked = self.clock.tick(table[TIME])
        self._words += ticked.words
        if not len(ticked.t):
            return {}
        kept = {name: values[ticked.kept] for name, values in table.items()}
        return {**kept, TIME: ticked.t}

    def _recording(self, table: dict[str, Array]) -> Recording:
        layout = self.reader.layout
        assert layout is not None
        metadata = layout.metadata
        if metadata.rate_Hz is None and self.clock.period is not None and self.clock.period > 0.0:
            metadata = replace(metadata, rate_Hz=float(f"{1.0 / self.clock.period:.6g}"))
        name = self._source.name
        found = recording_of(table, layout.columns, metadata, "live", name, self._rows)
        self._rows += len(found)
        return found

    def close(self) -> None:
        """Give the source back."""
        self._source.close()
