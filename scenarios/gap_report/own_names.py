"""A diagnosis in the names that the arm's own file gives its joints."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from estimators.gap.diagnosis import Diagnosis

_JOINT = re.compile(r"\bjoint ?(\d+)\b")
#: What of a diagnosis speaks of places.
_SPEAKING = ("hypotheses", "at_least_one", "causes", "follows", "remainder", "cannot_tell", "next", "warnings")


def in_own_names(diagnosis: Diagnosis) -> Diagnosis:
    """The same diagnosis for a reader: ``joint5`` and "joint 5" are "wrist_2_joint" where the arm calls it that.

    For words only: the catalogue, and files that other programs read, go by the places.
    """
    if not diagnosis.names:
        return diagnosis
    return replace(diagnosis, **{key: _renamed(getattr(diagnosis, key), diagnosis.names) for key in _SPEAKING})


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    if isinstance(value, str):
        return _JOINT.sub(lambda found: names.get(f"joint{found[1]}", found[0]), value)
    if isinstance(value, Mapping):
        return {key: _renamed(each, names) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_renamed(each, names) for each in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{each.name: _renamed(getattr(value, each.name), names) for each in fields(value)})
    return value
