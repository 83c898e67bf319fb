"""The units that readings are shown in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.channels import CHANNELS_OF

_WRITTEN = {"m_s2": "m/s²", "uT": "µT"}


@dataclass(frozen=True)
class Shown:
    """What a recorded unit is multiplied with to be shown, and the unit's name then."""

    factor: float
    name: str


def shown_units(units: Mapping[str, str]) -> dict[str, Shown]:
    """For each channel of the sensors in ``units`` (sensor -> recorded unit); volts are shown in millivolts."""
    return {channel: _shown(unit) for sensor, unit in units.items() for channel in CHANNELS_OF[sensor]}


def _shown(unit: str) -> Shown:
    return Shown(1e3, "mV") if unit == "V" else Shown(1.0, _WRITTEN.get(unit, unit))
