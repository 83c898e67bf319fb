"""The units a reading can be recorded in, and the few conversions between them.

A calibration needs none of them: it gives sensitivity and offset in the recorded unit, whatever that is. They serve
where a reading is compared with a physical magnitude without a calibration.
"""

from __future__ import annotations

from typing import Final

from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.errors import RigError, check_name

#: Standard gravity [m/s^2], exact by the 3rd CGPM (1901): what a datasheet's "g" stands for.
STANDARD_GRAVITY: Final = 9.80665

#: The unit suffixes of a sensor's columns. "raw" is a number without a unit: converter counts, or a field relative to
#: its stated magnitude.
UNITS: Final[dict[str, tuple[str, ...]]] = {
    ACCELEROMETER: ("V", "mV", "raw", "g", "m_s2"),
    MAGNETOMETER: ("V", "mV", "raw", "G", "uT", "nT"),
}

#: The units of the field that a sensor feels, of a magnetic one where its magnitude is not relative.
FIELD_UNITS: Final[dict[str, tuple[str, ...]]] = {ACCELEROMETER: ("m_s2",), MAGNETOMETER: ("G", "uT", "nT")}

#: What a sensor's output is recorded in before anything is made of it: a voltage, or the converter's count.
ELECTRICAL: Final = ("V", "mV", "raw")

#: Unit -> (unit it is a multiple of, multiple).
_BASE: Final[dict[str, tuple[str, float]]] = {
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "raw": ("raw", 1.0),
    "g": ("m_s2", STANDARD_GRAVITY),
    "m_s2": ("m_s2", 1.0),
    "G": ("G", 1.0),
    "uT": ("G", 1e-2),
    "nT": ("G", 1e-5),
}

#: A recorded unit as readers write it, where that is not its name in files.
_WRITTEN: Final = {"m_s2": "m/s²", "uT": "µT"}


def written_unit(unit: str) -> str:
    """A recorded unit as readers write it: "m/s²" of "m_s2"."""
    return _WRITTEN.get(unit, unit)


def per_field(reading: str, field: str) -> str:
    """The unit of a sensitivity, of a reading's unit and a field's."""
    return f"{reading}/({field})" if "/" in field else f"{reading}/{field}"


def parameter_unit(name: str, reading: str, field: str | None) -> str:
    """The unit of a calibration's parameter as readers write it.

    Args:
        name: such as "sensitivity2", "offset1", "beta3_deg" or "axis1_x".
        reading: the recorded unit. field: the field's unit; None: not known, or relative to its stated magnitude.

    Returns:
        "deg" of an angle; "" of a component of a unit vector.
    """
    if name.endswith("_deg"):
        return "deg"
    if name.startswith("offset"):
        return written_unit(reading)
    of_gain = name.startswith(("sensitivity", "gain"))
    return per_field(written_unit(reading), "field" if field is None else written_unit(field)) if of_gain else ""


def conversion_factor(unit: str, to: str) -> float:
    """The number by which a reading in ``unit`` is multiplied to have it in ``to``.

    Raises:
        RigError: an unknown unit, or units of different quantities (volts become m/s^2 by a calibration only).
    """
    for name in (unit, to):
        check_name("unit", name, _BASE)
    base, factor = _BASE[unit]
    target_base, target_factor = _BASE[to]
    if base != target_base:
        same = ", ".join(name for name, (other, _) in _BASE.items() if other == base)
        raise RigError(f"unit {unit!r} cannot be converted to {to!r}: expected one of {same}")
    return factor / target_factor
