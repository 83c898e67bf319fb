"""The reference page of the formats is what the code says, and names everything that can be written."""

from __future__ import annotations

from pathlib import Path

from documenting.formats_page import page
from rig.effects import EFFECTS
from rig.maneuver import MANEUVERS
from rig.units import UNITS

PAGE = Path(__file__).parents[1] / "docs" / "formats.md"


def test_the_page_is_not_stale() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m documenting.formats_page docs/formats.md"


def test_every_name_has_its_place() -> None:
    text = page()
    named = [*EFFECTS, *MANEUVERS, *(unit for units in UNITS.values() for unit in units)]
    assert not [name for name in named if name not in text]
    assert PAGE.with_suffix(".png").is_file()
