"""Parameters in the unit of the readings: the catalogue states them for sensors in volts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from estimators.gap.diagnosis import Cause
from rig.channels import CHANNELS_OF

_VOLTS = "V"
_WRITTEN = {"m_s2": "m/s^2"}


def in_recorded_units(causes: Iterable[Cause], units: Mapping[str, str]) -> tuple[Cause, ...]:
    """Causes whose parameters are said to be in the unit of the readings that they act on.

    Args:
        units: sensor -> recorded unit; a cause of two sensors in different units keeps the word of none.
    """
    return tuple(_renamed(cause, units) for cause in causes)


def _renamed(cause: Cause, units: Mapping[str, str]) -> Cause:
    sensors = [sensor for sensor in units if cause.where == sensor or cause.where in CHANNELS_OF[sensor]] or list(units)
    own = {units[sensor] for sensor in sensors}
    unit = own.pop() if len(own) == 1 else "recorded unit"
    if unit == _VOLTS:
        return cause
    parameters = {}
    for name, estimate in cause.parameters.items():
        kind, slash, per = estimate.unit.partition("/")
        renamed = f"{_WRITTEN.get(unit, unit)}{slash}{per}" if kind == _VOLTS else estimate.unit
        parameters[name] = replace(estimate, unit=renamed)
    return replace(cause, parameters=parameters)
