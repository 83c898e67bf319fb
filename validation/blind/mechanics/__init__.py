"""Mechanisms as real mechanics: the truth comes out of ``mj_step``, not out of a formula of the catalogue."""

from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.mechanics.mechanisms import MECHANISMS

__all__ = ["MECHANISMS", "Mechanism"]
