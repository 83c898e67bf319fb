"""A magnet on a moving link: a point dipole that rides along, seen from wherever the sensor is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.sensor import Triple
from validation.blind.draws import scaled, unit
from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.settings import Setting

#: Where it sits in its link's frame [m]: beside the tool's tube, or at the foot of the waist, half a metre away.
_PLACES = {"link5": (0.06, 0.05, 0.02), "link1": (0.0, -0.15, 0.12)}
_FIELD = 0.01  # of the stated magnitude, about, at the sensor


@dataclass(frozen=True)
class MagnetOnLink(Mechanism):
    """Its field at the sensor is constant in the link only as far as the sensor keeps its place beside it."""

    effect = "link_hard_iron"

    link: str
    moment: Triple

    @classmethod
    @override
    def draw(cls, rng: np.random.Generator, setting: Setting) -> Self:
        link = str(rng.choice(list(_PLACES)))
        distance = 0.09 if link == "link5" else 0.5
        return cls(1.0, link, scaled(unit(rng), _FIELD * distance**3))

    @property
    @override
    def where(self) -> str:
        return self.link

    @property
    @override
    def families(self) -> tuple[tuple[str, str], ...]:
        # joints 2 to 4 are locked: links 1 to 4 are one body
        return () if self.link == "link5" else tuple(("link_hard_iron", f"link{number}") for number in (2, 3, 4))

    @override
    def stray_field(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        body, site = model.body(self.link).id, model.site("imu").id
        turned = data.xmat[body].reshape(3, 3)
        way = data.site_xpos[site] - (data.xpos[body] + turned @ np.asarray(_PLACES[self.link]))
        moment = self.strength * (turned @ np.asarray(self.moment))
        distance = float(np.linalg.norm(way))
        towards = way / distance
        return np.asarray((3.0 * towards * float(towards @ moment) - moment) / distance**3)
