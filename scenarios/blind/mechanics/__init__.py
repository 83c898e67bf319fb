"""Mechanisms as real mechanics: the truth comes out of ``mj_step``, not out of a formula of the catalogue."""

from __future__ import annotations

from typing import Final

from scenarios.blind.mechanics.lash import LashJoint
from scenarios.blind.mechanics.lever import OffCentreSensor
from scenarios.blind.mechanics.magnet import MagnetOnLink
from scenarios.blind.mechanics.mechanism import Mechanism
from scenarios.blind.mechanics.rocking import RockingBase
from scenarios.blind.mechanics.spring import SpringJoint
from scenarios.blind.mechanics.table import VibratingTable

#: By name.
MECHANISMS: Final[dict[str, type[Mechanism]]] = {
    "lash_joint": LashJoint,
    "spring_joint": SpringJoint,
    "rocking_base": RockingBase,
    "off_centre_sensor": OffCentreSensor,
    "magnet_on_link": MagnetOnLink,
    "vibrating_table": VibratingTable,
}

__all__ = ["MECHANISMS", "Mechanism"]
