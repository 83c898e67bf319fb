"""Effects of the supply and the wiring: what they add to the readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.polynomial.chebyshev import chebval
from typing_extensions import override

from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects.base import Effect, Stage, register
from rig.effects.drift import with_volts
from rig.effects.parameters import choice, frequency, parameter
from rig.errors import RigError
from rig.signals import Signals

#: The sensors' output range [V], and how far beyond it readings may stray.
_RANGE, _STRAY = (0.0, 5.0), 0.5


def mid_scale(readings: Array) -> float:
    """The middle of a channel's scale: 2.5 V where its readings lie within 0 to 5 V, else their mean."""
    low, high = float(np.min(readings)), float(np.max(readings))
    if low >= _RANGE[0] - _STRAY and high <= _RANGE[1] + _STRAY:
        return 0.5 * (_RANGE[0] + _RANGE[1])
    return float(np.mean(readings))


#: Half waves of the supply's waveform: it resolves a twelfth of the recording, 140 s of a sweep of 1664 s, faster than
#: a supply warms or a laboratory's heating cycles.
_COSINES: Final = 24


@register
@dataclass(frozen=True)
class SupplyRatiometric(Effect):
    """The supply drifts, and every reading with it: V (1 + e(t)), e a slow waveform and the recorded supply.

    e(t) = supply_V (U(t)/mean U - 1) + sum_k w_k cos(pi k (t - t0)/(t1 - t0)), k = 1 to 24: the recorded supply U,
    followed in full where supply_V is 1 (one that was not recorded counts as constant); and a smooth waveform over the
    recording from t0 to t1, which resolves a twelfth of it. The mean is left out: sensitivities and offsets hold it.
    A chip that gives a field in the field's own unit has a reference of its own. 0.1-1 %; a guess.
    """

    name = "supply_ratiometric"
    requires = ("volts",)
    of_recording = True
    stage = Stage.VOLTS
    places = ("supply",)

    waveform: tuple[float, ...] = parameter("relative", 1e-3, lower=-0.5, upper=0.5, size=_COSINES, of_cosines=True)
    supply_V: float = parameter("relative", 1.0, lower=-10.0, upper=10.0)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        elapsed = (signals.t - signals.t[0]) / max(float(signals.t[-1] - signals.t[0]), np.finfo(float).tiny)
        change = chebval(np.cos(np.pi * elapsed), (0.0, *self.waveform))  # cos k x is the k-th Chebyshev polynomial
        if signals.supply is not None and abs(mean := float(np.mean(signals.supply))) > np.finfo(float).tiny:
            change = change + self.supply_V * (signals.supply / mean - 1.0)  # one of zero volts was not measured
        return replace(signals, volts=signals.volts * (1.0 + change)[:, None])


@register
@dataclass(frozen=True)
class ChannelCrosstalk(Effect):
    """A neighbouring wire couples in: V_i + c (V_j - m), c the coefficient, i the channel disturbed, j the source.

    m is the middle of j's scale: 2.5 V where its readings lie within 0 to 5 V, else their mean. 0.1-1 %; a guess.
    """

    name = "channel_crosstalk"
    stage = Stage.VOLTS
    places = CHANNELS

    source: str = choice(CHANNELS)
    coefficient: float = parameter("relative", 5e-3, lower=-1.0, upper=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.source == self.where:
            raise RigError(
                f"effect channel_crosstalk.source: found {self.source}, expected another channel than its own"
            )

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        source = signals.volts[:, [CHANNELS.index(self.source)]]
        coupled = self.coefficient * (source - mid_scale(source))
        return with_volts(signals, self.columns, coupled)


@register
@dataclass(frozen=True)
class MainsHum(Effect):
    """The mains couple into every channel: V_k + A_k sin(2 pi f t + p_k), A the amplitude, p the phase, f the
    frequency, near 50 or 60 Hz.

    The frequency of a sampled signal is known only modulo the sampling rate. It lies within 2 %, as EN 50160 allows a
    supply that stands alone. Millivolts; a guess.
    """

    name = "mains_hum"
    of_recording = True
    stage = Stage.VOLTS
    places = ("acquisition",)
    tone = True
    bands = ((49.0, 51.0), (58.8, 61.2))

    freq_Hz: float = frequency(50.0)
    amplitude: tuple[float, ...] = parameter("V", 2e-3, size=6)
    phase_rad: tuple[float, ...] = parameter(
        "rad", np.pi, size=6, strength=False, default=0.0, spanned=((0.0,) * 6, (np.pi / 2.0,) * 6)
    )

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        turns = 2.0 * np.pi * self.freq_Hz * signals.t
        # A sin(x + p) = A cos p sin x + A sin p cos x: two columns of sines for six channels.
        amplitude, phase = np.asarray(self.amplitude), np.asarray(self.phase_rad)
        hum = np.outer(np.sin(turns), amplitude * np.cos(phase)) + np.outer(np.cos(turns), amplitude * np.sin(phase))
        return with_volts(signals, self.columns, hum)
