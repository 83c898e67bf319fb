"""Mechanisms as real mechanics: the truth comes out of ``mj_step``, not out of a formula of the catalogue."""

from __future__ import annotations

from typing import Final

from validation.blind.mechanics.lash import LashJoint
from validation.blind.mechanics.lever import OffCentreSensor
from validation.blind.mechanics.magnet import MagnetOnLink
from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.mechanics.rocking import RockingBase
from validation.blind.mechanics.spring import SpringJoint
from validation.blind.mechanics.table import VibratingTable

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
