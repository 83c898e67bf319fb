"""What JSON Schemas are made of: objects, arrays and tables, and the schema of a dataclass."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, Final, Literal, Union

from documenting.documented import attribute_texts

Schema = dict[str, Any]

NUMBER: Final[Schema] = {"type": "number"}
TOLD: Final[Schema] = {"type": ["number", "null"]}
WHOLE: Final[Schema] = {"type": "integer"}
TEXT: Final[Schema] = {"type": "string"}
TEXT_OR_NONE: Final[Schema] = {"type": ["string", "null"]}
YES: Final[Schema] = {"type": "boolean"}
ANY: Final[Schema] = {}
_TYPES: Final[dict[Any, str]] = {float: "number", int: "integer", str: "string", bool: "boolean", type(None): "null"}


def object_of(required: Mapping[str, Schema], optional: Mapping[str, Schema] = types.MappingProxyType({})) -> Schema:
    """An object with these keys and no others."""
    return {
        "type": "object",
        "properties": {**required, **optional},
        "required": list(required),
        "additionalProperties": False,
    }


def open_(schema: Schema) -> Schema:
    """An object that may have further keys, which are kept."""
    return {**schema, "additionalProperties": True}


def list_of(items: Schema, count: int | None = None) -> Schema:
    """An array, of so many items."""
    return {"type": "array", "items": items, **({} if count is None else {"minItems": count, "maxItems": count})}


def table_of(values: Schema, *keys: str) -> Schema:
    """An object with keys of the data, or some of these."""
    return {
        "type": "object",
        "additionalProperties": values,
        **({"propertyNames": {"enum": list(keys)}} if keys else {}),
    }


def one_of(*values: str) -> Schema:
    """One of these texts."""
    return {"enum": list(values)}


def or_null(schema: Schema) -> Schema:
    """That, or null."""
    return {"anyOf": [schema, {"type": "null"}]}


def said(schema: Schema, text: str) -> Schema:
    """With what it is."""
    return {**schema, "description": text} if text else schema


def of_class(cls: type, leave_out: tuple[str, ...] = (), **other: Schema) -> Schema:
    """A dataclass as ``asdict`` or ``vars`` write it; ``other``: fields that are written in another way, and more."""
    hints, texts = typing.get_type_hints(cls), attribute_texts(cls)
    own = {item.name: of_type(hints[item.name]) for item in dataclasses.fields(cls) if item.name not in leave_out}
    return object_of({name: said(schema, texts.get(name, "")) for name, schema in {**own, **other}.items()})


def of_type(hint: Any) -> Schema:
    """What a type is in JSON; a number that is not finite is null."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return ANY
    if hint is float:
        return TOLD
    if hint in _TYPES:
        return {"type": _TYPES[hint]}
    if dataclasses.is_dataclass(hint):
        return of_class(typing.cast("type", hint))
    if origin is Literal:
        return one_of(*arguments)
    if origin in (Union, types.UnionType):
        if all(each in _TYPES for each in arguments):
            names = [_TYPES[each] for each in arguments] + ["null"] * (float in arguments)
            return {"type": list(dict.fromkeys(names))}
        return {"anyOf": [of_type(each) for each in arguments]}
    if origin is tuple:
        return list_of(of_type(arguments[0]), None if arguments[-1] is Ellipsis else len(arguments))
    if origin is not None and issubclass(origin, Mapping):
        return table_of(of_type(arguments[1]))
    raise TypeError(f"{hint}: has no schema")
