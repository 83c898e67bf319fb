"""What surrounds the arm: gravity, the magnetic field and the temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.errors import RigError, shown

#: No magnitude of anything recorded is smaller or larger, and its fourth power is still a number.
MAGNITUDES: Final = (1e-60, 1e60)


@dataclass(frozen=True)
class Environment:
    """Uniform gravity and magnetic field in the base frame, and the board's temperature.

    Attributes:
        gravity_m_s2: magnitude of gravity [m/s^2].
        gravity_direction: (3,) unit vector, base frame; it points down.
        magnetic_field: magnitude of the magnetic field, in the unit that the sensitivities are per; 1 as in Renk (16).
        magnetic_direction: (3,) unit vector, base frame.
        temperature_degC, temperature_rise_degC, temperature_tau_s: the board warms as T + rise (1 - exp(-t/tau)).
    """

    gravity_m_s2: float = 9.8
    gravity_direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    magnetic_field: float = 1.0
    magnetic_direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    temperature_degC: float = 22.0
    temperature_rise_degC: float = 3.0
    temperature_tau_s: float = 900.0

    def __post_init__(self) -> None:
        for name in ("gravity_m_s2", "magnetic_field", "temperature_tau_s"):
            value = getattr(self, name)
            if not MAGNITUDES[0] <= value <= MAGNITUDES[1]:
                raise RigError(f"environment.{name}: found {shown(value)}, expected a positive number, no extreme one")
        for name in ("gravity_direction", "magnetic_direction"):
            vector = np.asarray(getattr(self, name), dtype=float)
            length = float(np.linalg.norm(vector)) if vector.shape == (3,) else np.nan
            if not (np.isfinite(length) and length > 0):
                raise RigError(f"environment.{name}: found {getattr(self, name)}, expected three numbers, not all zero")
            object.__setattr__(self, name, tuple(float(x) for x in vector / length))

    @property
    def gravity(self) -> Array:
        """(3,) [m/s^2], base frame."""
        return self.gravity_m_s2 * np.asarray(self.gravity_direction)

    @property
    def magnetic(self) -> Array:
        """(3,) [field unit], base frame."""
        return self.magnetic_field * np.asarray(self.magnetic_direction)

    def field(self, sensor: str) -> Array:
        """(3,) what a sensor feels at rest [m/s^2, field unit], base frame: gravity, or the magnetic field."""
        return self.gravity if sensor == ACCELEROMETER else self.magnetic

    def temperature(self, t: ArrayLike) -> Array:
        """The board's temperature (n,) [degC] at times (n,) [s]."""
        elapsed = np.asarray(t, dtype=float)
        return self.temperature_degC + self.temperature_rise_degC * -np.expm1(-elapsed / self.temperature_tau_s)
