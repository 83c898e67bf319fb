"""Effects that are noise on the sampled readings: more of it, coloured, or wandering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.channels import CHANNELS, SENSORS
from rig.effects._numerics import exponential_spectrum, gauss_markov
from rig.effects.base import Effect, Kind, Stage, register
from rig.effects.drift import with_volts
from rig.effects.parameters import parameter
from rig.signals import Signals


@register
@dataclass(frozen=True)
class NoiseExcess(Effect):
    """More white noise than the floor: V + e, e independent and normal with extra_sigma.

    A fraction of the floor of 7-15 mV (Renk et al., noise tables) and more; a guess.
    """

    name = "noise_excess"
    stage = Stage.ELECTRONIC
    kind = Kind.NOISE
    places = CHANNELS

    extra_sigma: float = parameter("V", 5e-3, lower=0.0)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return with_volts(signals, self.columns, self.extra_sigma * rng.standard_normal((len(signals), 1)))


@register
@dataclass(frozen=True)
class NoiseColoured(Effect):
    """Noise that remembers: V + e with autocovariance sigma_V^2 exp(-|lag|/tau_s), one sigma an axis.

    A first-order autoregression at any sampling, e_(k+1) = a e_k + sqrt(1 - a^2) sigma w_k, a = exp(-dt/tau); its
    spectrum is flat below 1/(2 pi tau) and falls with 1/f^2 above. Several, a decade apart in tau, make 1/f. As large
    as the white floor, over 0.5-2 s; a guess; measured by the Allan deviation.
    """

    name = "noise_coloured"
    stage = Stage.ELECTRONIC
    kind = Kind.NOISE
    places = SENSORS

    sigma_V: tuple[float, ...] = parameter("V", 5e-3, lower=0.0, size=3, by_axis=True)
    tau_s: float = parameter("s", 1.0, lower=1e-6, upper=1e6, strength=False, grid=(0.25, 0.5, 1.0, 2.0, 4.0, 8.0))

    @override
    def added_spectrum(self, frequency: Array, interval_s: float) -> Array:
        return exponential_spectrum(frequency, interval_s, self.tau_s)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        white = rng.standard_normal((len(signals), 3)) * np.asarray(self.sigma_V)
        return with_volts(signals, self.columns, gauss_markov(signals.t, self.tau_s, white))


@register
@dataclass(frozen=True)
class BiasRandomWalk(Effect):
    """The offset wanders: V + w(t), w a random walk from zero with variance rate^2 t, one rate an axis.

    The line of slope +1/2 of the Allan deviation; 0.1-1 mV/sqrt(s); a guess.
    """

    name = "bias_random_walk"
    stage = Stage.ELECTRONIC
    kind = Kind.NOISE
    places = SENSORS

    rate: tuple[float, ...] = parameter("V/sqrt(s)", 3e-4, lower=0.0, size=3, by_axis=True)

    @override
    def added_spectrum(self, frequency: Array, interval_s: float) -> Array:
        return interval_s / (2.0 * np.sin(np.pi * frequency)) ** 2

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        steps = np.sqrt(np.diff(signals.t, prepend=signals.t[0]))[:, None] * self.rate
        return with_volts(signals, self.columns, np.cumsum(steps * rng.standard_normal(steps.shape), axis=0))
