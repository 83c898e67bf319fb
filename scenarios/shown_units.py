"""The units that numbers are shown in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.channels import ACCELEROMETER, CHANNELS_OF
from rig.units import parameter_unit, written_unit


@dataclass(frozen=True)
class Shown:
    """What a recorded unit is multiplied with to be shown, and the unit's name then."""

    factor: float
    name: str


def shown_unit(unit: str) -> Shown:
    """Of a recorded unit; volts are shown in millivolts."""
    return Shown(1e3, "mV") if unit == "V" else Shown(1.0, written_unit(unit))


def shown_units(units: Mapping[str, str]) -> dict[str, Shown]:
    """For each channel of the sensors in ``units`` (sensor -> recorded unit)."""
    return {channel: shown_unit(unit) for sensor, unit in units.items() for channel in CHANNELS_OF[sensor]}


def field_unit(sensor: str, magnetic_field_unit: str | None) -> str:
    """The unit of the field that a sensor feels; of a magnetic field that is relative just "field"."""
    return "m/s²" if sensor == ACCELEROMETER else magnetic_field_unit or "field"


def shift_unit(name: str, units: Mapping[str, str], magnetic_field_unit: str | None) -> str:
    """The unit of a parameter that a gap shifts, such as "mag1.offset".

    Args:
        units: sensor -> recorded unit. magnetic_field_unit: as the recording states it.
    """
    place, _, kind = name.partition(".")
    if kind not in ("sensitivity", "offset"):
        return "deg"
    sensor = next((sensor for sensor in units if place in CHANNELS_OF[sensor]), None)
    if sensor is None:
        return ""
    return parameter_unit(kind, units[sensor], "m_s2" if sensor == ACCELEROMETER else magnetic_field_unit)
