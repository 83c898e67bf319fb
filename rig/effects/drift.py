"""Effects that change the sensor over time: warming up, temperature, jumps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.channels import CHANNELS, SENSORS
from rig.effects.base import Effect, Stage, register
from rig.effects.geometry import instants
from rig.effects.parameters import Value, parameter
from rig.effects.sensor import with_inputs
from rig.signals import Signals

#: Temperature [degC] at which data sheets state sensitivity and offset.
REFERENCE_TEMPERATURE: Final = 25.0


def with_volts(signals: Signals, columns: slice, change: Array) -> Signals:
    """The signals with ``change`` (n, channels) [V] added to the readings of some channels."""
    volts = signals.volts.copy()
    volts[:, columns] += change
    return replace(signals, volts=volts)


@register
@dataclass(frozen=True)
class BiasWarmup(Effect):
    """The offset settles after power is switched on: V + c exp(-t/tau), one coefficient c an axis, tau the time
    constant, t since the first sample.

    Minutes; 1-10 mV; a guess.
    """

    name = "bias_warmup"
    of_recording = True
    stage = Stage.VOLTS
    places = SENSORS

    coefficient: tuple[float, ...] = parameter("V", 5e-3, size=3, by_axis=True)
    tau_s: float = parameter(
        "s", 300.0, lower=1.0, upper=1e5, strength=False, grid=(30.0, 60.0, 120.0, 240.0, 480.0, 960.0, 1920.0)
    )

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        decay = np.exp(-(signals.t - signals.t[0]) / self.tau_s)
        return with_volts(signals, self.columns, np.outer(decay, self.coefficient))


@register
@dataclass(frozen=True)
class BiasTemperature(Effect):
    """The offset follows the temperature: V + c (T - 25 degC), one coefficient c an axis.

    0.5-1 mg/degC (ADXL330 data sheet: 1 mg/degC), times the sensitivity.
    """

    name = "bias_temperature"
    stage = Stage.VOLTS
    places = SENSORS
    requires = ("temperature",)

    coefficient_per_degC: tuple[float, ...] = parameter("V/degC", 1e-3, size=3, by_axis=True)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        warmth = signals.temperatures - REFERENCE_TEMPERATURE
        return with_volts(signals, self.columns, np.outer(warmth, self.coefficient_per_degC))


@register
@dataclass(frozen=True)
class ScaleTemperature(Effect):
    """The sensitivity follows the temperature: S (1 + c (T - 25 degC)), one coefficient c an axis.

    0.015 %/degC (ADXL330 data sheet) to -0.3 %/degC (HMC1001 data sheet, at constant voltage).
    """

    name = "scale_temperature"
    stage = Stage.INPUT
    places = SENSORS
    requires = ("temperature",)

    coefficient_per_degC: tuple[float, ...] = parameter("1/degC", 1e-3, lower=-0.1, upper=0.1, size=3, by_axis=True)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        warmth = signals.temperatures - REFERENCE_TEMPERATURE
        factor = 1.0 + np.outer(warmth, self.coefficient_per_degC)
        return with_inputs(signals, self.columns, signals.inputs[:, self.columns] * factor)


@register
@dataclass(frozen=True)
class BiasStep(Effect):
    """The offset jumps at one instant: V + volts from at_s on.

    A knock, a magnetising field, a contact: 1-20 mV; a guess.
    """

    name = "bias_step"
    stage = Stage.VOLTS
    places = CHANNELS

    volts: float = parameter("V", 5e-3)
    at_s: float = parameter("s", 600.0, strength=False)

    @classmethod
    @override
    def searched(cls, signals: Signals) -> list[dict[str, Value]]:
        return instants(signals)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return with_volts(signals, self.columns, self.volts * (signals.t >= self.at_s)[:, None].astype(float))
