"""Which rows of a log count: one in which a cell holds no number is left out, and nothing is made up in its place."""

from __future__ import annotations

from collections.abc import Mapping as Table
from collections.abc import Sequence
from typing import Final

import numpy as np

from rig.arrays import Array, Mask
from rig.errors import RigError

#: What is slow and goes with the readings: between its rows it may be interpolated.
_SLOW: Final = ("temperature", "supply", "current")
_NAMED: Final = 6


def whole_rows(
    log: str, quantities: Table[str, tuple[Sequence[str], Array]], timed: Mask | None
) -> tuple[dict[str, Mask], int, list[str], list[str]]:
    """The rows of each quantity that count.

    A quantity that is in more than half of the rows comes at the log's own rate: a row that lacks a cell of one of
    these counts for none of them. One that is in fewer rows has a rate of its own, and keeps its own whole rows.

    Args:
        log: its name, for messages.
        quantities: by kind, the names of its columns and their numbers (n, k), NaN or infinite where there is none.
        timed: (n,) rows that have a time; None: the log has no times, and every row needs all quantities.

    Returns:
        Rows (n,) by kind; how many rows were left out; what is wrong, and what is to be said besides, line by line.

    Raises:
        RigError: a quantity without a whole row, or no row with all of them where all are needed.
    """
    n = len(next(iter(quantities.values()))[1])
    there = np.ones(n, dtype=bool) if timed is None else timed
    cells = {kind: np.isfinite(values) for kind, (_, values) in quantities.items()}
    whole = {kind: there & finite.all(axis=1) for kind, finite in cells.items()}
    for kind, rows in whole.items():
        if not rows.any():
            raise RigError(f"{log}: {kind}: found no row with all of {', '.join(quantities[kind][0])}")
    own = [kind for kind, rows in whole.items() if timed is None or (kind not in _SLOW and 2 * rows.sum() > n)]
    common = np.all([there, *(whole[kind] for kind in own)], axis=0)
    if timed is None and not common.any():
        raise RigError(
            f"{log}: found no row with all of {', '.join(quantities)}, expected still poses with all of them"
        )
    if own and 2 * common.sum() <= max(whole[kind].sum() for kind in own):
        own = own if timed is None else []  # each in rows of its own: several rates

    wrong, said = [], []
    present = np.any([np.zeros(n, dtype=bool), *(cells[kind].any(axis=1) for kind in own)], axis=0)
    blank = ~np.any([finite.any(axis=1) for finite in cells.values()], axis=0)
    # a row without any of them is another rate's, unless it is nobody's
    missing = there & ~common & (present | blank) if own else np.zeros(n, dtype=bool)
    if missing.any():
        words = _columns([(quantities[kind][0], cells[kind]) for kind in own], missing)
        wrong.append(f"{log}: {missing.sum()} of {n} rows left out, in which a cell holds no number: {words}")
    for kind, finite in cells.items():
        if kind in own:
            whole[kind] = common
            continue
        partial = there & finite.any(axis=1) & ~whole[kind]
        if partial.any():
            words = _columns([(quantities[kind][0], finite)], partial)
            logged = (there & finite.any(axis=1)).sum()
            left = f"{partial.sum()} of {logged} rows of {kind} left out"
            wrong.append(f"{log}: {left}, in which a cell holds no number: {words}")
        if kind in _SLOW and whole[kind].sum() < common.sum() < 2 * whole[kind].sum():
            said.append(f"{log}: {kind} is missing in {(common & ~whole[kind]).sum()} of {n} rows: interpolated there")
    return whole, int(missing.sum()), wrong, said


def _columns(groups: Sequence[tuple[Sequence[str], Mask]], rows: Mask) -> str:
    """Each column without a number in some of these rows, how many and which."""
    words = []
    for names, finite in groups:
        for name, good in zip(names, finite.T, strict=True):
            bad = np.flatnonzero(rows & ~good)
            if len(bad):
                words.append(f"{name} (row {bad[0]})" if len(bad) == 1 else f"{name} ({len(bad)}, first row {bad[0]})")
    more = f" and {len(words) - _NAMED} more columns" if len(words) > _NAMED else ""
    return ", ".join(words[:_NAMED]) + more + "; rows are counted from 0"
