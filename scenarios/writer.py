"""Scenarios as TOML text; numbers are written so that they read back the same."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

#: What a file writes for None, which TOML does not have.
NONE = "none"


def toml_value(value: Any) -> str:
    """A number, text, truth value, None or (nested) sequence of these as TOML.

    Raises:
        TypeError: anything else.
    """
    if value is None:
        return json.dumps(NONE)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, Sequence):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    raise TypeError(f"{type(value).__name__} has no place in a scenario")


def toml_table(header: str, values: Mapping[str, Any]) -> str:
    """A table with its header line (empty for the top of the file)."""
    lines = [header] if header else []
    lines += [f"{key} = {toml_value(value)}" for key, value in values.items()]
    return "\n".join(lines) + "\n"


def toml_document(tables: Iterable[tuple[str, Mapping[str, Any]]]) -> str:
    """Tables one below the other."""
    return "\n".join(toml_table(header, values) for header, values in tables)


def set_fields(item: Any) -> dict[str, Any]:
    """The fields of a dataclass that differ from their defaults, in the order of the class."""
    values = {field.name: getattr(item, field.name) for field in dataclasses.fields(item) if field.init}
    defaults = {field.name: field.default for field in dataclasses.fields(item)}
    return {name: value for name, value in values.items() if value != defaults[name]}
