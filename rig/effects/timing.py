"""Effects on when a reading was taken."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.channels import SENSORS
from rig.effects._numerics import shifted, slopes
from rig.effects.base import Effect, Kind, Stage, register
from rig.effects.parameters import parameter
from rig.signals import Signals

if TYPE_CHECKING:
    from rig.pipeline import Pipeline


@register
@dataclass(frozen=True)
class Latency(Effect):
    """The reading at t belongs to the pose at t - delay_s: x(t) -> x(t - d), one delay d for the channels of its place.

    The inputs are shifted by a cubic spline through the samples; beyond the ends of the recording they hold.
    1-100 ms for a board with a buffer; a guess.
    """

    name = "latency"
    remembers = True
    stage = Stage.INPUT
    places = ("acquisition", *SENSORS)

    delay_s: float = parameter("s", 0.02, lower=-5.0, upper=5.0)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.delay_s == 0.0:
            return signals
        inputs = signals.inputs.copy()
        inputs[:, self.columns] = shifted(signals.t, inputs[:, self.columns], signals.t - self.delay_s)
        return replace(signals, inputs=inputs)


@register
@dataclass(frozen=True)
class TimingJitter(Effect):
    """Each reading is taken a little off its time: at t_j + e_j, e_j independent and normal with sigma_s.

    It shows as noise in proportion to how fast a reading changes: sigma_s |dx/dt|; what is read off its time is what a
    slow sensor makes of the input. 1-10 ms where a desktop computer keeps the time, less by far where the board does; a
    guess.
    """

    name = "timing_jitter"
    stage = Stage.VOLTS
    kind = Kind.NOISE
    places = ("acquisition",)
    adds_in_time = True

    sigma_s: float = parameter("s", 5e-3, lower=0.0, upper=5.0)

    @override
    def response(self, base: Signals, pipeline: Pipeline) -> Array:
        """(n, 6, 1) [recorded unit/s]: the slope of the readings; all channels are read at the same wrong time."""
        return slopes(base.t, base.volts)[:, :, None]

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.sigma_s == 0.0:
            return signals
        at = signals.t + self.sigma_s * rng.standard_normal(len(signals))
        return replace(signals, volts=shifted(signals.t, signals.volts, at))
