"""Tables for people, drawn by rich."""

from __future__ import annotations

import errno
import inspect
import os
import sys
import unicodedata
from collections.abc import Iterable, Iterator
from typing import Any, Final

from rich import box
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from rig.effects import Effect
from rig.number_text import with_std
from scenarios.writer import toml_table

#: Width where the output is no terminal, which would tell its own.
_WIDTH: Final = 118

_PARAMETER: Final = ("name", "unit", "typical", "lower", "upper", "size", "strength")

_CHANGES: Final = {
    "mean": "the expected reading",
    "noise": "the readings' covariance",
    "distribution": "the readings' distribution",
}


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Leave it to the command line; rich would end the program with its own status."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Without control characters of its own in a text: names from files do not speak to the terminal."""
        for segment in super().render(renderable, options):
            said = segment.text if segment.control else "".join(filter(_is_visible, segment.text))
            yield segment if said == segment.text else Segment(said, segment.style)


def _is_visible(letter: str) -> bool:
    return letter == "\n" or unicodedata.category(letter) not in ("Cc", "Cf")


def show(*items: RenderableType) -> None:
    """Print on stdout; in colour and as wide as the terminal if it is one."""
    console = _Console(file=sys.stdout, width=None if sys.stdout.isatty() else _WIDTH, highlight=False, emoji=False)
    for item in items:
        console.print(item)


def table(*columns: str, numbers: Iterable[str] = (), rows: Iterable[Iterable[str | Text]] = ()) -> Table:
    """A table of ``rows``, cell by cell as they stand, nothing in them taken for markup.

    Columns named in ``numbers`` are aligned to the right. On a narrow terminal its cells wrap.
    """
    result = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    for column in columns:
        result.add_column(Text(column), justify="right" if column in numbers else "left", overflow="fold")
    for row in rows:
        result.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    return result


def effect_record(effect: type[Effect]) -> dict[str, Any]:
    """An effect of the registry as plain values, for JSON; a bound that is not there is null."""
    return {
        "name": effect.name,
        "kind": effect.kind.value,
        "stage": effect.stage.name.lower(),
        "places": list(effect.places),
        "parameters": [{key: getattr(item, key) for key in _PARAMETER} for item in effect.parameters()],
        "choices": {name: list(choices) for name, choices in effect.choices().items()},
        "description": _description(effect),
    }


def effects_table(effects: Iterable[type[Effect]]) -> Table:
    """All effects: kind, places, parameters with typical size and unit, and what each is."""
    rows = []
    for effect in effects:
        parameters = [
            f"{item.name}{f' ({item.size})' if item.size > 1 else ''} {item.typical:g} {_unit(item.unit)}".rstrip()
            for item in effect.parameters()
        ]
        words = _description(effect).split("\n\n")[0].replace("\n", " ")
        rows.append((effect.name, effect.kind.value, shortened(effect.places), "\n".join(parameters), words))
    return table("effect", "kind", "places", "parameters, typically", "what it is", rows=rows)


def effect_description(effect: type[Effect]) -> Group:
    """One effect in full, and how a scenario adds it."""
    columns = ("numbers", "typical", "lowest", "highest")
    rows = [
        (item.name, item.unit, str(item.size), f"{item.typical:g}", f"{item.lower:g}", f"{item.upper:g}")
        for item in effect.parameters()
    ]
    choices = "".join(f"{name}: one of {', '.join(names)}\n" for name, names in effect.choices().items())
    lines = toml_table(f"[effects.{effect.name}]", example(effect)).splitlines()
    where = f"acts on {effect.stage.name.lower()} at {', '.join(effect.places)}; changes {_CHANGES[effect.kind.value]}"
    return Group(
        Text(effect.name, style="bold"),
        Text(f"{where}\n\n{_description(effect)}\n"),
        table("parameter", "unit", *columns, numbers=columns, rows=rows),
        Text(f"\n{choices}In a scenario:\n"),
        Text("\n".join(f"    {line}" for line in lines)),
    )


def example(effect: type[Effect]) -> dict[str, Any]:
    """The table of an effect of typical size at its first place, as a scenario has it."""
    choices = {name: names[-1] for name, names in effect.choices().items()}
    sizes = {item.name: item.typical if item.size == 1 else [item.typical] * item.size for item in effect.parameters()}
    return {"where": effect.places[0], **choices, **sizes}


def _description(effect: type[Effect]) -> str:
    return inspect.getdoc(effect) or ""


def _unit(unit: str) -> str:
    return "" if unit == "relative" else unit


def shortened(places: Iterable[str]) -> str:
    """Places with runs of numbers joined: joint1-6, accel1-3."""
    runs: list[tuple[str, int, int]] = []
    for place in places:
        stem = place.rstrip("0123456789")
        number = int(place[len(stem) :]) if place != stem else 0
        if runs and number and runs[-1][0] == stem and runs[-1][2] == number - 1:
            runs[-1] = (stem, runs[-1][1], number)
        else:
            runs.append((stem, number, number))
    return ", ".join(
        stem + ("" if not first else str(first) if first == last else f"{first}-{last}") for stem, first, last in runs
    )


def plus_minus(value: float, sigma: float | None, sign: str = " ± ") -> str:
    """A value with its standard deviation, as in ``85.309 ± 0.013``; in brackets what cannot be told."""
    text, spread = with_std(value, sigma)
    return f"({value:.4g})" if spread == "–" else f"{text}{sign}{spread}"
