"""What a recording leaves open and a user may state: the magnitudes of gravity and of the magnetic field, by number or
by place, and where the search of ``rig calibrate --start`` begins."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot
from typing import TYPE_CHECKING, Any, Final

import click

from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.errors import RigError, unknown_name
from scenarios.cli._options import POSITIVE, Command, number, numbers

if TYPE_CHECKING:
    from estimators import Calibration
    from estimators.ellipsoid import Start
    from rig.recording import RecordingScan

#: A stated magnitude that is so many times the recording's own is another unit, or a slip.
_CONTRADICTS: Final = 2.0
_START: Final = "expected 'datasheet', GAIN[,OFFSET] or SENSOR=GAIN[,OFFSET], such as 1.8,0"


def stated_options(command: Command) -> Command:
    """``--gravity`` and ``--field``, ``--at`` and ``--date``."""
    gravity = click.option(
        "--gravity",
        type=POSITIVE,
        metavar="M_S2",
        help="Its magnitude; else the recording's.",
    )
    field = click.option(
        "--field", metavar="VALUE[UNIT]", help="The magnetic field's magnitude: 0.55G, 55uT, 55000nT, or relative."
    )
    at = click.option(
        "--at",
        metavar="LAT,LON,HEIGHT",
        help="Where: normal gravity and, with --date, the IGRF's field, where not given; degrees and metres, WGS84.",
    )
    date = click.option("--date", metavar="YYYY-MM-DD", help="When, for the magnetic field with --at.")
    return gravity(field(at(date(command))))


def field_magnitude(text: str) -> tuple[float, str | None]:
    """A magnitude with its unit, such as 48.5uT.

    Raises:
        RigError: neither a number nor one with a unit of the magnetic field.
    """
    found = re.fullmatch(r"\s*([0-9.eE+-]+?)\s*(G|uT|nT)?\s*", text)
    value = number(found[1]) if found else 0.0
    if found is None or not 0 < value < float("inf"):
        raise RigError(f"--field: found {text!r}, expected a number above zero with G, uT or nT behind it, or none")
    return value, found[2]


def stated_metadata(gravity: float | None, field: str | None) -> dict[str, Any]:
    """The metadata that the options state."""
    found: dict[str, Any] = {} if gravity is None else {"gravity_m_s2": gravity}
    if field is not None:
        found["magnetic_field"], found["magnetic_field_unit"] = field_magnitude(field)
    return found


def contradiction_words(stated: dict[str, Any], scan: RecordingScan) -> list[str]:
    """The magnitudes of the options that are far from what the recording states itself, in words.

    A relative field is held against a relative one alone.
    """
    from rig.units import conversion_factor

    own, found = scan.metadata, []
    if "gravity_m_s2" in stated and "gravity_m_s2" in scan.stated:
        ratio = stated["gravity_m_s2"] / own.gravity_m_s2
        if not 1.0 / _CONTRADICTS < ratio < _CONTRADICTS:
            words = f"--gravity: {stated['gravity_m_s2']:g} m/s^2 is {ratio:.3g} times the {own.gravity_m_s2:g} m/s^2"
            found.append(f"{words} that {scan.path} states")
    unit, recorded = stated.get("magnetic_field_unit"), own.magnetic_field_unit
    comparable = (unit is None) == (recorded is None)
    if "magnetic_field" in stated and "magnetic_field" in scan.stated and comparable:
        factor = 1.0 if unit is None or recorded is None else conversion_factor(unit, recorded)
        ratio = factor * stated["magnetic_field"] / own.magnetic_field
        if not 1.0 / _CONTRADICTS < ratio < _CONTRADICTS:
            one, other = (f" {each}" * (each is not None) for each in (unit, recorded))
            words = f"--field: {stated['magnetic_field']:g}{one} is {ratio:.3g} times the {own.magnetic_field:g}{other}"
            found.append(f"{words} that {scan.path} states: its unit?")
    return found


def unit_of_field(scan: RecordingScan) -> str:
    """The unit of the field that a recording states or records; uT where that is none of the field's."""
    from rig.units import UNITS

    recorded = scan.columns.units.get(MAGNETOMETER, "")
    of_field = [unit for unit in UNITS[MAGNETOMETER] if unit not in UNITS[ACCELEROMETER]]
    return scan.metadata.magnetic_field_unit or (recorded if recorded in of_field else "uT")


