"""Pages in Markdown, made of blocks: paragraphs, headings, pictures, lists and tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


def page_of(blocks: Iterable[str]) -> str:
    """The text of a page: an empty line between each two blocks."""
    return "\n\n".join(blocks) + "\n"


def list_of(items: Iterable[str]) -> str:
    """A list, an item a line."""
    return "\n".join(f"- {item}" for item in items)


def table_of(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = [header, ["---"] * len(header), *([cell.replace("|", "&#124;") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


@dataclass(frozen=True)
class Table:
    """A table: its heading, the titles of its columns, and its rows of text."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def blocks(self) -> tuple[str, str]:
        """Heading and table."""
        return f"### {self.heading}", table_of(self.columns, self.rows)
