"""What people are shown as the name of a sensor's parameter: one name, whatever table or file it comes from."""

from __future__ import annotations

import re
from typing import Final

_ANGLES: Final = {"axis": ("beta", "gamma"), "field": ("phi", "psi")}
_ANGLE: Final = re.compile(r"(axis|field)(\d?)_(?:(beta|phi|elevation)|gamma|psi|azimuth)")


def shown_name(name: str) -> str:
    """``beta2`` of ``beta2_deg`` (a calibration), ``axis2_beta_deg`` (a study) and ``axis2_elevation`` (a plan)."""
    stem = name.removesuffix("_deg")
    found = _ANGLE.fullmatch(stem)
    if found is None:
        return stem
    elevation, azimuth = _ANGLES[found[1]]
    return f"{elevation if found[3] else azimuth}{found[2]}"
