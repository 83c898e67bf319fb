"""What gravity and the Earth's magnetic field are at a place: normal gravity of WGS84, and the IGRF."""

from __future__ import annotations

import datetime
import warnings
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np

from rig.errors import RigError

#: The first day of the IGRF, and the day after the last [14th generation: Alken et al., IAGA].
IGRF_DAYS: Final = (datetime.date(1900, 1, 1), datetime.date(2030, 1, 1))
_HEIGHTS_M: Final = (-500.0, 10_000.0)
#: At a pole itself east has no direction, and the IGRF's formula divides by zero.
_NEAREST_TO_POLE_DEG: Final = 1e-6


@dataclass(frozen=True)
class Place:
    """A place on the Earth.

    Attributes:
        latitude_deg, longitude_deg: geodetic, of WGS84; north and east are positive.
        height_m: above the ellipsoid, which is within 110 m of the height above the sea.

    Raises:
        RigError: not on the Earth.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("latitude_deg", -90.0, 90.0),
            ("longitude_deg", -180.0, 360.0),
            ("height_m", *_HEIGHTS_M),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise RigError(f"{name}: found {value:g}, expected a number from {low:g} to {high:g}")

    def gravity(self) -> float:
        """Magnitude of normal gravity, with the centrifugal part [m/s^2]; Li and Goetze (2001).

        Rock of another density nearby, which it does not know, changes gravity by some 1e-4 of it at most places.

        Raises:
            RigError: the library is not installed.
        """
        boule = _library("boule")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a place below the ellipsoid: no rock is taken away there
            found = boule.WGS84.normal_gravity((None, self.latitude_deg, self.height_m), si_units=True)
        return float(found)

    def magnetic_field_nT(self, date: datetime.date) -> tuple[float, float, float]:
        """The Earth's main field: north, east, down [nT]; the International Geomagnetic Reference Field.

        Rock adds some hundred nT, and steel, motors and magnets nearby far more, which it does not know.

        Raises:
            RigError: a day that the IGRF does not cover; the library is not installed.
        """
        first, end = IGRF_DAYS
        if not first <= date < end:
            raise RigError(f"date: found {date}, expected one from {first} and before {end}, which the IGRF covers")
        ppigrf = _library("ppigrf")
        limit = 90.0 - _NEAREST_TO_POLE_DEG
        latitude = float(np.clip(self.latitude_deg, -limit, limit))
        east, north, up = ppigrf.igrf(
            self.longitude_deg, latitude, 1e-3 * self.height_m, datetime.datetime.combine(date, datetime.time())
        )
        return float(north[0]), float(east[0]), -float(up[0])


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise RigError(
            f"{name} is not installed, which knows the fields by place: pip install 'torusrig[place]'"
        ) from None
