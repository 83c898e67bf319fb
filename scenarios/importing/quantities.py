"""What a column of a log can be, and what its name and its numbers suggest."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.arrays import Array

Units = dict[str, tuple[str, float]]

#: Unit in a log -> (unit it is recorded in, factor).
ACCELEROMETER_UNITS: Final[Units] = {
    "V": ("V", 1.0), "mV": ("mV", 1.0), "raw": ("raw", 1.0), "g": ("g", 1.0), "mg": ("g", 1e-3), "m_s2": ("m_s2", 1.0),
}  # fmt: skip
MAGNETOMETER_UNITS: Final[Units] = {
    "V": ("V", 1.0), "mV": ("mV", 1.0), "raw": ("raw", 1.0), "G": ("G", 1.0), "mG": ("G", 1e-3),
    "T": ("uT", 1e6), "uT": ("uT", 1.0), "nT": ("nT", 1.0),
}  # fmt: skip
_ANGLES: Final[Units] = {"rad": ("rad", 1.0), "deg": ("rad", float(np.pi / 180.0))}
_JOINTS: Final[Units] = {**_ANGLES, "m": ("m", 1.0)}
_LENGTHS: Final[Units] = {"m": ("m", 1.0), "mm": ("m", 1e-3)}
TIME_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

#: Kind -> what a column of it is called before its unit, with the place of its part; its units.
_KINDS: Final[dict[str, tuple[str, Units]]] = {
    "time": ("t", {}),
    "accel": ("accel{}", ACCELEROMETER_UNITS),
    "mag": ("mag{}", MAGNETOMETER_UNITS),
    "joint": ("q{}", _JOINTS),
    "theta": ("theta{}", _ANGLES),
    "matrix": ("r{}", {}),
    "quaternion": ("q{}", {}),
    "euler": ("euler{}", _ANGLES),
    "position": ("{}", _LENGTHS),
    "temperature": ("temperature", {"degC": ("degC", 1.0)}),
    "supply": ("supply", {"V": ("V", 1.0)}),
    "current": ("current{}", {"A": ("A", 1.0)}),
}
#: Kind -> its parts, in their order, all of which there must be; joints and motor currents are numbered from 1.
PARTS: Final = {
    "accel": tuple("123"),
    "mag": tuple("123"),
    "theta": tuple("156"),
    "matrix": tuple(f"{row}{column}" for row in "123" for column in "123"),
    "quaternion": tuple("wxyz"),
    "euler": tuple("123"),
    "position": tuple("xyz"),
}
_PATTERNS: Final = {
    kind: re.compile(stem.format(f"({'|'.join(PARTS.get(kind, ['[1-9][0-9]?']))})") + (r"_(\w+)" if units else ""))
    for kind, (stem, units) in _KINDS.items()
}
_LISTED: Final = {"joint": tuple("1234567"), "current": ("1",)}

#: Everything that a column can be, for messages.
TARGETS: Final = tuple(
    stem.format(part) + unit
    for kind, (stem, units) in _KINDS.items()
    for unit in ([f"_{unit}" for unit in units] or [""])
    for part in PARTS.get(kind) or _LISTED.get(kind, ("",))
)


@dataclass(frozen=True)
class Target:
    """What a column is.

    Attributes:
        kind: one of a recording's quantities. part: which of its columns; empty where it has but one.
        unit: in the log; empty where it has none. recorded: the unit that it is recorded in.
        factor: what the numbers are multiplied with for that, negative where their sign is turned.
    """

    kind: str
    part: str
    unit: str
    recorded: str
    factor: float


def parse_target(text: str) -> Target | None:
    """A target by its name, with a minus sign before it or not; None where it is none."""
    sign = -1.0 if text.startswith("-") else 1.0
    for kind, pattern in _PATTERNS.items():
        found = pattern.fullmatch(text.removeprefix("-"))
        stem, units = _KINDS[kind]
        unit = found[pattern.groups] if found and units else ""
        if found and (unit in units or not units):
            recorded, factor = units.get(unit, ("", 1.0))
            return Target(kind, found[1] if "{}" in stem else "", unit, recorded, sign * factor)
    return None


def kind_of(text: str) -> str:
    """The kind of a target; empty where it is none."""
    target = parse_target(text)
    return "" if target is None else target.kind


def is_numbered(name: str) -> bool:
    """Whether a column calls its joint by a number alone."""
    return _NUMBERED_JOINT.fullmatch(name.strip()) is not None


_UNIT_WORDS: Final = (
    (r"m/s\^?2|m/s²|m_s2|m s2|mps2|ms-2|ms\^-2|m\.s-2", "m_s2"), (r"milli-?g\b|\bmg\b", "mg"),
    (r"\bgauss\b|\bG\b", "G"), (r"\bmG\b|milligauss", "mG"), (r"[uµμ]T\b|microtesla", "uT"),
    (r"\bnT\b|nanotesla", "nT"), (r"\bT\b|\btesla\b", "T"),
    (r"\bmV\b", "mV"), (r"\bV\b|\bvolts?\b", "V"), (r"\bg'?s?\b", "g"), (r"counts?|\blsb\b|\braw\b", "raw"),
    (r"[Dd]eg(rees?)?\b|°|\b[Gg]rad(i|os?)?\b|degr[ée]s?\b", "deg"),
    (r"(?<![A-Za-z])[Rr]ad(ians?)?\b", "rad"), (r"\bmm\b", "mm"), (r"\bm\b", "m"),
    (r"\bnsecs?\b|\bns\b|nanosec\w*", "ns"), (r"[uµμ]s\b|[uµμ]secs?\b|microsec\w*", "us"),
    (r"\bms\b|msecs?\b|millis\w*", "ms"),
    (r"\bs\b|\bsecs?\b|seconds?", "s"),
)  # fmt: skip


def unit_word(name: str, among: Sequence[str]) -> str:
    """The unit that a column's name ends or is bracketed with, of those among which it must be; empty where none."""
    spaced = re.sub(r"(?<=[A-Za-z0-9])_(?=[A-Za-z])", " ", name)
    for pattern, unit in _UNIT_WORDS:
        if unit in among and (re.search(pattern, spaced) or re.search(pattern, name)):
            return unit
    return ""


