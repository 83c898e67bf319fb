"""Effects of the sensor's own motion: its acceleration along the path, and vibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from rig.effects._numerics import curvature, times
from rig.effects.base import Effect, Stage, register
from rig.effects.parameters import choice, frequency, parameter, phase
from rig.errors import RigError
from rig.signals import Signals


@register
@dataclass(frozen=True)
class MotionAcceleration(Effect):
    """The quasi-static assumption dropped: the reading is S P . R^T (g - a) + delta, a the acceleration of the
    site, which lies a lever from where the model has it.

    The site lies a lever arm l (frame 6) from where the model has it: a = d^2/dt^2 (p + R_base_tool l), by a parabola
    fitted to the samples around each (``CURVATURE_SPAN``); of logged poses that were interpolated by the smooth path
    through their nodes, as chords have no acceleration but at their ends. Signals that bring the motion's exact
    acceleration keep it and only the lever's is added.

    There is no strength: the effect acts by being there, l = 0 is the acceleration of the model's own site. It grows
    with the square of the speed: 1 mm/s^2 at the 3.1 deg/s of Renk's sweep, 0.4 m from the axis, and 0.1 g at 90 deg/s.
    Lever arms of centimetres; a guess.
    """

    name = "motion_acceleration"
    remembers = True
    rapid = True
    stage = Stage.POSE
    places = ("accelerometer",)
    requires = ("position",)
    acts_at_zero = True

    lever_m: tuple[float, ...] = parameter("m", 0.02, lower=-1.0, upper=1.0, size=3)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        quasi_static = signals.acceleration.ndim == 1
        nodes = signals.pose_nodes
        rotation, site = (signals.R_base_tool, signals.position) if nodes is None else nodes.smooth(signals.t)
        path = site if quasi_static else np.zeros_like(site)
        if any(self.lever_m):
            path = path + times(rotation, self.lever_m)
        elif not quasi_static:
            return signals
        return replace(signals, acceleration=signals.acceleration + curvature(signals.t, path))


@register
@dataclass(frozen=True)
class Vibration(Effect):
    """The sensor shakes: a(t) = d sin(2 pi f t + p) is added to its acceleration, d the amplitude along a direction, f
    the frequency, p the phase.

    d = amplitude_m_s2 times the unit vector along ``direction``, resolved in ``frame``, in which it is fixed: the base,
    link 1 or the tool. The frequency of a sampled signal is known only modulo the sampling rate.

    1-30 mg, from motors and fans; a guess.
    """

    name = "vibration"
    of_recording = True
    stage = Stage.FIELD  # after the pose: the path's own acceleration does not contain it
    places = ("accelerometer",)
    tone = True

    amplitude_m_s2: float = parameter("m/s^2", 0.1)
    freq_Hz: float = frequency(25.0)
    phase_rad: float = phase()
    direction: tuple[float, ...] = parameter(
        "relative",
        1.0,
        size=3,
        strength=False,
        unit_vector=True,
        default=(0.0, 0.0, 1.0),
        spanned=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    )
    frame: str = choice(("base", "link1", "tool"), "base")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.direction):
            raise RigError("effect vibration.direction: found zero, expected a vector of any length above it")

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        fixed = self.amplitude_m_s2 / np.linalg.norm(self.direction) * np.asarray(self.direction)
        if self.frame == "base":
            vector = fixed[None]
        elif self.frame == "tool":
            vector = times(signals.R_base_tool, fixed)
        else:
            vector = times(signals.link_rotation(0), fixed)
        wave = np.sin(2.0 * np.pi * self.freq_Hz * signals.t + self.phase_rad)
        return replace(signals, acceleration=signals.acceleration + wave[:, None] * vector)
