"""Causes from JSON: a diagnosis, a list of causes or a single one, as effects for a scenario."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

from rig.arm import Arm
from rig.channels import SENSORS
from rig.documents import read_json
from rig.effects import Effect, make_effect, without_nulls
from rig.errors import RigError, nearest, shown
from rig.simulate import unfelt

_FORMAT: Final = "rig-diagnosis/2"
_KEYS: Final = ("effect", "where", "parameters")


def read_causes(
    path: str | os.PathLike[str], arm: Arm | None = None, sensors: Collection[str] = SENSORS
) -> tuple[Effect, ...]:
    """The effects that a file names: a diagnosis' likeliest explanation, a list of causes, or one cause.

    A cause is ``{"effect": .., "where": .., "parameters": {..}}`` with each parameter a number, a list of them, or
    ``{"value": ..}`` as in a diagnosis, whose further keys are passed over. What is null there, because the recording
    did not feel it, is as it was ``fitted``, else as it is by default. A diagnosis without causes gives no effect.
    With an ``arm`` a place may be a joint's own name, and must be one that the arm has; an effect must act on one of
    the ``sensors`` that are there.

    Raises:
        RigError: the file cannot be read, is not JSON, or holds something else.
    """
    file = Path(path)
    document = read_json(file, "a diagnosis or a cause")
    diagnosis = isinstance(document, dict) and "effect" not in document
    if diagnosis:
        if document.get("format") != _FORMAT or not isinstance(document.get("causes"), list):
            raise RigError(
                f"{file}: found keys {shown(', '.join(document)) or 'none'}, "
                f'expected a diagnosis ("format": "{_FORMAT}") with "causes", a list of causes, '
                'or one cause with "effect"'
            )
        document = _leading(document, file)
    if not diagnosis and document == []:
        raise RigError(f"{file}: found an empty list, expected one cause or more")
    causes = document if isinstance(document, list) else [document]
    places = [f"{file}: cause {number}" for number in range(1, len(causes) + 1)]
    found = tuple(_effect(cause, where, arm, strict=not diagnosis) for cause, where in zip(causes, places, strict=True))
    for effect, where in zip(found, places, strict=True):
        if lacking := unfelt(effect, sensors):
            raise RigError(f"{where}: effect {effect.name} at {effect.where}: {lacking}")
    return found


def _leading(document: Mapping[str, Any], file: Path) -> list[Any]:
    """The causes of the likeliest of a diagnosis' hypotheses; all of them where it lists none.

    Raises:
        RigError: the hypotheses are something else than the contract's.
    """
    causes: list[Any] = document["causes"]
    hypotheses = document.get("hypotheses")
    if not causes or hypotheses is None:
        return causes
    first = hypotheses[0] if isinstance(hypotheses, list) and hypotheses else None
    if not isinstance(first, dict) or not isinstance(first.get("causes"), list):
        raise RigError(f'{file}: hypotheses: found {shown(hypotheses)}, expected a list of objects with "causes"')
    left, found = list(first["causes"]), []
    for cause in causes:
        name = [cause.get("effect"), cause.get("where")] if isinstance(cause, dict) else cause
        if not isinstance(cause, dict) or name in left:
            left = [each for index, each in enumerate(left) if index != left.index(name)] if name in left else left
            found.append(cause)
    if left and not found:
        raise RigError(f'{file}: hypotheses[0]: found {shown(left)}, expected what "causes" has')
    return found


def _effect(cause: Any, where: str, arm: Arm | None, strict: bool) -> Effect:
    if not isinstance(cause, dict) or not isinstance(cause.get("effect"), str):
        raise RigError(f'{where}: found {shown(cause)}, expected an object with "effect", "where" and "parameters"')
    for key in cause:
        if strict and key not in _KEYS:
            raise RigError(f"{where}: unknown key {shown(key)}, expected {', '.join(_KEYS)}{nearest(key, _KEYS)}")
    parameters = cause.get("parameters", {})
    if not isinstance(parameters, Mapping):
        raise RigError(f"{where}: parameters: found {shown(parameters)}, expected an object of parameters by name")
    values = {name: _value(given) for name, given in parameters.items()}
    place = {"where": cause["where"]} if "where" in cause else {}
    try:
        return make_effect(cause["effect"], without_nulls(cause["effect"], {**place, **values}), arm)
    except RigError as error:
        raise RigError(f"{where}: {error}") from error


def _value(given: Any) -> Any:
    if not isinstance(given, Mapping) or "value" not in given:
        return given
    return given["value"] if given.get("fitted") is None else given["fitted"]
