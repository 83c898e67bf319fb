"""``--start`` of ``rig calibrate``: where Levenberg-Marquardt begins, as Camps et al. have it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rig.channels import ACCELEROMETER
from rig.errors import RigError, unknown_name
from scenarios.cli._options import numbers

if TYPE_CHECKING:
    from estimators.ellipsoid import Start
    from rig.recording import RecordingScan

_EXPECTED = "expected 'datasheet', GAIN[,OFFSET] or SENSOR=GAIN[,OFFSET], such as 1.8,0"


def parsed_start(given: Sequence[str], scan: RecordingScan) -> dict[str, Start]:
    """Sensor -> start, in the recorded unit per m/s^2 and per field unit.

    Args:
        given: each ``datasheet``, ``GAIN[,OFFSET]`` for all sensors, or ``SENSOR=GAIN[,OFFSET]``; an accelerometer's
            gain is per g. scan: the recording.

    Raises:
        RigError: none of these, or the recording does not state its sensors' data.
    """
    found: dict[str, Start] = {}
    for text in given:
        if text == "datasheet":
            found |= {sensor: _stated(sensor, scan) for sensor in scan.sensors}
            continue
        name, equals, own = text.rpartition("=")
        if equals and name not in scan.sensors:
            raise unknown_name("recorded sensor of --start", name, scan.sensors)
        for sensor in (name,) if equals else scan.sensors:
            found[sensor] = _numbers(own, text, sensor)
    return found


def _stated(sensor: str, scan: RecordingScan) -> Start:
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


def _numbers(given: str, text: str, sensor: str) -> Start:
    from estimators.ellipsoid import Start
    from rig.units import STANDARD_GRAVITY

    values = numbers(given)
    if len(values) not in (1, 2) or not values[0] > 0.0 or not all(abs(value) < float("inf") for value in values):
        raise RigError(f"--start: found {text!r}, {_EXPECTED}")
    gain = values[0] / STANDARD_GRAVITY if sensor == ACCELEROMETER else values[0]
    return Start(gain, values[1] if len(values) == 2 else 0.0)