def _name(*parts: str) -> re.Pattern[str]:
    return re.compile("".join(parts), re.IGNORECASE)


_TIME: Final = _name(r"t|time.*|timestamp.*|stamp.*|sec|seconds?|epoch.*|clock.*|t[ _(\[].*|date_?time")
_ACCEL: Final = _name(
    r"(.*(acc|accel|acceleration|acel|specific.?force|imu.?a)[^a-z]*.*?(?<![a-z])([xyz123])\b.*",
    r"|(?:.*[^a-z])?(acc|accel)[_ .]?([xyz123])(?![a-z0-9]).*|(?:.*[^a-z])?(a)[_ .]?([xyz])(?![a-z0-9]).*)",
)
_MAG: Final = _name(
    r"(.*(mag|magnetic|magneto|compass|bfield)[^a-z]*.*?(?<![a-z])([xyz123])\b.*",
    r"|(?:.*[^a-z])?(mag)[_ .]?([xyz123])(?![a-z0-9]).*|(?:.*[^a-z])?(m|b|h)[_ .]?([xyz])(?![a-z0-9]).*)",
)
_GYRO: Final = _name(r".*(gyro|angular|omega|rate|vel|speed|torque|effort|force|current|target|cmd|command|desired)")
_MATRIX: Final = _name(r"(?:.*[^a-z])?r(?:ot)?_?\(?([123])[_,]?([123])\)?")
_QUATERNION: Final = _name(
    r"(?:.*[^a-z])?(?:q(?:uat(?:ernion)?)?|orientation|ori|rot(?:ation)?)[_ .]?([wxyz])(?![a-z0-9]).*"
)
_NUMBERED_JOINT: Final = _name(
    r"(?:.*[^a-z])?(?:q|j|joint|jnt|axis|a|theta|pos(?:ition)?|actual_q|angle)[_ .]?(\d\d?)(?![0-9]).*"
)
_EULER: Final = {"yaw": 1, "pitch": 2, "roll": 3, "rz": 1, "ry": 2, "rx": 3, "heading": 1}
_POSITION: Final = _name(r"(?:.*(?:pos|position|tcp|tool|trans|translation)[^a-z]*)?([xyz])(?:[ _\[(](m|mm)\W*)?")


