"""A sensor tumbled by hand: smooth random rotation without an arm, for methods that need no attitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rig.arrays import Array, Mask
from rig.errors import check_name
from rig.maneuver._checks import number, whole
from rig.maneuver.static_poses import stop_and_go
from rig.trajectory import PoseTrajectory, sample_times

Coverage = Literal["full", "hemisphere"]

_COVERAGES = ("full", "hemisphere")
_SINUSOIDS = 8  # a signal: near enough to a Gaussian process, and cheap
_HEADING_RAD = 2.0  # RMS heading of a hemisphere's tumble


@dataclass(frozen=True)
class HandTumble:
    """A smooth random rotation with a little translation, a closed form of time, decided by its seed.

    Four band-limited signals u(t), each a sum of sinusoids, make the quaternion u/|u|. For Gaussian u that is uniform
    over all rotations. The tumble of a hemisphere never turns the sensor's z axis below the horizontal; its direction
    is uniform over the hemisphere: with a, b Gaussian, cos(tilt) = exp(-(a^2 + b^2)/2) is uniform in [0, 1].

    Attributes:
        seed: decides the motion.
        duration_s: of the whole maneuver.
        rate_Hz: of the samples.
        speed_deg_per_s: RMS angular speed; with holds, that of the same way at a constant pace.
        coverage: "full" or "hemisphere".
        sway_m: RMS amplitude of the sensor's translation along each axis of the base.
        sway_Hz: frequency of the sensor's translation.
        hold_s: above zero, the sensor stands still for so long between two moves, again and again, beginning with a
            stop: the static method for the accelerometer (Camps et al.).
        move_s: time of a move between two holds.

    Raises:
        RigError: a value out of its range.
    """

    seed: int = 0
    duration_s: float = 120.0
    rate_Hz: float = 100.0
    speed_deg_per_s: float = 60.0
    coverage: Coverage = "full"
    sway_m: float = 0.01
    sway_Hz: float = 0.5
    hold_s: float = 0.0
    move_s: float = 2.0

    def __post_init__(self) -> None:
        whole("maneuver.seed", self.seed)
        for name in ("duration_s", "rate_Hz", "speed_deg_per_s", "move_s"):
            number(f"maneuver.{name}", getattr(self, name), 0.0, above=True)
        for name in ("sway_m", "sway_Hz", "hold_s"):
            number(f"maneuver.{name}", getattr(self, name), 0.0)
        check_name("maneuver.coverage", self.coverage, _COVERAGES)

    def trajectory(self, t: Array | None = None) -> PoseTrajectory:
        """The sensor at times ``t`` (n,) [s], by default the maneuver's own samples; exact at any time."""
        times = sample_times(self.duration_s, self.rate_Hz) if t is None else np.asarray(t, dtype=float)
        clock, rate, change = self._clock(times)
        turning, swaying = (np.random.default_rng([self.seed, stream]) for stream in (0, 1))
        R_base_tool = (_full if self.coverage == "full" else _hemisphere)(
            clock, np.radians(self.speed_deg_per_s), turning
        )
        position = np.empty((len(times), 3))
        acceleration = np.empty((len(times), 3))
        for axis in range(3):
            x, x1, x2 = _signal(2 * np.pi * self.sway_Hz, swaying, clock, derivatives=True)
            position[:, axis] = self.sway_m * x
            acceleration[:, axis] = self.sway_m * (x2 * rate**2 + x1 * change)
        return PoseTrajectory(times, R_base_tool, position, acceleration)

    def holding(self, t: Array) -> Mask:
        """(n,) whether the sensor stands still at times (n,) [s]."""
        return np.asarray(self._clock(np.asarray(t, dtype=float))[1] == 0.0)

    def _clock(self, t: Array) -> tuple[Array, Array, Array]:
        """The time [s] that has passed for the motion, which stands still during holds; and its two derivatives."""
        if self.hold_s == 0.0:
            return t, np.ones_like(t), np.zeros_like(t)
        stops = int(self.duration_s // (self.hold_s + self.move_s)) + 2
        moves, rate, change = stop_and_go(t, stops, self.hold_s, self.move_s)
        return self.move_s * moves, self.move_s * rate, self.move_s * change


def _signal(rate: float, rng: np.random.Generator, t: Array, derivatives: bool = False) -> tuple[Array, Array, Array]:
    """A random signal (n,) of variance one whose derivative has RMS ``rate`` [1/s]; two derivatives, zero if not asked.

    A sum of sinusoids with frequencies spread over an octave and a half about the mean, and random phases.
    """
    frequency = rng.uniform(0.5, 1.5, _SINUSOIDS)
    frequency *= rate / np.sqrt(np.mean(frequency**2))
    phase = rng.uniform(0, 2 * np.pi, _SINUSOIDS)
    x, x1, x2 = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for omega, start in zip(frequency, phase, strict=True):
        angle = omega * t + start
        cosine = np.cos(angle)
        x += cosine
        if derivatives:
            x1 -= omega * np.sin(angle)
            x2 -= omega**2 * cosine
    scale = np.sqrt(2 / _SINUSOIDS)
    return scale * x, scale * x1, scale * x2


def _full(t: Array, speed: float, rng: np.random.Generator) -> Array:
    """(n, 3, 3) from a random quaternion; RMS angular speed [rad/s].

    |w| = 2 |u' across u| / |u|, and E |u' across u|^2 = 3 rate^2, E 1/|u|^2 = 1/2: the RMS of w is sqrt(6) rate.
    """
    u = np.stack([_signal(speed / np.sqrt(6), rng, t)[0] for _ in range(4)], axis=1)
    return np.asarray(Rotation.from_quat(u, scalar_first=True).as_matrix())


def _hemisphere(t: Array, speed: float, rng: np.random.Generator) -> Array:
    """(n, 3, 3): a tilt below 90 deg about a random horizontal axis, then a random heading; RMS angular speed [rad/s].

    With x = (a^2 + b^2)/2 exponential, the tilting part has mean square rate^2 (E[2 x c^2/(1 - c^2)] + E[(1 - c)/x]),
    c = exp(-x): rate^2 (pi^2/4 - 2 + log 2). The heading adds (heading RMS)^2 rate^2.
    """
    rate = speed / np.sqrt(np.pi**2 / 4 - 2 + np.log(2) + _HEADING_RAD**2)
    a, b, heading = (_signal(rate, rng, t)[0] for _ in range(3))
    square = a * a + b * b
    cosine = np.exp(-square / 2)
    # sin(tilt)/sqrt(a^2 + b^2), which is 1 at a = b = 0
    slope = np.sqrt(-np.expm1(-square) / np.maximum(square, np.finfo(float).tiny))
    slope = np.where(square > 0, slope, 1.0)
    # The quaternion of the tilt is (1 + cos, -b sin/., a sin/., 0) up to its length; the heading turns it about z.
    half_cos, half_sin = np.cos(_HEADING_RAD * heading / 2), np.sin(_HEADING_RAD * heading / 2)
    w, x, y = 1 + cosine, -slope * b, slope * a
    u = np.stack([half_cos * w, half_cos * x - half_sin * y, half_cos * y + half_sin * x, half_sin * w], axis=1)
    return np.asarray(Rotation.from_quat(u, scalar_first=True).as_matrix())
