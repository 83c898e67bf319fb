"""JSON in and out, with the place of every complaint."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, Final

import numpy as np

from rig.arrays import Array
from rig.documents import plain
from rig.errors import RigError, nearest, shown

#: By so much, beside the largest variance, a covariance may be off in its last digits.
_ROUNDED: Final = 1e-9


class AsJson:
    """A dataclass whose JSON object is its fields."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object; what is not known is null."""
        return {item.name: plain(getattr(self, item.name)) for item in fields(self)}  # type: ignore[arg-type]


def dump(content: Mapping[str, Any]) -> str:
    """Indented JSON, lists of plain values on one line."""
    text = json.dumps(content, indent=1, allow_nan=False)
    # Line breaks stand between values only: inside a text they are written as \\n.
    plain_list = re.compile(r"\[\n[^\[\]{}\"]*\]")
    return plain_list.sub(lambda match: "[" + re.sub(r"\n\s*", " ", match[0][1:-1]).strip() + "]", text) + "\n"


class Reader:
    """A JSON object that is asked for what it should hold.

    Attributes:
        content: the object.
        where: its place, which begins every message.

    Every method raises a RigError that says what was found and expected.
    """

    def __init__(self, content: Any, where: str) -> None:
        if not isinstance(content, dict):
            raise RigError(f"{where}: found {shown(content)}, expected an object")
        self.content: dict[str, Any] = content
        self.where = where

    def _get(self, name: str) -> Any:
        if name not in self.content:
            raise RigError(f"{self.where}: no {name!r}{nearest(name, self.content)}")
        return self.content[name]

    def within(self, name: str) -> Reader:
        """An object inside this one."""
        return Reader(self._get(name), f"{self.where}.{name}")

    def optional(self, name: str) -> Reader | None:
        """An object inside this one, None where it is absent or null."""
        return None if self.content.get(name) is None else self.within(name)

    def items(self, name: str) -> Iterator[Reader]:
        """The objects of a list."""
        values = self._get(name)
        if not isinstance(values, list):
            raise RigError(f"{self.where}.{name}: found {shown(values)}, expected a list")
        for index, value in enumerate(values):
            yield Reader(value, f"{self.where}.{name}[{index}]")

    def plain(self, name: str) -> Any:
        """Anything, None where it is absent."""
        return self.content.get(name)

    def text(self, name: str, missing: str | None = None) -> str:
        """A text."""
        value = self.content.get(name, missing) if missing is not None else self._get(name)
        if not isinstance(value, str):
            raise RigError(f"{self.where}.{name}: found {shown(value)}, expected a text")
        return value

    def optional_text(self, name: str) -> str | None:
        """A text, None where it is absent or null."""
        return None if self.content.get(name) is None else self.text(name)

    def strings(self, name: str, missing: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """A list of texts."""
        value = self.content.get(name, missing) if missing is not None else self._get(name)
        if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
            raise RigError(f"{self.where}.{name}: found {shown(value)}, expected a list of texts")
        return tuple(value)

    def number(self, name: str, missing: float | None = None) -> float:
        """A number; null, or nothing, is ``missing`` where that is given."""
        value = self.content.get(name) if missing is not None else self._get(name)
        if value is None and missing is not None:
            return missing
        return _number(value, f"{self.where}.{name}")

    def whole(self, name: str) -> int:
        """A number of things: whole and not negative."""
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise RigError(f"{self.where}.{name}: found {shown(value)}, expected a whole number, not negative")
        return value

    def array(
        self, name: str, shape: tuple[int, ...], missing: float | None = None, *, required: bool = False
    ) -> Array:
        """An array of numbers; null, inside or in its place, is ``missing`` where that is given, and so is nothing
        unless it is ``required``."""
        value = self.content.get(name) if missing is not None and not required else self._get(name)
        if value is None and missing is not None:
            return np.full(shape, missing)
        return np.array(_nested(value, shape, f"{self.where}.{name}", missing), dtype=float).reshape(shape)

    def covariance(self, name: str, count: int, *, required: bool = False) -> Array:
        """A covariance (count, count), NaN in whole rows and columns where it is null; all of it if it is absent."""
        found = self.array(name, (count, count), missing=math.nan, required=required)
        variance = np.diagonal(found)
        told = np.isfinite(variance)
        whole = np.array_equal(np.isfinite(found), np.outer(told, told))
        sigma = np.sqrt(np.where(told, variance, 0.0).clip(0.0))
        slack = _ROUNDED * (np.outer(sigma, sigma) + np.max(sigma, initial=0.0) ** 2)
        too_large = np.abs(found) > np.outer(sigma, sigma) + slack
        if not whole or (variance < 0.0).any() or too_large.any() or (np.abs(found - found.T) > slack).any():
            raise RigError(
                f"{self.where}.{name}: is no covariance, expected variances and covariances that go together, and null"
                " in whole rows and columns"
            )
        return found

    def numbers(self, name: str) -> dict[str, float]:
        """An object of numbers, null being NaN; empty where it is absent."""
        inside = self.optional(name)
        return {} if inside is None else {key: inside.number(key, missing=math.nan) for key in inside.content}


def _nested(value: Any, shape: tuple[int, ...], where: str, missing: float | None) -> Any:
    if not shape:
        return missing if value is None and missing is not None else _number(value, where)
    if not isinstance(value, list) or len(value) != shape[0]:
        raise RigError(f"{where}: found {shown(value)}, expected a list of {shape[0]}")
    return [_nested(item, shape[1:], f"{where}[{index}]", missing) for index, item in enumerate(value)]


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RigError(f"{where}: found {shown(value)}, expected a finite number")
    return float(value)