def guess(columns: dict[str, Array], joint_names: Sequence[str] = (), theta: bool = False) -> dict[str, str]:
    """Column -> what it is, by names first and then by ranges; columns that suggest nothing are left out.

    Args:
        columns: of one log.
        joint_names: of the arm, base to sensor; joints are looked for by them first.
        theta: whether theta1, theta5, theta6 are Renk's angles.
    """
    found: dict[str, str] = {}
    _guess_time(columns, found)
    _guess_readings(columns, found)
    _guess_orientation(columns, found)
    if theta:
        for name in columns:
            match = re.fullmatch(r"theta_?([156]).*", name.strip(), re.IGNORECASE)
            if match and name not in found:
                found[name] = f"theta{match[1]}_{_angle_unit(name, columns[name])}"
    else:
        _guess_joints(columns, joint_names, found)
    for name in columns:
        if name not in found and re.search(r"temp", name, re.IGNORECASE):
            found[name] = "temperature_degC"
            break
    return found


def is_time(name: str) -> bool:
    """Whether a column's name says that it holds times."""
    return _TIME.fullmatch(name.strip()) is not None


def _guess_time(columns: dict[str, Array], found: dict[str, str]) -> None:
    """A column by that name, from the first row to the last or, newest first, the other way; in other languages, one in
    a unit of time that rises from row to row."""
    named = [name for name in columns if is_time(name)]
    timed = [name for name in columns if unit_word(name, tuple(TIME_UNITS)) and "/" not in name]
    for names, least in ((named, 0.0), (timed, np.nextafter(0.0, 1.0))):
        for name in names:
            steps = np.diff(columns[name][np.isfinite(columns[name])])
            if len(steps) and ((steps >= least).mean() > 0.99 or (names is named and (steps <= 0.0).mean() > 0.99)):
                found[name] = "t"
                return


def _axis(match: re.Match[str]) -> int:
    letter = next(group for group in reversed(match.groups()) if group and group.lower() in "xyz123")
    return "xyz123".index(letter.lower()) % 3 + 1


def _guess_readings(columns: dict[str, Array], found: dict[str, str]) -> None:
    for sensor, pattern, units in (("accel", _ACCEL, ACCELEROMETER_UNITS), ("mag", _MAG, MAGNETOMETER_UNITS)):
        axes: dict[int, str] = {}
        for name in columns:
            match = pattern.fullmatch(name.strip())
            angle = unit_word(name, ("deg", "rad"))
            if match and name not in found and not angle and not _GYRO.match(name):
                axes.setdefault(_axis(match), name)
        if len(axes) == 3:
            values = np.stack([columns[axes[axis]] for axis in (1, 2, 3)], axis=1)
            unit = unit_word(axes[1], tuple(units)) or _unit_by_size(sensor, values)
            found.update({axes[axis]: f"{sensor}{axis}_{unit}" for axis in (1, 2, 3)})


