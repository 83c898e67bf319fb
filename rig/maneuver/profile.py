"""Motion laws of one joint, as polynomials of time: back and forth with rounded corners, and from pose to pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.arrays import Array

# The velocity in a corner goes from -v to v as v s(x), x from -1 to 1, s = (15 x - 10 x^3 + 3 x^5)/8: acceleration and
# jerk begin and end at zero. The distance run in half a corner is 11/16 of what full speed would give.
_CORNER_SHARE = 11 / 16
# From rest the velocity is v u(x), x from 0 to 1, u = 10 x^3 - 15 x^4 + 6 x^5. It runs 1/2 of what full speed would,
# so with 5/8 of half a corner's time it loses just as much as half a corner does: the speed of all passes is one.
_START_SHARE = 5 / 8
#: Greatest speed and acceleration of the quintic step from 0 to 1 in a unit of time.
PEAK_SPEED: Final = 15.0 / 8.0
PEAK_ACCELERATION: Final = 10.0 / np.sqrt(3.0)
_PEAK = 15 / 8  # the greatest slope of both s and u


@dataclass(frozen=True)
class BackAndForth:
    """Passes between two ends, each in the same time, at constant speed but for rounded corners.

    It starts and ends at rest, and holds still before and after. The ends are reached exactly, in the middle of the
    corners. Position, velocity, acceleration and jerk are continuous.

    Attributes:
        low, high: the ends; the first pass goes from low to high.
        passes: their number.
        duration: of all passes together [s].
        corner: time from full speed to full speed the other way [s], at most the duration of a pass.
    """

    low: float
    high: float
    passes: int
    duration: float
    corner: float

    @property
    def speed(self) -> float:
        """The speed between the corners, a little above the average."""
        return (self.high - self.low) / (self.duration / self.passes - (1 - _CORNER_SHARE) * self.corner)

    @property
    def peak_acceleration(self) -> float:
        """The greatest acceleration: at the start and the end, where it is 1.6 times that in the corners."""
        return _PEAK * abs(self.speed) / (_START_SHARE * self.corner / 2)

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration, each (n,), at times (n,) [s]."""
        a_pass = self.duration / self.passes
        inside = np.clip(t, 0.0, self.duration)
        end = np.rint(inside / a_pass)  # the nearest end of a pass: even ones are at ``low``
        since = inside - end * a_pass
        elapsed = np.abs(since)  # the motion is mirrored in time about every end
        sign = 1.0 - 2.0 * (end % 2.0)
        half = self.corner / 2
        distance = self.speed * (elapsed - (1 - _CORNER_SHARE) * half)
        speed = np.full_like(distance, self.speed)
        acceleration = np.zeros_like(distance)
        at_rest = (end == 0.0) | (end == self.passes)
        for rows, time, law in (
            (~at_rest & (elapsed < half), half, _corner),
            (at_rest & (elapsed < _START_SHARE * half), _START_SHARE * half, _start),
        ):
            index = np.flatnonzero(rows)
            x, x1, x2 = law(elapsed[index] / time)
            distance[index] = self.speed * time * x
            speed[index] = self.speed * x1
            acceleration[index] = self.speed / time * x2
        position = np.where(sign > 0, self.low, self.high) + sign * distance
        return position, sign * np.sign(since) * speed, sign * acceleration


def quintic(x: Array) -> tuple[Array, Array, Array]:
    """The step from 0 to 1, velocity and acceleration zero at both ends, and its two derivatives; x (n,) in [0, 1]."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 + x * (6 * x - 15)), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)


def _corner(x: Array) -> tuple[Array, Array, Array]:
    """The integral of s, s itself and its derivative."""
    y = x * x
    return y * (15 + y * (y - 5)) / 16, x * (15 + y * (3 * y - 10)) / 8, _PEAK * (1 - y) ** 2


def _start(x: Array) -> tuple[Array, Array, Array]:
    """The integral of u, u itself and its derivative."""
    u, u1, _ = quintic(x)
    return x**4 * (2.5 + x * (x - 3)), u, u1
