"""Move and hold: the arm stops in many poses, with smooth motions between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.arrays import Array, Mask
from rig.joint_values import given_values, joint_values
from rig.maneuver._checks import A465_LIMITS_DEG, limits, number, poses, whole, within
from rig.maneuver.profile import PEAK_ACCELERATION, PEAK_SPEED, quintic
from rig.trajectory import JointTrajectory, sample_times

#: Ranges [deg] from which random poses are drawn: shoulder and elbow stay as in the sweep, clear of the table.
_RANDOM_DEG = ((-170.0, 170.0), (90.0, 90.0), (-90.0, -90.0), (-170.0, 170.0), (-100.0, 100.0), (-170.0, 170.0))

#: A move is shown at so many instants.
_ALONG = 30


@dataclass(frozen=True)
class StaticPoses:
    """Poses held for ``hold_s``, joined by moves of ``move_s`` that start and end without velocity or acceleration.

    Each move is the quintic of least order that does so, all joints at once.

    Attributes:
        poses_deg: k poses of N joint angles [deg], or [m] of joints that slide; None draws ``count`` random ones for
            the A465.
        count: of the random poses: joints 1, 4, 5 and 6 uniform within their limits, 2 and 3 as in the sweep.
        seed: decides the random poses.
        hold_s: time in a pose.
        move_s: time between two poses.
        rate_Hz: of the samples.
        limits_deg: (low, high) of each joint, checked here; None leaves that to the arm.
        slides: the numbers of the joints that slide, from 1.

    Raises:
        RigError: a value out of its range, or a pose beyond a limit.
    """

    poses_deg: tuple[tuple[float, ...], ...] | None = None
    count: int = 24
    seed: int = 0
    hold_s: float = 4.0
    move_s: float = 4.0
    rate_Hz: float = 100.0
    limits_deg: tuple[tuple[float, float], ...] | None = A465_LIMITS_DEG
    slides: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("hold_s", "move_s", "rate_Hz"):
            number(f"maneuver.{name}", getattr(self, name), 0.0, above=True)
        whole("maneuver.count", self.count, 1)
        whole("maneuver.seed", self.seed)
        if self.poses_deg is not None:
            object.__setattr__(self, "poses_deg", poses("maneuver.poses_deg", self.poses_deg))
        values = given_values(self.angles, self.slides)
        object.__setattr__(self, "limits_deg", limits("maneuver.limits_deg", self.limits_deg, values.shape[1]))
        for index, pose in enumerate(values.tolist()):
            for joint, angle in enumerate(pose, start=1):
                within(f"maneuver.poses_deg[{index}]", joint, angle, angle, self.limits_deg)

    @property
    def angles(self) -> Array:
        """The poses (k, N) [rad, m], given or drawn."""
        if self.poses_deg is not None:
            return joint_values(self.poses_deg, self.slides)
        low, high = np.array(_RANDOM_DEG).T
        rng = np.random.default_rng(self.seed)
        return np.asarray(np.radians(rng.uniform(low, high, size=(self.count, len(_RANDOM_DEG)))))

    @property
    def duration_s(self) -> float:
        """From the first hold to the end of the last [s]."""
        stops = len(self.angles)
        return stops * self.hold_s + (stops - 1) * self.move_s

    def peaks(self) -> tuple[Array, Array]:
        """(N,) the greatest speed and acceleration of each joint [rad, m, s]."""
        way = np.abs(np.diff(self.angles, axis=0)).max(axis=0, initial=0.0)
        return PEAK_SPEED * way / self.move_s, PEAK_ACCELERATION * way / self.move_s**2

    def way(self) -> Array:
        """(m, N) joint values along its moves [rad, m]."""
        return between(self.angles)

    def holding(self, t: Array) -> Mask:
        """(n,) whether the arm stands still at times (n,) [s]."""
        position, velocity, _ = stop_and_go(t, len(self.angles), self.hold_s, self.move_s)
        return np.asarray((velocity == 0.0) & (position == np.rint(position)))

    def trajectory(self, t: Array | None = None) -> JointTrajectory:
        """The joints at times ``t`` (n,) [s], by default the maneuver's own samples; exact at any time."""
        times = sample_times(self.duration_s, self.rate_Hz) if t is None else np.asarray(t, dtype=float)
        angles = self.angles
        progress, rate, change = stop_and_go(times, len(angles), self.hold_s, self.move_s)
        leg = np.clip(np.floor(progress).astype(int), 0, max(0, len(angles) - 2))
        step = np.diff(angles, axis=0)[leg] if len(angles) > 1 else np.zeros((len(times), angles.shape[1]))
        share = progress - leg
        # Written from both ends, so that a pose is met to the last bit whichever leg it belongs to.
        here, there = angles[leg], angles[np.minimum(leg + 1, len(angles) - 1)]
        q = np.where(share[:, None] < 1.0, here + share[:, None] * step, there)
        return JointTrajectory(times, q, rate[:, None] * step, change[:, None] * step)


def between(q: Array) -> Array:
    """(m, N) joint values along the moves between poses (k, N), or the one pose."""
    share = quintic(np.linspace(0.0, 1.0, _ALONG))[0]
    legs = q[:-1, None] + share[None, :, None] * np.diff(q, axis=0)[:, None]
    return np.asarray(legs.reshape(-1, q.shape[1])) if len(q) > 1 else q


def stop_and_go(t: Array, stops: int, hold_s: float, move_s: float) -> tuple[Array, Array, Array]:
    """How many stops are behind at times (n,) [s]: k while holding stop k, smooth between; and two derivatives."""
    cycle = hold_s + move_s
    stop = np.clip(np.floor(t / cycle), 0, stops - 1)  # an ulp either way is the same place: the step is clipped
    share = (t - stop * cycle - hold_s) / move_s
    last = stop == stops - 1
    x, x1, x2 = quintic(np.where(last, 0.0, share))
    return stop + x, x1 / move_s, x2 / move_s**2