#: Of gravity and of the Earth's field: unit, and between what the median magnitude is in it.
_SIZES: Final = {
    "accel": (("g", 0.6, 1.6), ("m_s2", 6.0, 14.0), ("mg", 600.0, 1600.0)),
    "mag": (
        ("G", 0.1, 1.2), ("uT", 10.0, 120.0), ("mG", 120.0, 1200.0), ("nT", 10_000.0, 120_000.0), ("T", 1e-5, 1.2e-4),
    ),
}  # fmt: skip


def _unit_by_size(sensor: str, values: Array) -> str:
    good = values[np.isfinite(values).all(axis=1)]
    size = float(np.median(np.linalg.norm(good, axis=1))) if len(good) else np.nan
    return next((unit for unit, low, high in _SIZES[sensor] if low < size < high), "raw")


def _angle_unit(name: str, values: Array) -> str:
    return unit_word(name, ("deg", "rad")) or ("deg" if np.nanmax(np.abs(values), initial=0.0) > 2.1 * np.pi else "rad")


def _guess_orientation(columns: dict[str, Array], found: dict[str, str]) -> None:
    free = [name for name in columns if name not in found]
    matrix = {m[1] + m[2]: name for name in free if (m := _MATRIX.fullmatch(name.strip()))}
    if len(matrix) == 9:
        found.update({name: f"r{part}" for part, name in matrix.items()})
        return
    turns = {m[1].lower(): name for name in free if (m := _QUATERNION.fullmatch(name.strip()))}
    if len(turns) == 4:
        found.update({name: f"q{part}" for part, name in turns.items()})
    else:
        euler: dict[int, str] = {}
        for name in free:
            word = re.sub(r"[^a-z]*(deg|rad|degrees)?[^a-z]*$", "", name.strip().lower())
            if word in _EULER and not _GYRO.match(name):
                euler.setdefault(_EULER[word], name)
        if len(euler) == 3:
            values = np.concatenate([columns[name] for name in euler.values()])
            unit = _angle_unit(euler[1], values)
            found.update({name: f"euler{number}_{unit}" for number, name in euler.items()})
    if any(target[:2] in ("qw", "eu") for target in found.values()):
        places = {m[1].lower(): name for name in free if (m := _POSITION.fullmatch(name.strip())) and name not in found}
        if len(places) == 3:
            unit = "mm" if max(np.nanmax(np.abs(columns[name])) for name in places.values()) > 20.0 else "m"
            found.update({name: f"{axis}_{unit}" for axis, name in places.items()})


def _guess_joints(columns: dict[str, Array], joint_names: Sequence[str], found: dict[str, str]) -> None:
    free = [name for name in columns if name not in found and not _GYRO.match(name)]
    joints: dict[int, str] = {}
    for number, joint in enumerate(joint_names, start=1):
        plain = _plain(joint)
        same = [name for name in free if plain in _plain(name) or _plain(joint.removesuffix("_joint")) in _plain(name)]
        if same:
            joints[number] = min(same, key=len)
    if len(joints) < max(len(joint_names), 1):
        numbered = {int(m[1]): name for name in free if (m := _NUMBERED_JOINT.fullmatch(name.strip()))}
        first = min(numbered, default=1)
        shifted = {number + 1 - min(first, 1): name for number, name in numbered.items()} if first == 0 else numbered
        if len(shifted) >= len(joints) and set(shifted) == set(range(1, len(shifted) + 1)):
            joints = shifted
    if not joints and not joint_names:  # joints by names of their own, in the order of the log
        joints = dict(enumerate((name for name in free if name.startswith("position ")), start=1))
    if not joints or set(joints) != set(range(1, len(joints) + 1)):
        return
    named = {unit_word(name, ("deg", "rad")) for name in joints.values()} - {""}
    values = np.concatenate([columns[name][np.isfinite(columns[name])] for name in joints.values()])
    unit = named.pop() if len(named) == 1 else ("deg" if np.abs(values).max(initial=0.0) > 2.1 * np.pi else "rad")
    found.update({name: f"q{number}_{unit}" for number, name in joints.items()})


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())
