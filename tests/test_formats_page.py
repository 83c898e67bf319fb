"""The reference page of the formats is what the code says, and names everything that can be written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from documenting.documented import attribute_texts
from documenting.formats_page import page
from rig.effects import EFFECTS
from rig.maneuver import MANEUVERS
from rig.units import UNITS

PAGE = Path(__file__).parents[1] / "docs" / "formats.md"


def test_the_page_is_not_stale() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m documenting.formats_page docs/formats.md"


def test_every_row_says_what_it_is() -> None:
    rows = [line for line in page().splitlines() if line.startswith("| `")]
    assert [row for row in rows if row.endswith("|  |") or "``" in row] == []


@dataclass
class _Documented:
    """Three fields.

    Attributes:
        a, b: both. Of two sentences. c: a third,
            told on two lines: with a colon.
    """

    a: int
    b: int
    c: int


def test_a_sentence_of_a_docstring_belongs_to_the_attribute_that_it_names() -> None:
    both = "both. Of two sentences."
    assert attribute_texts(_Documented) == {"a": both, "b": both, "c": "a third, told on two lines: with a colon."}


def test_every_name_has_its_place() -> None:
    text = page()
    named = [*EFFECTS, *MANEUVERS, *(unit for units in UNITS.values() for unit in units)]
    assert not [name for name in named if name not in text]
    assert PAGE.with_suffix(".png").is_file()
