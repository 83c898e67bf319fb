"""The numbers that the two papers print, with the rounding that their digits tell."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final, Self

import numpy as np

from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.directions import direction_from_angles
from rig.errors import RigError, unknown_name

#: The tables of the separate and of the simultaneous fit of each sensor, and of the spread over subsets.
SEPARATE: Final = {ACCELEROMETER: "3", MAGNETOMETER: "8"}
SIMULTANEOUS: Final = {ACCELEROMETER: "5", MAGNETOMETER: "10"}
SPREADS: Final = {ACCELEROMETER: "7", MAGNETOMETER: "12"}
#: The columns of a table of parameters, and the stems of their names in a calibration.
STEMS: Final = {
    "beta": "beta{}_deg",
    "gamma": "gamma{}_deg",
    "sensitivity": "sensitivity{}",
    "offset": "offset{}",
    "phi": "phi{}_deg",
    "psi": "psi{}_deg",
}


@dataclass(frozen=True)
class Printed:
    """A number as it is printed.

    Attributes:
        text: its digits. value: of them. half_unit: half of what its last digit stands for.
    """

    text: str
    value: float
    half_unit: float

    @classmethod
    def of(cls, text: str) -> Self:
        """From digits such as ``-85.628`` or ``2.8356e-5``."""
        mantissa, _, exponent = text.lower().partition("e")
        decimals = len(mantissa.partition(".")[2])
        return cls(text, float(text), 0.5 * 10.0 ** (int(exponent or 0) - decimals))

    def rounds_from(self, value: float, slack: float = 0.0) -> bool:
        """Whether a value rounds to it, give or take ``slack``."""
        return abs(value - self.value) <= self.half_unit + slack + 1e-12 * max(abs(value), 1.0)


@dataclass(frozen=True, eq=False)
class ParameterTable:
    """Renk et al., Tables 2, 3, 5, 8, 10: a row an axis.

    Attributes:
        number, title, sensor, method: of the table; no method where it is a truth, not an estimate.
        columns: of ``STEMS``. rows: three, one number a column.
    """

    number: str
    title: str
    sensor: str
    method: str | None
    columns: tuple[str, ...]
    rows: tuple[tuple[Printed, ...], ...]

    def column(self, name: str) -> tuple[Printed, ...]:
        """One number an axis."""
        place = self.columns.index(name)
        return tuple(row[place] for row in self.rows)

    def values(self, name: str) -> Array:
        """(3,) of a column."""
        return np.array([number.value for number in self.column(name)])

    def half_units(self, name: str) -> Array:
        """(3,) of a column."""
        return np.array([number.half_unit for number in self.column(name)])

    @property
    def axes(self) -> Array:
        """(3, 3) unit vectors of the axes, frame 6."""
        return direction_from_angles(self.values("beta"), self.values("gamma"))

    @property
    def fields(self) -> Array:
        """(3, 3) unit vectors of the fields, base frame."""
        return direction_from_angles(self.values("phi"), self.values("psi"))


@dataclass(frozen=True)
class AngleTable:
    """Renk et al., Tables 4, 6, 9, 11: angles between axes, by pairs ``1-2``, ``1-3``, ``2-3``.

    Attributes:
        number, title, sensor: of the table. from_table: which they should follow from.
        angles: pair -> angle [deg].
    """

    number: str
    title: str
    sensor: str
    from_table: str
    angles: dict[str, Printed]


@dataclass(frozen=True)
class SpreadTable:
    """Renk et al., Tables 7 and 12: mean and standard deviation over 25 subsets.

    Attributes:
        number, title, sensor: of the table. of_table: whose estimates come from one subset.
        mean, std: parameter -> number.
        printed_units: parameter -> the unit that is printed beside it, where it is not the parameter's.
    """

    number: str
    title: str
    sensor: str
    of_table: str
    mean: dict[str, Printed]
    std: dict[str, Printed]
    printed_units: dict[str, str]


@dataclass(frozen=True)
class EllipsoidTable:
    """Camps et al., Tables 1 to 4: three tests of one sensor.

    Attributes:
        number, title, sensor: of the table. parameters: 6 or 9.
        rows: parameter -> the three tests.
    """

    number: str
    title: str
    sensor: str
    parameters: int
    rows: dict[str, tuple[Printed, ...]]

    @property
    def values(self) -> Array:
        """(p, 3)."""
        return np.array([[number.value for number in row] for row in self.rows.values()])


def renk() -> dict[str, Any]:
    """Everything but the tables."""
    return dict(_document()["renk"])


def camps() -> dict[str, Any]:
    """Everything but the tables."""
    return dict(_document()["camps"])


def parameter_table(number: str) -> ParameterTable:
    """Renk et al., Table 2, 3, 5, 8 or 10."""
    table = _table("renk", number)
    rows = tuple(tuple(map(Printed.of, row)) for row in table["rows"])
    return ParameterTable(number, table["title"], table["sensor"], table.get("method"), tuple(table["columns"]), rows)


def angle_table(number: str) -> AngleTable:
    """Renk et al., Table 4, 6, 9 or 11."""
    table = _table("renk", number)
    angles = {pair: Printed.of(text) for pair, text in table["angles"].items()}
    return AngleTable(number, table["title"], table["sensor"], table["from_table"], angles)


def spread_table(number: str) -> SpreadTable:
    """Renk et al., Table 7 or 12."""
    table = _table("renk", number)
    mean = {row["parameter"]: Printed.of(row["mean"]) for row in table["mean_std"]}
    std = {row["parameter"]: Printed.of(row["std"]) for row in table["mean_std"]}
    units = {row["parameter"]: row["printed_unit"] for row in table["mean_std"] if "printed_unit" in row}
    return SpreadTable(number, table["title"], table["sensor"], table["of_table"], mean, std, units)


def ellipsoid_table(number: str) -> EllipsoidTable:
    """Camps et al., Table 1 to 4."""
    table = _table("camps", number)
    rows = {name: tuple(map(Printed.of, row)) for name, row in table["rows"].items()}
    return EllipsoidTable(number, table["title"], table["sensor"], table["parameters"], rows)


def unit_of(parameter: str, sensor: str) -> str:
    """The unit in which the papers print a parameter."""
    if parameter.endswith("_deg") or parameter in ("beta", "gamma", "phi", "psi", "phi, psi"):
        return "deg"
    if parameter.startswith("offset"):
        return "V"
    return "V s²/m" if sensor == ACCELEROMETER else "V/G"


def _table(paper: str, number: str) -> dict[str, Any]:
    tables = _document()[paper]["tables"]
    if number not in tables:
        raise unknown_name("table", number, tables)
    return dict(tables[number])


@cache
def _document() -> dict[str, Any]:
    text = files(__package__).joinpath("published.toml").read_text(encoding="utf-8")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:  # the package's own file
        raise RigError(f"published.toml: {error}") from error
