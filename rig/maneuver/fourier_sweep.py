"""A continuous sweep of all joints: each a short Fourier series, the usual trajectory of robot identification."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.arrays import Array
from rig.errors import RigError
from rig.joint_values import given_values, joint_values
from rig.maneuver._checks import A465_LIMITS_DEG, limits, number, numbers, poses, within
from rig.trajectory import JointTrajectory, sample_times

#: Instants at which its way is held against the limits, for each of its harmonics.
_ALONG = 200


@dataclass(frozen=True)
class FourierSweep:
    """Every joint a constant and L harmonics: q(t) = q0 + sum_l a_l cos(l w t) + b_l sin(l w t), w = 2 pi / duration.

    J. Swevers et al., "Optimal robot excitation and identification", IEEE Trans. Robotics and Automation 13(5), 1997.
    It begins and ends at rest where sum l b_l = 0 and sum l^2 a_l = 0 for every joint; that is the author's to see to.

    Attributes:
        centre_deg: q0 of each of N joints [deg], or [m] of joints that slide.
        cosine_deg: (N, L) a_l, a row for each joint [deg], or [m] of joints that slide.
        sine_deg: (N, L) b_l, a row for each joint [deg], or [m] of joints that slide.
        duration_s: of one period, which is all of it.
        rate_Hz: of the samples.
        limits_deg: (low, high) of each joint, checked here; None leaves that to the arm.
        slides: the numbers of the joints that slide, from 1.

    Raises:
        RigError: a value out of its range, another number of rows than joints, or a joint beyond a limit.
    """

    centre_deg: tuple[float, ...] = (0.0, 90.0, -90.0, 0.0, 0.0, 0.0)
    cosine_deg: tuple[tuple[float, ...], ...] = (
        (80.0, -20.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
    )
    sine_deg: tuple[tuple[float, ...], ...] = (
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (70.0, -35.0),
        (-100.0, 50.0),
    )
    duration_s: float = 90.0
    rate_Hz: float = 100.0
    limits_deg: tuple[tuple[float, float], ...] | None = A465_LIMITS_DEG
    slides: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("duration_s", "rate_Hz"):
            number(f"maneuver.{name}", getattr(self, name), 0.0, above=True)
        object.__setattr__(self, "centre_deg", numbers("maneuver.centre_deg", self.centre_deg))
        dof = len(self.centre_deg)
        for name in ("cosine_deg", "sine_deg"):
            rows = poses(f"maneuver.{name}", getattr(self, name))
            if len(rows) != dof:
                raise RigError(f"maneuver.{name}: found {len(rows)} rows, expected one for each of {dof} joints")
            object.__setattr__(self, name, rows)
        if len(self.cosine_deg[0]) != len(self.sine_deg[0]):
            found = f"{len(self.sine_deg[0])} beside {len(self.cosine_deg[0])} of cosine_deg"
            raise RigError(f"maneuver.sine_deg: found rows of {found}, expected as many")
        object.__setattr__(self, "limits_deg", limits("maneuver.limits_deg", self.limits_deg, dof))
        instants = np.linspace(0.0, self.duration_s, _ALONG * len(self.cosine_deg[0]))
        way = given_values(self.trajectory(instants).q, self.slides)
        for joint, (low, high) in enumerate(zip(way.min(axis=0), way.max(axis=0), strict=True), start=1):
            within("maneuver.centre_deg", joint, float(low), float(high), self.limits_deg)

    def trajectory(self, t: Array | None = None) -> JointTrajectory:
        """The joints at times ``t`` (n,) [s], by default the maneuver's own samples; exact at any time.

        Before the start and after the end the joints hold still where they begin.
        """
        times = sample_times(self.duration_s, self.rate_Hz) if t is None else np.asarray(t, dtype=float)
        coefficients = (np.transpose(values) for values in (self.centre_deg, self.cosine_deg, self.sine_deg))
        return series(times, self.duration_s, *(joint_values(values, self.slides) for values in coefficients))


def series(t: Array, duration_s: float, centre: Array, cosine: Array, sine: Array) -> JointTrajectory:
    """The motion at times ``t`` (n,) [s] of joints with constants (N,) and coefficients (L, N) [rad, m]."""
    turn = 2.0 * np.pi / duration_s * np.arange(1, len(cosine) + 1)
    angle = np.clip(t, 0.0, duration_s)[:, None] * turn
    c, s = np.cos(angle), np.sin(angle)
    moving = ((t >= 0.0) & (t <= duration_s))[:, None]
    qd = np.where(moving, _sum(c * turn, sine) - _sum(s * turn, cosine), 0.0)
    qdd = np.where(moving, -_sum(c * turn**2, cosine) - _sum(s * turn**2, sine), 0.0)
    return JointTrajectory(t, centre + _sum(c, cosine) + _sum(s, sine), qd, qdd)


def _sum(waves: Array, of_joints: Array) -> Array:
    """(n, N) of waves (n, L) with (L, N); the same for a row whatever rows are beside it, as a BLAS product is not."""
    return np.asarray(np.einsum("nl,lj->nj", waves, of_joints))
