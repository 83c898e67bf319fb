"""The columns of a recording: their names, units and what must go together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from rig.channels import CHANNELS_OF, SENSORS
from rig.errors import RigError, nearest, shortened
from rig.recording.metadata import misspelt
from rig.units import UNITS

TIME: Final = "t_s"
QUATERNION: Final = ("tool_qw", "tool_qx", "tool_qy", "tool_qz")
POSITION: Final = ("tool_x_m", "tool_y_m", "tool_z_m")
TEMPERATURE: Final = "temperature_degC"
SUPPLY: Final = "supply_V"

#: Arms whose number of joints is known without a model, so that a recording that lacks one is found out.
JOINTS_OF_ARM: Final[Mapping[str, int]] = {"a465": 6}

_JOINT: Final = re.compile(r"q([1-9]\d{0,2})_(rad|deg|m)")
_CURRENT: Final = re.compile(r"current([1-9]\d{0,2})_A")
_READING: Final = re.compile(r"(accel[123]|mag[123])_(.*)")
_SENSOR_OF: Final = {channel: sensor for sensor, channels in CHANNELS_OF.items() for channel in channels}
_RATE: Final = re.compile(r"q\d+_(rad|deg)_s2?")  # a joint's velocity or acceleration: another quantity, though near
_FIXED: Final = frozenset((TIME, *QUATERNION, *POSITION, TEMPERATURE, SUPPLY))

#: Names that can only be a recording's columns, misspelt or in another unit: not to be passed over in silence.
_MEANT: Final = re.compile(r"(accel|mag)[123](_.*)?|q\d+(_(rad|deg)[a-z]*)?|tool_(q[^_]*|[xyz](_.*)?)", re.IGNORECASE)
#: The same, unless the quantity is there in its own unit.
_MEANT_IF_ABSENT: Final = re.compile(r"(temperature|supply|current\d+)(_[^_]*)?", re.IGNORECASE)
#: Every valid name, of up to 9 joints: what a misspelt one is compared with.
_VALID: Final = (
    *_FIXED,
    *(f"q{joint}_{unit}" for unit in ("rad", "deg") for joint in range(1, 10)),
    *(f"current{joint}_A" for joint in range(1, 10)),
    *(f"{channel}_{unit}" for channel, sensor in _SENSOR_OF.items() for unit in UNITS[sensor]),
)


@dataclass(frozen=True)
class Columns:
    """Which columns of a table make the recording.

    Attributes:
        joints: per joint the column and whether it is in degrees, in joint order; one that slides is in m.
        tool: whether the quaternion's columns are there; position: whether the position's are.
        readings: sensor -> its three columns.
        units: sensor -> the unit its three columns share.
        currents: joint number -> column.
        temperature, supply: whether they are there.
    """

    joints: tuple[tuple[str, bool], ...] = ()
    tool: bool = False
    position: bool = False
    readings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    currents: Mapping[int, str] = field(default_factory=dict)
    temperature: bool = False
    supply: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """All columns, in the order in which they are written."""
        return (
            TIME,
            *(name for name, _ in self.joints),
            *(QUATERNION if self.tool else ()),
            *(POSITION if self.position else ()),
            *(name for sensor in SENSORS for name in self.readings.get(sensor, ())),
            *((TEMPERATURE,) if self.temperature else ()),
            *self.currents.values(),
            *((SUPPLY,) if self.supply else ()),
        )

    @property
    def slides(self) -> tuple[int, ...]:
        """The numbers of the joints that slide."""
        return tuple(joint for joint, (name, _) in enumerate(self.joints, start=1) if name.endswith("_m"))

    @classmethod
    def parse(cls, names: Sequence[str], where: str, joints: int | None = None) -> Columns:
        """Find the recording's columns among those of a table; unrelated ones are passed over.

        Args:
            names: the table's column names.
            where: the file, with which messages begin.
            joints: how many joints the arm has, where that is known; a recording with joint angles needs all of them.

        Raises:
            RigError: no time, a column twice, a name that is nearly valid, a partial pose, a sensor without its three
                axes or with several units, no sensor at all.
        """
        recognised = [name for name in names if _is_valid(name, where)]
        for name, count in Counter(recognised).items():
            if count > 1:
                raise RigError(f"{where}: column {name!r} occurs {count} times, expected once")
        present = set(recognised)
        for name in names:
            _refuse_misspelt(name, present, where)
        if not present:
            found = f"columns {shortened(', '.join(names), 60)}" if any(names) else "no line of columns"
            raise RigError(f"{where}: found {found}, none of a recording: rig import makes one of such a log")
        if TIME not in present:
            near = nearest(TIME, names) or ': only with "still_poses": true in the metadata may it be left out'
            raise RigError(f"{where}: column {TIME!r} is missing{near}")
        readings, units = _readings(recognised, where)
        columns = cls(
            joints=_joints(recognised, where),
            tool=_group(QUATERNION, present, where),
            position=_group(POSITION, present, where),
            readings=readings,
            units=units,
            currents=_numbered(_CURRENT, recognised),
            temperature=TEMPERATURE in present,
            supply=SUPPLY in present,
        )
        if columns.position and not columns.tool:
            raise RigError(f"{where}: partial pose: found {POSITION[0]}.. without {', '.join(QUATERNION)}")
        count = len(columns.joints)
        if joints is not None and count not in (0, joints) and not columns.tool:
            what = f"partial pose: q{count + 1}_rad is missing" if count < joints else "too many joint angles"
            raise RigError(f"{where}: {what}, found q1..q{count}, expected q1..q{joints} of the arm's {joints} joints")
        return columns


def _is_valid(name: str, where: str) -> bool:
    reading = _READING.fullmatch(name)
    if reading is None:
        return name in _FIXED or bool(_JOINT.fullmatch(name) or _CURRENT.fullmatch(name))
    channel, unit = reading.groups()
    units = UNITS[_SENSOR_OF[channel]]
    if unit not in units:
        meant = misspelt(unit, units)
        near = f" (nearest: {channel + '_' + meant!r})" if meant else ""
        raise RigError(f"{where}: column {name!r}: unknown unit {unit!r}, expected one of {', '.join(units)}{near}")
    return True


def _refuse_misspelt(name: str, present: set[str], where: str) -> None:
    if name in present:
        return
    meant = misspelt(name, set(_VALID) - present)
    if _MEANT_IF_ABSENT.fullmatch(name):
        stem = name.split("_")[0]
        surely = not any(other.split("_")[0] == stem for other in present)
    else:
        surely = _MEANT.fullmatch(name) is not None
    if surely or (meant is not None and not _RATE.fullmatch(name)):
        near = f" (nearest: {meant!r})" if meant else nearest(name, _VALID)
        raise RigError(f"{where}: unknown column {name!r}{near}")


def _numbered(pattern: re.Pattern[str], names: Iterable[str]) -> dict[int, str]:
    """Number -> column, in the order of the numbers."""
    matches = (pattern.fullmatch(name) for name in names)
    return dict(sorted((int(match[1]), match[0]) for match in matches if match))


def _joints(names: Sequence[str], where: str) -> tuple[tuple[str, bool], ...]:
    found = _numbered(_JOINT, names)
    if len(found) < sum(_JOINT.fullmatch(name) is not None for name in names):
        raise RigError(f"{where}: a joint occurs in rad and in deg, or in m beside these: expected one of them")
    for joint in range(1, len(found) + 1):
        if joint not in found:
            raise RigError(f"{where}: partial pose: q{joint}_rad is missing, found {', '.join(found.values())}")
    return tuple((name, name.endswith("_deg")) for name in found.values())


def _group(group: Sequence[str], present: set[str], where: str) -> bool:
    missing = [name for name in group if name not in present]
    if missing and len(missing) < len(group):
        raise RigError(f"{where}: partial pose: {missing[0]} is missing, expected {', '.join(group)}")
    return not missing


def _readings(names: Sequence[str], where: str) -> tuple[dict[str, tuple[str, ...]], dict[str, str]]:
    readings: dict[str, tuple[str, ...]] = {}
    units: dict[str, str] = {}
    for sensor, channels in CHANNELS_OF.items():
        found = {name: name.split("_", 1) for name in names if name.split("_", 1)[0] in channels}
        if not found:
            continue
        sensor_units = sorted({unit for _, unit in found.values()})
        if len(sensor_units) > 1:
            raise RigError(f"{where}: {sensor} columns have the units {', '.join(sensor_units)}, expected one unit")
        expected = tuple(f"{channel}_{sensor_units[0]}" for channel in channels)
        if missing := [name for name in expected if name not in found]:
            raise RigError(f"{where}: {sensor} column {missing[0]!r} is missing, expected {', '.join(expected)}")
        readings[sensor], units[sensor] = expected, sensor_units[0]
    if not readings:
        raise RigError(f"{where}: no sensor readings, expected accel1_V..accel3_V or mag1_V..mag3_V (or another unit)")
    return readings, units
