"""Tables in Markdown, and rows of published tables among them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from validation.paper.rows import Row, number

_SYMBOLS: Final = {
    "beta": "β",
    "gamma": "γ",
    "sensitivity": "S",
    "offset": "δ",
    "phi": "φ",
    "psi": "ψ",
    "phi, psi": "φ, ψ",
    "angle between": "angle",
    "three tests": "",
}


def published_rows(rows: Sequence[Row]) -> Iterator[str]:
    """Rows of one published table beside the rig."""
    table = [
        (
            f"{_SYMBOLS.get(row.quantity, row.quantity)} {row.item}".strip(),
            row.unit,
            row.published,
            number(row.rig, row.rig_std),
            row.basis,
            row.verdict,
        )
        for row in rows
    ]
    yield from markdown(("", "unit", "published", "the rig", "rests on", "verdict"), table)


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """The lines of a table."""
    yield f"| {' | '.join(header)} |"
    yield f"|{' --- |' * len(header)}"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', '&#124;') for cell in row)} |"
    yield ""
