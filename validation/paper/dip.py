"""What the field's dip says: a stray field that is there on average, beside the one that varies with the pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scenarios.studies.coordinates import RADIAN_DEG
from validation.paper.published import parameter_table, renk, spread_table

#: Standard deviations that the interval reaches.
_SIGMAS: Final = 1.96


@dataclass(frozen=True)
class DipArgument:
    """The magnetic field that Renk et al. found, beside the Earth's where they were.

    The base is level: gravity lies along its z axis. So phi of the magnetic field is its dip. A stray field s that
    turns the Earth's field B by an angle a has |s| >= |B| sin(a), whatever its direction, the base's heading and the
    unit of the sensitivities.

    Attributes:
        found_deg, found_std_deg: phi of Table 10, and how far the three separate fits scatter about it.
        level_deg, level_std_deg: how far gravity lies off the base's z axis, Table 5; its scatter, Table 7.
        earth_deg, earth_std_deg: dip of IGRF-14, and how well it holds at one place.
        turned_deg, turned_std_deg: the difference, and the standard deviation from these three.
        least, low, high: the weakest stray field over the Earth's that turns it so far, with its 95 % interval.
    """

    found_deg: float
    found_std_deg: float
    level_deg: float
    level_std_deg: float
    earth_deg: float
    earth_std_deg: float
    turned_deg: float
    turned_std_deg: float
    least: float
    low: float
    high: float


def dip_argument() -> DipArgument:
    """From Tables 5, 7, 8 and 10 and the Earth's field."""
    found = parameter_table("10").values("phi")[0]
    scatter = float(parameter_table("8").values("phi").std(ddof=1))
    level = abs(90.0 - float(parameter_table("5").values("phi")[0]))
    level_std = spread_table("7").std["phi_deg"].value
    place = renk()["place"]
    earth, earth_std = float(place["dip_deg"]), float(place["dip_std_deg"])
    turned = earth - float(found)
    std = float(np.sqrt(scatter**2 + level_std**2 + level**2 + earth_std**2))
    low, least, high = (float(np.sin((turned + k * std) / RADIAN_DEG)) for k in (-_SIGMAS, 0.0, _SIGMAS))
    return DipArgument(float(found), scatter, level, level_std, earth, earth_std, turned, std, least, low, high)


def dip_words(dip: DipArgument) -> str:
    """The argument in one sentence."""
    return (
        f"The magnetic field of Table 10 dips by {dip.found_deg:.2f}° (the base is level to {dip.level_deg:.3f}°, by"
        f" Table 5), where the Earth's dips by {dip.earth_deg:.2f}°: a stray field turns it by {dip.turned_deg:.2f} ±"
        f" {dip.turned_std_deg:.2f}°, so on average over the sweep it has at least {dip.least:.2f} of the Earth's"
        f" strength (95 %: {dip.low:.2f} to {dip.high:.2f})."
    )


#: What can and what cannot turn the field of a calibration so.
EXCLUDED: Final = (
    "the Earth's field alone: no error of level, frame or joint angle does it, for gravity stands upright in the same"
    " frame by the same joints",
    "all that rides with the sensor, its offsets, hard and soft iron: a calibration takes it up into offsets and axes",
    "a stray field that is zero on average over the sweep, such as a uniform gradient about its middle, or the"
    " horizontal field of magnets that turn with joint 1",
)
ALLOWED: Final = (
    "a source fixed in the room or the base, steel or a motor, or the upright part of one in the turning shoulder",
)
