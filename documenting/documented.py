"""What the docstring of a dataclass says of its attributes, for pages and schemas that are made from the code."""

from __future__ import annotations

import dataclasses
import inspect
import re


def attribute_texts(cls: type) -> dict[str, str]:
    """Name -> what the section "Attributes" of a class' docstring says.

    "a, b: text" is of both. A sentence that begins with the name of another field and a colon begins that field's
    text: "a: one thing. b: another."
    """
    text = inspect.getdoc(cls) or ""
    section = re.search(r"Attributes:\n((?:[ ]+.*\n?|\n)+)", text)
    entries: list[tuple[str, str]] = []
    for line in section[1].splitlines() if section else ():
        if not line.strip():
            break
        entry = re.fullmatch(r"    (\w[\w, ]*): (.*)", line)
        if entry:
            entries.append((entry[1], entry[2].strip()))
        elif entries:
            names, said = entries[-1]
            entries[-1] = (names, f"{said} {line.strip()}")
    found: dict[str, str] = {}
    for names, said in entries:
        for each, own in _parted(names, said, {item.name for item in dataclasses.fields(cls)}):
            found |= dict.fromkeys((name.strip() for name in each.split(",")), own)
    return found


def _parted(names: str, text: str, fields: set[str]) -> list[tuple[str, str]]:
    """Names and text of an entry, cut before each sentence that begins with fields' names and a colon."""
    parts: list[tuple[str, str]] = []
    begin = 0
    for rest in re.finditer(r"(?<=\.) (\w+(?:, \w+)*): ", text):
        if set(rest[1].split(", ")) <= fields:
            parts.append((names, text[begin : rest.start()]))
            names, begin = rest[1], rest.end()
    return [*parts, (names, text[begin:])]
