"""The acquisition board: sampling, noise, range and converter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from rig.arrays import Array
from rig.channels import CHANNELS, COLUMNS_OF, READS, SENSORS, Reads
from rig.errors import RigError, check_name
from rig.units import UNITS

Pose = Literal["joints", "tool", "none"]
POSES: Final[tuple[Pose, ...]] = ("joints", "tool", "none")


@dataclass(frozen=True)
class Acquisition:
    """What the board makes of six voltages.

    Attributes:
        noise_V: (6,) standard deviation of white noise [V], in channel order.
        range_V: the sensor's output range [V], at which readings clip; None: unlimited.
        bits: the converter rounds to 2 full_scale / 2^bits; None: no rounding.
        full_scale_V: the converter's, on either side of zero.
        decimation: every so many samples of the maneuver are kept (25: 100 Hz become 4 Hz).
        pose: what is recorded of the pose: joint angles, the tool's pose as a tracking system gives it, or nothing.
            A maneuver without joints has no joint angles: there "joints" records nothing.
        units: of the accelerometer's and of the magnetometer's readings: "V", or that of a sensor with a digital
            output, whose readings, sensitivity, offset, noise and effects are then in it. Range and converter are of
            sensors in volts.
        accelerometer_reads: "g-a", as in the papers, or "a-g", as the common chips do; the axes of a scenario's
            accelerometer are then those of a - g, as they lie on the chip.
    """

    noise_V: tuple[float, ...] = (0.0,) * 6
    range_V: tuple[float, float] | None = (0.0, 5.0)
    bits: int | None = 14
    full_scale_V: float = 10.0
    decimation: int = 25
    pose: Pose = "joints"
    units: tuple[str, str] = ("V", "V")
    accelerometer_reads: Reads = "g-a"

    def __post_init__(self) -> None:
        noise = np.asarray(self.noise_V, dtype=float)
        if noise.shape != (len(CHANNELS),) or not np.isfinite(noise).all() or (noise < 0).any():
            raise RigError(
                f"acquisition.noise_V: found {self.noise_V}, expected {len(CHANNELS)} numbers, none negative"
            )
        object.__setattr__(self, "noise_V", tuple(float(value) for value in noise))
        if self.range_V is not None:
            if len(self.range_V) != 2 or not self.range_V[0] < self.range_V[1]:
                raise RigError(f"acquisition.range_V: found {self.range_V}, expected a lower and a higher voltage")
            object.__setattr__(self, "range_V", (float(self.range_V[0]), float(self.range_V[1])))
        if self.bits is not None and not 1 <= self.bits <= 32:
            raise RigError(f"acquisition.bits: found {self.bits}, expected 1 to 32")
        if not self.full_scale_V > 0:
            raise RigError(f"acquisition.full_scale_V: found {self.full_scale_V}, expected a positive voltage")
        check_name("acquisition.pose", self.pose, POSES)
        for sensor, unit in zip(SENSORS, self.units, strict=True):
            check_name(f"unit of the {sensor} in acquisition.units", unit, UNITS[sensor])
        check_name("acquisition.accelerometer_reads", self.accelerometer_reads, READS)
        if self.decimation < 1:
            raise RigError(f"acquisition.decimation: found {self.decimation}, expected 1 or more")

    @property
    def unit_of(self) -> dict[str, str]:
        """Sensor -> unit of its readings."""
        return dict(zip(SENSORS, self.units, strict=True))

    @property
    def step_V(self) -> float:
        """One step of the converter [V]; 1.2207 mV for 14 bit over +-10 V; zero without rounding."""
        return 0.0 if self.bits is None else 2.0 * self.full_scale_V / 2.0**self.bits

    @property
    def sigma(self) -> Array:
        """(6,) standard deviation of a reading [recorded unit]: of the noise and, in volts, of the rounding."""
        rounded = np.repeat([self.step_V if unit == "V" else 0.0 for unit in self.units], 3)
        return np.asarray(np.hypot(self.noise_V, rounded / np.sqrt(12.0)))

    def add_noise(self, volts: Array, rng: np.random.Generator) -> Array:
        """Voltages (n, 6) [V] with each channel's white noise."""
        if not any(self.noise_V):
            return volts
        return volts + rng.standard_normal(volts.shape) * self.noise_V

    def convert(self, volts: Array) -> Array:
        """Voltages (n, 6) [V] as the converter gives them: clipped to the range, rounded to its steps."""
        converted = volts.copy()
        for sensor, unit in self.unit_of.items():
            own = converted[:, COLUMNS_OF[sensor]]
            if unit == "V" and self.range_V is not None:
                np.clip(own, *self.range_V, out=own)
            if unit == "V" and self.bits is not None:
                own[:] = np.round(own / self.step_V) * self.step_V
        return converted
