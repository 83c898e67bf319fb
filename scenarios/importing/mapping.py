"""Which column of a log is what: guessed from names and ranges, or read from a mapping file."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from rig.documents import parse_toml, read_toml
from rig.errors import RigError, nearest
from scenarios.importing.quantities import TARGETS, parse_target
from scenarios.schema import Table, build
from scenarios.writer import toml_document, toml_value

FORMAT: Final = "rig-mapping/1"

Direction = Literal["base<-tool", "tool<-base"]
Angles = Literal["joints", "renk2005"]
Reads = Literal["g-a", "a-g", "detect"]


@dataclass(frozen=True)
class Conventions:
    """``[conventions]``: what names cannot say.

    Attributes:
        rotation: "base<-tool" turns the tool's coordinates into the base's; "tool<-base" is the transpose.
        euler: the turns that three Euler angles stand for: capital letters about the turned axes, in order ("ZYX" is
            yaw, pitch, roll), small ones about fixed axes.
        angles: "joints", or "renk2005": theta1, theta5, theta6 of Table 1 of Renk et al. (2005), the other joints as
            they were locked.
        accelerometer_reads: "g-a" (down at rest, as in the paper), "a-g" (up at rest, the common chips), "detect".
        clock_offset_s: added to the times of the poses; "auto" estimates it; "none" leaves one clock alone.
        base_frame: of a bag's transforms, the one in which the pose is given; "none": the frame named as a base, or
            the last one before something moves.
        tool_frame: of a bag's transforms, the one of which the pose is given; "none": the frame of the readings, or a
            flange's.
        time_unit: of the time column: "s", "ms", "us", "ns"; "guess" by name and range.
    """

    rotation: Direction = "base<-tool"
    euler: str = "ZYX"
    angles: Angles = "joints"
    accelerometer_reads: Reads = "detect"
    clock_offset_s: float | Literal["auto"] | None = None
    time_unit: Literal["s", "ms", "us", "ns", "guess"] = "guess"
    base_frame: str | None = None
    tool_frame: str | None = None

    def __post_init__(self) -> None:
        if re.fullmatch(r"(?!(.)\1|.(.)\2)([XYZ]{3}|[xyz]{3})", self.euler) is None:
            raise RigError(
                f"euler: found {self.euler!r}, expected three axes, all capital (turned) or all small (fixed axes),"
                " such as 'ZYX' or 'xyz'"
            )


@dataclass(frozen=True)
class Stated:
    """``[metadata]``: what the recording says about itself.

    Attributes:
        gravity_m_s2, magnetic_field, magnetic_field_unit, serial, recorded, notes: as in a recording's metadata.
    """

    gravity_m_s2: float | None = None
    magnetic_field: float | None = None
    magnetic_field_unit: str | None = None
    serial: str | None = None
    recorded: str | None = None
    notes: str = ""

    @property
    def known(self) -> dict[str, Any]:
        """What is stated, by its key."""
        return {key: value for key, value in vars(self).items() if value not in (None, "")}


@dataclass(frozen=True)
class Mapping:
    """Columns of logs and what they are.

    Attributes:
        columns: log column -> what it is (``quantities.TARGETS``), with a minus sign before it where its sign is
            turned; columns that are not named are passed over.
        conventions, metadata: the further sections.
    """

    columns: dict[str, str] = field(default_factory=dict)
    conventions: Conventions = field(default_factory=Conventions)
    metadata: Stated = field(default_factory=Stated)

    def to_toml(self, comments: list[str] | None = None) -> str:
        """The mapping file, with every convention written out."""
        tables = [
            ("", {"format": FORMAT}),
            ("[columns]", {toml_value(name): target for name, target in self.columns.items()}),
            ("[conventions]", dataclasses.asdict(self.conventions)),
            ("[metadata]", self.metadata.known),
        ]
        lines = "".join(f"# {line}\n" for line in comments or [])
        return lines + toml_document(tables)


def read_mapping(path: Path) -> Mapping:
    """A mapping file.

    Raises:
        RigError: it cannot be read, or says something that there is not; with the nearest valid name.
    """
    values: dict[str, Any] = dict(parse_toml(read_toml(path, "a mapping"), str(path)))
    top = Table(str(path), "", values)
    top.check_keys(("format", "columns", "conventions", "metadata"))
    if values.get("format", FORMAT) != FORMAT:
        raise top.error(f"format: found {values['format']!r}, expected {FORMAT!r}")
    columns = top.sub("columns")
    for name, target in columns.values.items():
        if not isinstance(target, str) or parse_target(target) is None:
            raise columns.error(
                f"{name}: found {target!r}, expected one of {', '.join(TARGETS[:4])} .. "
                f"(rig import --help lists them){nearest(str(target), TARGETS)}"
            )
    return Mapping(dict(columns.values), build(Conventions, top.sub("conventions")), build(Stated, top.sub("metadata")))
