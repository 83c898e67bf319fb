"""A table of a TOML file becomes a dataclass, whose fields say which keys there are and what each may hold."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from rig.environment import MAGNITUDES
from rig.errors import RigError, nearest, one_line, shown
from scenarios.writer import NONE, toml_value

Built = TypeVar("Built")

_PLAIN = {float: "a finite number, no extreme one", int: "an integer", str: "a text", bool: "true or false"}


@dataclass(frozen=True)
class Table:
    """A table of a file, with its place for the errors.

    Attributes:
        file: the file as the user named it.
        name: the table's dotted name; empty at the top of the file.
        values: what was read.
    """

    file: str
    name: str
    values: Mapping[str, Any]

    def error(self, message: str) -> RigError:
        """An error that says where it lies; a section that the message itself begins with is not said twice."""
        where = f"[{self.name}] " if self.name else ""
        for section in (self.name, "maneuver"):  # [locked] holds a maneuver
            message = message.removeprefix(f"{section}.")
        return RigError(f"{self.file}: {where}{message}")

    def wrong(self, key: str, expected: str, choices: Sequence[str] = ()) -> RigError:
        """The error for a key whose value is none of the expected ones; ``choices`` are those that are names."""
        value = self.values[key]
        return self.error(f"{key}: found {written(value)}, expected {expected}{nearest(str(value), choices)}")

    def check_keys(self, keys: Sequence[str]) -> None:
        """Raise RigError for the first key that is none of ``keys``."""
        for key, value in self.values.items():
            if key not in keys:
                section = f"unknown section [{self.path(key)}]"
                what = section if isinstance(value, dict) else f"unknown key {key!r} with value {written(value)}"
                raise self.error(f"{what}, expected one of {', '.join(keys)}{nearest(key, keys)}")

    def sub(self, key: str) -> Table:
        """The table under ``key``; an empty one where the file has none.

        Raises:
            RigError: the key holds something else.
        """
        values = self.values.get(key, {})
        if not isinstance(values, dict):
            raise self.wrong(key, f"a table [{self.path(key)}]")
        return Table(self.file, self.path(key), values)

    def path(self, key: str) -> str:
        """The dotted name of a key of this table."""
        return f"{self.name}.{key}" if self.name else key


def build(
    cls: type[Built],
    table: Table,
    *,
    leave_out: Sequence[str] = (),
    also: Sequence[str] = (),
    given: Mapping[str, Any] = types.MappingProxyType({}),
) -> Built:
    """A dataclass from a table whose keys are its fields.

    Args:
        cls: the dataclass; types, defaults and its own checks are the schema.
        table: what was read.
        leave_out: fields that the file cannot set.
        also: further keys to name where one is unknown.
        given: fields that were converted already; the table's own values of these are passed over.

    Raises:
        RigError: an unknown key, a missing one, or a value of the wrong type or refused by the dataclass.
    """
    names = [item.name for item in dataclasses.fields(cls) if item.init and item.name not in leave_out]  # type: ignore[arg-type]
    table.check_keys([*names, *also])
    hints = typing.get_type_hints(cls)
    values = dict(given)
    for item in dataclasses.fields(cls):  # type: ignore[arg-type]
        if item.name in given or item.name not in names:
            continue
        if item.name in table.values:
            try:
                values[item.name] = converted(table.values[item.name], hints[item.name])
            except TypeError:
                hint = hints[item.name]
                choices = typing.get_args(hint) if typing.get_origin(hint) is Literal else ()
                raise table.wrong(item.name, described(hint), list(map(str, choices))) from None
        elif item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING:
            raise table.error(f"{item.name}: is missing, expected {described(hints[item.name])}")
    try:
        return cls(**values)
    except RigError as error:
        raise table.error(str(error)) from error


def converted(value: Any, hint: Any) -> Any:
    """The value as the type of a field; lists become tuples, integers numbers, ``"none"`` None.

    Raises:
        TypeError: it is of another type.
    """
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if type(None) in parts and value == NONE:
            return None
        return _first(value, [part for part in parts if part is not type(None)])
    if origin is Literal:
        if value in parts:
            return value
    elif origin is tuple and isinstance(value, list):
        if len(parts) == 2 and parts[1] is Ellipsis:
            return tuple(converted(item, parts[0]) for item in value)
        if len(parts) == len(value):
            return tuple(converted(item, part) for item, part in zip(value, parts, strict=True))
    elif hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        if value == 0 or MAGNITUDES[0] <= abs(value) <= MAGNITUDES[1]:
            return float(value)
    elif (hint is int and isinstance(value, int) and not isinstance(value, bool)) or (
        hint in (str, bool) and isinstance(value, hint)
    ):
        return value
    raise TypeError


def _first(value: Any, hints: Sequence[Any]) -> Any:
    for hint in hints:
        try:
            return converted(value, hint)
        except TypeError:
            continue
    raise TypeError


def described(hint: Any) -> str:
    """What a field may hold, in words."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(written(NONE) if part is type(None) else described(part) for part in parts)
    if origin is Literal:
        return "one of " + ", ".join(written(part) for part in parts)
    if origin is tuple:
        count = "a list of" if parts[-1] is Ellipsis else f"a list of {len(parts)}"
        return f"{count} numbers" if parts[0] in (int, float) else f"{count} entries, each {described(parts[0])}"
    return _PLAIN.get(hint, str(hint))


def written(value: Any) -> str:
    """A value as TOML writes it, kept short for a message."""
    try:
        return one_line(toml_value(value), 60)
    except TypeError:  # a date or a table: as Python shows it
        return shown(value)
