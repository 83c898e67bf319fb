"""Sizes in units in which their numbers are short: degrees, percent, millivolts and microvolts."""

from __future__ import annotations

import math
from typing import Final

from rig.number_text import with_std

#: A unit of angles and of shares -> what to multiply with, and the unit that people think in.
_PEOPLE: Final = {"rad": (180.0 / math.pi, "deg"), "relative": (100.0, "%")}
_VOLT: Final = "V"
#: From which size on volts are written with which prefix.
_PREFIXES: Final = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (0.0, 1e6, "µ"))


def readable_unit(unit: str, size: float) -> tuple[float, str]:
    """What to multiply with, and the unit then: volts, and volts per something, have the prefix that suits ``size``."""
    own, slash, per = unit.partition("/")
    if own != _VOLT or not size > 0.0:
        return _PEOPLE.get(unit, (1.0, unit))
    factor, prefix = next((factor, prefix) for least, factor, prefix in _PREFIXES if size >= least)
    return factor, f"{prefix}{own}{slash}{per}"


def rms_text(size: float, floor: float, samples: int, factor: float = 1.0) -> str:
    """A root mean square of a channel, to the second digit of the deviation that its noise gives it.

    Args:
        size, floor: of the channel and of its noise, in one unit. samples: that it was taken over.
        factor: what both are multiplied with to be shown.
    """
    deviation = factor * floor / math.sqrt(2.0 * max(samples, 1))
    return with_std(factor * size, deviation)[0] if deviation > 0.0 else f"{factor * size:.3g}"


def two_digits(value: float) -> str:
    """A number to its second digit, without an exponent."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 10.0 else f"{rounded:g}"
