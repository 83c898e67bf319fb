"""What a recording says about itself, and its JSON form."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime
from numbers import Real
from typing import Any, Final

from rig.channels import ACCELEROMETER, MAGNETOMETER, READS, Reads
from rig.documents import parse_json
from rig.environment import MAGNITUDES
from rig.errors import RigError, check_name, closest, shown
from rig.units import FIELD_UNITS

#: The format of a recording, version included.
FORMAT: Final = "rig-recording/1"

#: What a recording states of gravity and of the magnetic field.
FIELD_SIZES: Final = ("gravity_m_s2", "magnetic_field")
_LONGEST_NAME: Final = 200


@dataclass(frozen=True)
class Metadata:
    """What a recording says about itself.

    Attributes:
        gravity_m_s2: magnitude of gravity [m/s^2]; 9.8 as in Renk et al.
        magnetic_field: magnitude of the magnetic field [field unit]; 1 as in Renk et al.
        magnetic_field_unit: "G", "uT" or "nT"; None: the magnitude is relative, and so is every field found from it.
        rate_Hz: sampling rate [Hz]; None: not stated.
        arm: the arm's name; "none" without an arm.
        notes: free, any JSON value.
        pose_rate_Hz: at which the poses were logged, where that is slower than the readings; None: as fast.
        accelerometer_reads: "g-a", gravity less acceleration, down at rest, as in Renk et al.; or "a-g", up at rest, as
            the common chips do.
        still_poses: whether every row is a pose held still; then `t_s` may be left out, and their numbers stand for it.
        serial: of the arm, which tells it from others of its model; None: not stated.
        recorded: date and time of the first sample, ISO 8601; None: not stated.
        assumed: those of ``gravity_m_s2`` and ``magnetic_field`` that nobody has stated: their defaults stand in.
        findings: what looked wrong where the recording was made, as by ``rig import``, line by line.
        extra: further JSON keys, which are kept as they are.

    Raises:
        RigError: a magnitude or rate that is not positive and finite, an unknown field unit, what JSON cannot hold, a
            further key that is nearly a known one.
    """

    gravity_m_s2: float = 9.8
    magnetic_field: float = 1.0
    rate_Hz: float | None = None
    arm: str = "a465"
    notes: Any = ""
    magnetic_field_unit: str | None = None
    pose_rate_Hz: float | None = None
    accelerometer_reads: Reads = "g-a"
    still_poses: bool = False
    serial: str | int | None = None
    recorded: str | None = None
    assumed: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in FIELD_SIZES:
            object.__setattr__(self, name, _positive(name, getattr(self, name)))
        for name in ("rate_Hz", "pose_rate_Hz"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _positive(name, getattr(self, name)))
        check_name("metadata accelerometer_reads", self.accelerometer_reads, READS)
        if not isinstance(self.still_poses, bool):
            raise RigError(f"metadata still_poses: found {shown(self.still_poses)}, expected true or false")
        if not isinstance(self.arm, str) or not _is_name(self.arm):
            raise RigError(f"metadata arm: found {shown(self.arm)}, expected the name of an arm")
        if self.magnetic_field_unit is not None:
            check_name("metadata magnetic_field_unit", self.magnetic_field_unit, FIELD_UNITS[MAGNETOMETER])
        number = isinstance(self.serial, int) and not isinstance(self.serial, bool) and self.serial.bit_length() <= 256
        if self.serial is not None and not number and not (isinstance(self.serial, str) and _is_name(self.serial)):
            raise RigError(f"metadata serial: found {shown(self.serial)}, expected a text or a number")
        if self.recorded is not None and not _is_moment(self.recorded):
            raise RigError(f"metadata recorded: found {shown(self.recorded)}, expected a date such as 2026-05-31T14:00")
        if not isinstance(self.assumed, list | tuple) or not set(map(str, self.assumed)) <= set(FIELD_SIZES):
            raise RigError(
                f"metadata assumed: found {shown(self.assumed)}, expected a list of {', '.join(FIELD_SIZES)}"
            )
        object.__setattr__(self, "assumed", tuple(self.assumed))
        lines = self.findings
        if not isinstance(lines, list | tuple) or not all(isinstance(line, str) for line in lines):
            raise RigError(f"metadata findings: found {shown(lines)}, expected a list of texts")
        object.__setattr__(self, "findings", tuple(lines))
        object.__setattr__(self, "extra", dict(self.extra))
        if taken := sorted(set(self.extra) & _RESERVED):
            raise RigError(f"metadata extra: found {taken[0]!r}, which has its own field")
        if near := _nearly_known(self.to_json()):
            raise RigError(f"metadata extra: found {near[0]!r}, which is read as {near[1]!r} misspelt")
        self.to_text()  # nothing may be accepted that cannot be written

    def stated_field_unit(self, sensor: str) -> str | None:
        """The unit of a sensor's field: "m_s2", "G", "uT", "nT"; None of a magnetic one that is relative."""
        return "m_s2" if sensor == ACCELEROMETER else self.magnetic_field_unit

    def field_unit(self, sensor: str) -> str:
        """The unit of calibrated readings: "m_s2"; the magnetic field's unit, or "raw" where that is relative."""
        return self.stated_field_unit(sensor) or "raw"

    def magnitude(self, sensor: str) -> float:
        """The stated magnitude of the field that a sensor sees [m/s^2, field unit]."""
        return self.gravity_m_s2 if sensor == ACCELEROMETER else self.magnetic_field

    def to_json(self) -> dict[str, Any]:
        """An object with ``format`` first; keys that say nothing beyond their default None are left out."""
        known = {name: getattr(self, name) for name in _NAMES}
        stated = {name: value for name, value in known.items() if value is not None or name not in _OPTIONAL}
        if self.accelerometer_reads == READS[0]:
            del stated["accelerometer_reads"]
        if not self.still_poses:
            del stated["still_poses"]
        for name in ("assumed", "findings"):
            stated[name] = list(getattr(self, name))
            if not stated[name]:
                del stated[name]
        return {"format": FORMAT, **stated, **self.extra}

    def to_text(self) -> str:
        """``to_json`` in one line.

        Raises:
            RigError: notes or an extra value that JSON cannot hold.
        """
        try:
            return json.dumps(self.to_json(), allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise RigError(f"metadata cannot be written as JSON: {error}") from error

    @classmethod
    def from_text(cls, text: str | bytes, where: str) -> Metadata:
        """Read the JSON of ``to_text``; missing keys have their defaults, unknown ones go to ``extra``.

        Raises:
            RigError: not a JSON object, another format, an invalid value, a key that is nearly a known one; ``where``
                (the file) begins the message.
        """
        content = parse_json(text, f"{where}: metadata")
        if not isinstance(content, dict):
            raise RigError(f"{where}: metadata is a JSON {type(content).__name__}, expected an object")
        if (found := content.pop("format", FORMAT)) != FORMAT:
            raise RigError(f"{where}: metadata format: found {shown(found)}, expected {FORMAT!r}")
        content.pop("rows", None)  # of the file, not of the recording
        if near := _nearly_known(content):
            raise RigError(f"{where}: unknown metadata key {near[0]!r} (nearest: {near[1]!r})")
        known = {name: content.pop(name) for name in _NAMES if name in content}
        try:
            return cls(**known, extra=content)
        except RigError as error:
            raise RigError(f"{where}: {error}") from error


_NAMES: Final = tuple(item.name for item in fields(Metadata) if item.name != "extra")
_OPTIONAL: Final = ("rate_Hz", "magnetic_field_unit", "pose_rate_Hz", "serial", "recorded")
_RESERVED: Final = frozenset((*_NAMES, "format", "rows"))


def misspelt(name: str, valid: Iterable[str]) -> str | None:
    """The valid name that ``name`` was probably meant to be (upper and lower case aside), or None."""
    choices = {choice.casefold(): choice for choice in valid}
    found = closest(name.casefold(), choices, 0.85)
    return None if found is None else choices[found]


def _nearly_known(keys: Iterable[str]) -> tuple[str, str] | None:
    """The first of some keys that is probably a known one that is not among them, and that one."""
    missing = set(_NAMES) - set(keys)
    own = ((name, misspelt(str(name), missing)) for name in keys if name not in _RESERVED)
    return next(((name, meant) for name, meant in own if meant is not None), None)


def _is_moment(value: Any) -> bool:
    try:
        datetime.fromisoformat(value)
    except (TypeError, ValueError):
        return False
    return True


def _is_name(text: str) -> bool:
    return 0 < len(text) <= _LONGEST_NAME and text.isprintable()


def _positive(name: str, value: Any) -> float:
    number = isinstance(value, Real) and not isinstance(value, bool)
    if number and MAGNITUDES[0] <= value <= MAGNITUDES[1]:
        return float(value)
    raise RigError(f"metadata {name}: found {shown(value)}, expected a positive number, no extreme one")