def stated_by_place(
    stated: dict[str, Any], at: str | None, date: str | None, sensors: Sequence[str], unit: str
) -> tuple[dict[str, Any], str]:
    """What the place adds to ``stated``, which goes before it, and this in words.

    Args:
        stated: what is known already.
        at, date: the options.
        sensors: gravity for an accelerometer, the field for a magnetometer.
        unit: of the field.

    Raises:
        RigError: no place or day, one without the other, or a library that is not installed.
    """
    if at is None:
        if date is not None:
            raise RigError("--date: found without --at, expected both: the field depends on the place as well")
        return {}, ""
    import datetime

    from rig.place import Place
    from rig.units import conversion_factor

    place_numbers = numbers(at)
    if len(place_numbers) not in (2, 3):
        raise RigError(f"--at: found {at!r}, expected LAT,LON,HEIGHT: two numbers in degrees and one in metres")
    try:
        day = None if date is None else datetime.date.fromisoformat(date)
    except ValueError:
        raise RigError(f"--date: found {date!r}, expected a day as in 2026-11-22") from None
    try:
        place = Place(*place_numbers)
        found: dict[str, Any] = {}
        words = []
        if ACCELEROMETER in sensors and "gravity_m_s2" not in stated:
            found["gravity_m_s2"] = place.gravity()
            words.append(f"normal gravity {found['gravity_m_s2']:.5f} m/s^2")
        if MAGNETOMETER in sensors and "magnetic_field" not in stated:
            if day is None:
                raise RigError("found without --date, expected both: the magnetic field changes from year to year")
            size = hypot(*place.magnetic_field_nT(day)) * conversion_factor("nT", unit)
            found |= {"magnetic_field": size, "magnetic_field_unit": unit}
            words.append(f"field {size:.5g} {unit} by the IGRF on {day}, without what steel and magnets nearby add")
    except RigError as error:
        raise RigError(f"--at {at}: {error}") from None
    return found, f"--at {at}: {', '.join(words)}" if words else ""


def with_assumptions(calibration: Calibration, scan: RecordingScan, stated: dict[str, Any]) -> Calibration:
    """The calibration with a warning for each magnitude that neither the recording nor the user has stated."""
    from rig.recording.findings import unstated_words

    sensors = dict(calibration.sensors)
    for sensor, words in unstated_words(scan, scan.stated | set(stated)).items():
        if sensor in sensors:
            sensors[sensor] = sensors[sensor].warned(words)
    return replace(calibration, sensors=sensors)


def parsed_start(given: Sequence[str], scan: RecordingScan) -> dict[str, Start]:
    """Sensor -> where Levenberg-Marquardt begins, as Camps et al. have it, in the recorded unit per m/s^2 and per field
    unit.

    Args:
        given: each ``datasheet``, ``GAIN[,OFFSET]`` for all sensors, or ``SENSOR=GAIN[,OFFSET]``; an accelerometer's
            gain is per g. scan: the recording.

    Raises:
        RigError: none of these, or the recording does not state its sensors' data.
    """
    found: dict[str, Start] = {}
    for text in given:
        if text == "datasheet":
            found |= {sensor: _datasheet(sensor, scan) for sensor in scan.sensors}
            continue
        name, equals, own = text.rpartition("=")
        if equals and name not in scan.sensors:
            raise unknown_name("recorded sensor of --start", name, scan.sensors)
        for sensor in (name,) if equals else scan.sensors:
            found[sensor] = _start(own, text, sensor)
    return found


def _datasheet(sensor: str, scan: RecordingScan) -> Start:
    from estimators.ellipsoid import Start

    nominal = scan.metadata.extra.get("nominal")
    own = nominal.get(sensor) if isinstance(nominal, Mapping) else None
    try:
        gain, offset = float(own["sensitivity"]), float(own.get("offset", 0.0))  # type: ignore[union-attr,index]
    except (TypeError, KeyError, ValueError, AttributeError):
        raise RigError(
            f"--start datasheet: {scan.name} does not state the {sensor}'s nominal sensitivity in its metadata"
            f" (nominal.{sensor}.sensitivity); expected --start {sensor}=GAIN,OFFSET"
        ) from None
    return Start(gain, offset)


def _start(given: str, text: str, sensor: str) -> Start:
    from estimators.ellipsoid import Start
    from rig.units import STANDARD_GRAVITY

    values = numbers(given)
    if len(values) not in (1, 2) or not values[0] > 0.0 or not all(abs(value) < float("inf") for value in values):
        raise RigError(f"--start: found {text!r}, {_START}")
    gain = values[0] / STANDARD_GRAVITY if sensor == ACCELEROMETER else values[0]
    return Start(gain, values[1] if len(values) == 2 else 0.0)
