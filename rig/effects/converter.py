"""Effects of the converter on sampled, noisy readings: what they do to the readings' distribution."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rig.channels import CHANNELS
from rig.effects.base import Effect, Kind, Stage, parameter, register
from rig.effects.electronic import MIDDLE
from rig.signals import Signals

#: A level [V] that no reading reaches: the converter's full scale.
_OUT_OF_REACH: Final = 10.0


@register
@dataclass(frozen=True)
class Saturation(Effect):
    """A channel is clipped at a level: V -> min(V, level); a level below the middle, 2.5 V, clips from below.

    It changes nothing at 10 V, the converter's full scale. The output stage of a sensor on 5 V saturates within 0.2 V
    of its rails; an amplifier set too high, anywhere; a guess.
    """

    name = "saturation"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = CHANNELS

    level: float = parameter("V", 3.8, lower=-_OUT_OF_REACH, upper=_OUT_OF_REACH, neutral=_OUT_OF_REACH)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        volts = signals.volts.copy()
        clip = np.minimum if self.level >= MIDDLE else np.maximum
        volts[:, self.columns] = clip(volts[:, self.columns], self.level)
        return replace(signals, volts=volts)


@register
@dataclass(frozen=True)
class AdcQuantisation(Effect):
    """A coarser converter than stated: every reading is rounded to a multiple of lsb_V; zero rounds nothing.

    1.22 mV is the stated step of 14 bit over +-10 V (MathWorks, adquanserq8.c); eight times that is a worn 11 bit.
    """

    name = "adc_quantisation"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    lsb_V: float = parameter("V", 10e-3, lower=0.0, upper=1.0)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.lsb_V == 0.0:
            return signals
        return replace(signals, volts=np.round(signals.volts / self.lsb_V) * self.lsb_V)


@register
@dataclass(frozen=True)
class Outliers(Effect):
    """Rare spikes: each reading of each channel, with probability ``share``, is off by +size_V or -size_V.

    1e-4 to 1e-3 of the readings, by a few tenths of a volt: a loose contact, a bit that is misread; a guess.
    """

    name = "outliers"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    share: float = parameter("relative", 3e-4, lower=0.0, upper=1.0)
    size_V: float = parameter("V", 0.5, lower=0.0, upper=10.0, strength=False)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        shape = signals.volts.shape
        sign = np.where(rng.random(shape) < 0.5, -1.0, 1.0)
        return replace(signals, volts=signals.volts + self.size_V * sign * (rng.random(shape) < self.share))


@register
@dataclass(frozen=True)
class Dropouts(Effect):
    """A sample is missed: with probability ``share`` all channels repeat their last reading, which may be one already.

    1e-3 of the samples; a guess.
    """

    name = "dropouts"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    share: float = parameter("relative", 1e-3, lower=0.0, upper=1.0)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        rows = np.arange(len(signals))
        rows[rng.random(len(signals)) < self.share] = 0  # the first reading has none before it
        return replace(signals, volts=signals.volts[np.maximum.accumulate(rows)])
