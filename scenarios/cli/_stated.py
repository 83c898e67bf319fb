"""What a recording leaves open and a user may state: the magnitudes of gravity and of the magnetic field."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.errors import RigError
from scenarios.cli._options import Command

if TYPE_CHECKING:
    from estimators import Calibration
    from rig.recording import RecordingScan


def stated_options(command: Command) -> Command:
    """``--gravity`` and ``--field``."""
    gravity = click.option(
        "--gravity",
        type=click.FloatRange(min=0, min_open=True),
        metavar="M_S2",
        help="Its magnitude; else the recording's.",
    )
    field = click.option(
        "--field", metavar="VALUE[UNIT]", help="The magnetic field's magnitude: 0.55G, 55uT, 55000nT, or relative."
    )
    return gravity(field(command))


def field_magnitude(text: str) -> tuple[float, str | None]:
    """A magnitude with its unit, such as 48.5uT.

    Raises:
        RigError: neither a number nor one with a unit of the magnetic field.
    """
    found = re.fullmatch(r"\s*([0-9.eE+-]+?)\s*(G|uT|nT)?\s*", text)
    try:
        value = float(found[1]) if found else 0.0
    except ValueError:
        value = 0.0
    if found is None or not 0 < value < float("inf"):
        raise RigError(f"--field: found {text!r}, expected a number above zero with G, uT or nT behind it, or none")
    return value, found[2]


def stated_metadata(gravity: float | None, field: str | None) -> dict[str, Any]:
    """The metadata that the options state."""
    found: dict[str, Any] = {} if gravity is None else {"gravity_m_s2": gravity}
    if field is not None:
        found["magnetic_field"], found["magnetic_field_unit"] = field_magnitude(field)
    return found


def with_assumptions(calibration: Calibration, scan: RecordingScan, stated: dict[str, Any]) -> Calibration:
    """The calibration with a warning for each magnitude that neither the recording nor the user has stated."""
    known = scan.stated | set(stated)
    sensors = dict(calibration.sensors)
    for sensor, key, what, option in (
        (
            ACCELEROMETER,
            "gravity_m_s2",
            f"gravity is not stated: {scan.metadata.gravity_m_s2:g} m/s^2 taken",
            "--gravity",
        ),
        (MAGNETOMETER, "magnetic_field", f"the field is not stated: {scan.metadata.magnetic_field:g} taken", "--field"),
    ):
        if sensor not in sensors or key in known:
            continue
        own = sensors[sensor]
        words = f"{what} ({option}): every 1 % in it is 1 % in every sensitivity, the other way"
        quality = replace(own.quality, warnings=(*own.quality.warnings, words))
        sensors[sensor] = replace(own, quality=quality)
    return replace(calibration, sensors=sensors)
