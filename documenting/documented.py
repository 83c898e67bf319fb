"""What the docstring of a dataclass says of its attributes, for pages and schemas that are made from the code."""

from __future__ import annotations

import inspect
import re


def attribute_texts(cls: type) -> dict[str, str]:
    """Name -> what the section "Attributes" of a class' docstring says; "a, b: text" is of both."""
    text = inspect.getdoc(cls) or ""
    section = re.search(r"Attributes:\n((?:[ ]+.*\n?|\n)+)", text)
    found: dict[str, str] = {}
    names: list[str] = []
    for line in section[1].splitlines() if section else ():
        if not line.strip():
            break
        entry = re.fullmatch(r"    ([\w, ]+): (.*)", line)
        if entry:
            names = [name.strip() for name in entry[1].split(",")]
            found |= dict.fromkeys(names, entry[2].strip())
            rest = re.search(r"\. (\w+(?:, \w+)*): ", entry[2])
            if rest:
                found |= {name.strip(): entry[2][rest.end() :] for name in rest[1].split(",")}
        else:
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
    return found
