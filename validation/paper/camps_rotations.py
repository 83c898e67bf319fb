"""What turns about three axes can tell, Camps et al., Figure 3, beside a tumble by hand of as many readings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from estimators.design.attitude_free_bound import FreeSensor
from rig.channels import SENSORS
from rig.maneuver import AxisRotations, HandTumble
from validation.paper.camps import field_of_place, truth, tumbles
from validation.paper.published import camps

#: Of the sensor before each turn [deg].
TILTS_DEG: Final = (0.0, 10.0, 30.0, 50.0)


@dataclass(frozen=True)
class Told:
    """What readings during one maneuver can tell of a sensor, nine parameters.

    Attributes:
        maneuver, sensor: which.
        gain: the largest standard deviation of a gain or cross term, over the largest gain; NaN where one is not told.
        offset: the largest [V].
        condition: of the information scaled to a unit diagonal.
        untold: parameters that the readings cannot tell.
    """

    maneuver: str
    sensor: str
    gain: float
    offset: float
    condition: float
    untold: tuple[str, ...]


@cache
def told() -> tuple[Told, ...]:
    """Every maneuver for every sensor, with the noise that the paper's tests scatter by."""
    count = int(camps()["readings"])
    seconds = AxisRotations().duration_s
    maneuvers: dict[str, AxisRotations | HandTumble] = {
        "from level" if tilt == 0.0 else f"from {tilt:g}° off level": AxisRotations(
            tilt_deg=tilt, rate_Hz=count / seconds
        )
        for tilt in TILTS_DEG
    }
    maneuvers["a tumble by hand"] = HandTumble(duration_s=seconds, rate_Hz=count / seconds)
    found = []
    for name, maneuver in maneuvers.items():
        rotations = maneuver.trajectory().R_base_tool
        for sensor in SENSORS:
            gain, offset, magnitude = truth(sensor)
            noise = np.full(3, tumbles(sensor).noise)
            free = FreeSensor.of(gain, offset, magnitude)
            directions = np.einsum("nij,i->nj", rotations, field_of_place(sensor))
            best = free.predict(free.information(directions, noise), len(directions), noise)
            found.append(
                Told(
                    name,
                    sensor,
                    float(best.std[:-3].max() / gain.diagonal().max()),
                    float(best.std[-3:].max()),
                    best.condition,
                    tuple(best.untold),
                )
            )
    return tuple(found)
