"""What a recording cannot tell, in words, and what of that another maneuver would."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.by_channel import ABSORBED
from scenarios.terminal.tables import shortened

#: Why an offset of the first or the last joint is not told, on any maneuver.
_FREEDOM: Final = (
    "on any maneuver the same as another azimuth of the fields, or another turn of the sensor on the tool: the "
    "calibration's own freedom"
)
#: The A465's joints; another arm's are known by their names, or by what its calibration absorbs.
_JOINTS: Final = 6


def grouped_untold(diagnosis: Diagnosis) -> dict[str, list[str]]:
    """What the recording cannot tell, by the reason: effects each with their places."""
    found: dict[str, dict[str, list[str]]] = {}
    for each in diagnosis.cannot_tell:
        why = _FREEDOM if _is_freedom(diagnosis, each) else each["why"]
        places = found.setdefault(why, {}).setdefault(each["effect"], [])
        if each["where"] not in places:
            places.append(each["where"])
    return {
        why: [f"{effect} ({shortened(places)})" for effect, places in effects.items()] for why, effects in found.items()
    }


def another_maneuver_tells(diagnosis: Diagnosis) -> bool:
    """Whether the calibration absorbs any effect that it need not on another maneuver."""
    return any(each["why"] == ABSORBED and not _is_freedom(diagnosis, each) for each in diagnosis.cannot_tell)


def _is_freedom(diagnosis: Diagnosis, each: Mapping[str, str]) -> bool:
    """Whether an effect only turns the fields about the first joint, or the sensor about the last."""
    absorbed = [one for one in diagnosis.cannot_tell if one["effect"] == "joint_offset" and one["why"] == ABSORBED]
    numbers = {number for one in absorbed if (number := _joint(diagnosis, one["where"])) is not None}
    named = [number for place in diagnosis.names if (number := _joint(diagnosis, place)) is not None]
    last = max([*numbers, *(named or [_JOINTS])])
    return each in absorbed and _joint(diagnosis, each["where"]) in (1, last)


def _joint(diagnosis: Diagnosis, where: str) -> int | None:
    """The number of a joint, given by its place or by its own name; None where it is no joint."""
    places = {own: place for place, own in diagnosis.names.items()}
    found = re.fullmatch(r"joint(\d+)", places.get(where, where))
    return None if found is None else int(found[1])
