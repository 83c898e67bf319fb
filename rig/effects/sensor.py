"""Effects inside the sensor that depend on its input: nonlinearity, memory, bandwidth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.channels import CHANNELS, SENSORS
from rig.effects._numerics import low_passed, play
from rig.effects.base import Effect, Stage, register
from rig.effects.parameters import parameter
from rig.signals import Signals


def with_inputs(signals: Signals, columns: slice, values: Array) -> Signals:
    """The signals with the inputs of some channels replaced."""
    inputs = signals.inputs.copy()
    inputs[:, columns] = values
    return replace(signals, inputs=inputs)


@register
@dataclass(frozen=True)
class ScaleQuadratic(Effect):
    """The axis is nonlinear, unlike for either sign: x + a x^2 / X, a the error at full scale, X the full reference.

    0.1-1 % of full scale: 0.3 % (ADXL330 data sheet), 0.1-0.5 % (HMC1001 data sheet).
    """

    name = "scale_quadratic"
    stage = Stage.INPUT
    places = CHANNELS

    fraction_of_full: float = parameter("relative", 3e-3, lower=-0.5, upper=0.5)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        x = signals.inputs[:, self.columns]
        return with_inputs(signals, self.columns, x + self.fraction_of_full * x**2 / signals.references[self.columns])


@register
@dataclass(frozen=True)
class ScaleCubic(Effect):
    """The axis is nonlinear, alike for either sign: x + a x^3 / X^2, a the error at full scale, X the full reference.

    0.1-1 % of full scale: 0.3 % (ADXL330 data sheet), 0.1-0.5 % (HMC1001 data sheet).
    """

    name = "scale_cubic"
    stage = Stage.INPUT
    places = CHANNELS

    fraction_of_full: float = parameter("relative", 3e-3, lower=-0.5, upper=0.5)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        x = signals.inputs[:, self.columns]
        change = (
            self.fraction_of_full * x * x * x / signals.references[self.columns] ** 2
        )  # x**3 takes ten times as long
        return with_inputs(signals, self.columns, x + change)


@register
@dataclass(frozen=True)
class Hysteresis(Effect):
    """The axis remembers: the play operator of half-width r on x, y_k = min(x_k + r, max(x_k - r, y_(k-1))), y_0 = x_0.

    r is half_width times the channel's full reference. Hysteresis with repeatability is 0.05-0.1 % of full scale
    (HMC1001 data sheet); after a strong field several times as much, a guess.
    """

    name = "hysteresis"
    remembers = True
    rapid = True
    stage = Stage.INPUT
    places = CHANNELS

    half_width: float = parameter("relative", 1e-3, lower=0.0, upper=0.5)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        width = self.half_width * signals.references[self.columns]
        if self.half_width == 0.0:
            return signals
        return with_inputs(
            signals, self.columns, play(signals.inputs[:, self.columns].ravel(), float(width[0]))[:, None]
        )


@register
@dataclass(frozen=True)
class SensorLag(Effect):
    """The board's filter smooths the readings: tau V' + V = the ideal reading, tau the time constant, settled at first.

    The ideal reading between samples is their cubic spline, so that the effect is the same at any sampling rate.
    tau = 1 / (2 pi bandwidth): 0.3 ms at 500 Hz to 0.3 s at 0.5 Hz, the range of the ADXL330 (data sheet).
    """

    name = "sensor_lag"
    remembers = True
    stage = Stage.VOLTS
    places = SENSORS

    tau_s: float = parameter("s", 0.05, lower=0.0, upper=20.0)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        ideal = signals.volts[:, self.columns]
        if self.tau_s == 0.0 or not np.isfinite(ideal[0]).all():
            return signals
        volts = signals.volts.copy()
        volts[:, self.columns] = low_passed(signals.t, ideal, self.tau_s)
        return replace(signals, volts=volts)
