"""A mapping file of ``rig import`` for lines that come one by one."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rig.errors import RigError
from rig.recording import Metadata
from rig.recording.metadata import FIELD_SIZES
from scenarios.importing.mapping import Mapping, read_mapping
from scenarios.importing.quantities import TIME_UNITS, parse_target

#: What a stream can be calibrated from as it comes -> the recording's name for it.
_NAMES: Final = {
    "accel": "accel{part}_{unit}",
    "mag": "mag{part}_{unit}",
    "joint": "q{part}_{unit}",
    "quaternion": "tool_q{part}",
    "position": "tool_{part}_{unit}",
    "current": "current{part}_{unit}",
    "temperature": "temperature_{unit}",
    "supply": "supply_{unit}",
}


def renamed(path: Path) -> tuple[dict[str, tuple[str, float]], Metadata]:
    """Name in the lines -> the recording's name and the factor that makes its unit; and what the mapping states.

    Raises:
        RigError: the mapping cannot be read, or asks for what takes a whole log: ``rig import`` does that.
    """
    mapping = read_mapping(path)
    if mapping.conventions.rotation != "base<-tool" or mapping.conventions.angles != "joints":
        raise _whole(path, "another convention of the pose")
    found = {name: _column(path, mapping, text) for name, text in mapping.columns.items()}
    known = {
        key: value for key, value in mapping.metadata.known.items() if key in (*FIELD_SIZES, "magnetic_field_unit")
    }
    if (reads := mapping.conventions.accelerometer_reads) != "detect":
        known["accelerometer_reads"] = reads
    return found, Metadata(**known, assumed=tuple(name for name in FIELD_SIZES if name not in known))


def _column(path: Path, mapping: Mapping, text: str) -> tuple[str, float]:
    target = parse_target(text)
    assert target is not None  # read_mapping has refused it
    if target.kind == "time":
        unit = mapping.conventions.time_unit
        if unit == "guess":
            raise RigError(f"{path}: time_unit: found 'guess', expected s, ms, us or ns of a stream")
        return "t_s", target.factor * TIME_UNITS[unit]
    if target.kind not in _NAMES:
        raise _whole(path, text)
    return _NAMES[target.kind].format(part=target.part, unit=target.recorded), target.factor


def _whole(path: Path, what: str) -> RigError:
    return RigError(
        f"{path}: found {what}, expected readings, joint angles and quaternions of a stream: rig import takes the rest"
    )
