"""Maneuvers that an arm could make next: sweeps of other joints, ranges, speeds and poses, and stops all over."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.arm import Arm
from rig.errors import RigError
from rig.maneuver import StaticPoses, TorusSweep

Array = NDArray[np.float64]

#: The arm keeps this far above the plane of its base [m], and this far from its column below the shoulder [m].
_CLEARANCE_M: Final = 0.12
_COLUMN_M: Final = 0.15
#: Samples at which clearance and speed are checked.
_CHECKED: Final = 200
#: A joint is swept over at most this share of its range, so that no limit is touched.
_SHARE: Final = 0.97
_SPEEDS: Final = (0.25, 0.5, 2.0, 4.0, 16.0)
#: Angles [deg] to which a locked joint is moved from where it was.
_ELSEWHERE: Final = (-60.0, -30.0, 30.0, 60.0, 90.0)
#: A sweep's passes and a maneuver's stops are so many, or fewer in a short time: so slow a joint [deg/s], so long a
#: stop with the way to it [s].
_PASSES: Final = (15, 7)
_SLOW_DEG_S: Final = 12.0
#: The fastest roll that is tried [deg/s].
_FAST_DEG_S: Final = 120.0
_POSES: Final = 30
_STOP_S: Final = 4.0


@dataclass(frozen=True)
class Reach:
    """What an arm may do.

    Attributes:
        arm: with its joints' limits.
        home_deg: (N,) where its joints were, on average.
        speed_deg_s: (N,) the fastest that each may go.
        rolls: whether the last joint may roll on for ever.
    """

    arm: Arm
    home_deg: Array
    speed_deg_s: Array
    rolls: bool

    @classmethod
    def of(cls, arm: Arm, t: Array, q: Array) -> Reach:
        """Of a recording's arm: the model's own speed limits, else twice what was recorded."""
        limited = {arm.model.numeric(index).name for index in range(arm.model.nnumeric)}
        if "joint_speed_limit_deg_s" in limited:
            speed = np.array(arm.model.numeric("joint_speed_limit_deg_s").data, dtype=np.float64)[: arm.dof]
        else:
            recorded = np.degrees(np.abs(np.diff(q, axis=0) / np.diff(t)[:, None]).max(axis=0))
            speed = np.maximum(2.0 * recorded, 10.0)
        home = np.degrees(np.median(q, axis=0))
        low, high = cls._limits(arm)
        home = np.where((home < low) | (home > high), 0.5 * (low + high), home)
        return cls(arm, np.asarray(np.round(home, 1), dtype=np.float64), speed, bool(np.ptp(q[:, -1]) > 2.0 * np.pi))

    @staticmethod
    def _limits(arm: Arm) -> tuple[Array, Array]:
        low, high = np.degrees(arm.lower), np.degrees(arm.upper)
        roll = np.degrees(arm.roll_range)
        low[-1], high[-1] = max(low[-1], roll[0]), min(high[-1], roll[1])
        return np.maximum(low, -180.0), np.minimum(high, 180.0)

    @property
    def limits_deg(self) -> tuple[Array, Array]:
        """Lower and upper limits (N,) [deg]; of a joint without any, one turn."""
        return self._limits(self.arm)

    @property
    def checked(self) -> tuple[tuple[float, float], ...] | None:
        """What a maneuver checks itself: the A465's limits; of another arm the scenario does."""
        return TorusSweep.limits_deg if self.arm.name == "a465" else None

    def allows(self, maneuver: TorusSweep | StaticPoses) -> bool:
        """Whether the arm stays within its limits and speeds, and clear of what it stands on."""
        t = np.linspace(0.0, maneuver.duration_s, _CHECKED, endpoint=False)
        motion = maneuver.trajectory(t)
        try:
            self.arm.check_limits(motion.q, "the maneuver")
        except RigError:
            return False
        if (np.degrees(np.abs(motion.qd)) > self.speed_deg_s).any():
            return False
        places = np.concatenate(
            [self.arm.link_poses(motion.q).position[:, 1:], self.arm.poses(motion.q).position[:, None]], axis=1
        )
        shoulder = places[0, 0, 2]
        low = places[:, :, 2] < shoulder
        near = np.hypot(places[:, :, 0], places[:, :, 1]) < _COLUMN_M
        return bool(places[:, :, 2].min() > min(_CLEARANCE_M, 0.9 * shoulder) and not (low & near)[:, 1:].any())


def family(reach: Reach, recorded: TorusSweep | StaticPoses) -> Iterator[TorusSweep | StaticPoses]:
    """Maneuvers to choose from, all of the recorded one's duration and rate: itself first; some may not be allowed."""
    yield recorded
    sweep = recorded if isinstance(recorded, TorusSweep) else None
    for joints in itertools.combinations(range(reach.arm.dof), 3):
        made = _sweep(reach, joints, recorded.duration_s, recorded.rate_Hz)
        if made is None:
            continue
        sweep = sweep or made
        yield made
    if sweep is not None:
        yield from _variants(reach, sweep)
    for seed, (spread, held) in enumerate(itertools.product((0.5, 1.0), (0.1, 0.5, 0.9))):
        yield stops(reach, recorded.duration_s, recorded.rate_Hz, seed, spread, held)


def _sweep(reach: Reach, joints: tuple[int, ...], duration_s: float, rate_Hz: float) -> TorusSweep | None:
    """These joints over as much of their ranges as the clearance lets them, the rest at home."""
    low, high = reach.limits_deg
    home = reach.home_deg
    yaw, pitch, roll = joints
    last = reach.arm.dof - 1
    for share in (_SHARE, 0.6, 0.3):
        widest = share * (high - low)
        centre = np.clip(home, low + 0.5 * widest, high - 0.5 * widest)
        extents = np.where(np.isin(np.arange(reach.arm.dof), (0, last)), _SHARE * (high - low), widest)
        centre = np.where(np.isin(np.arange(reach.arm.dof), (0, last)), 0.5 * (low + high), centre)
        if roll != last and abs(centre[roll]) > 1e-9:  # a sweeping roll is about zero
            extents[roll] = 2.0 * min(extents[roll] / 2.0, high[roll], -low[roll])
            if extents[roll] <= 0.0:
                return None
        made = _made(
            duration_s=duration_s,
            rate_Hz=rate_Hz,
            yaw_range_deg=_rounded(extents[yaw]),
            yaw_centre_deg=_rounded(centre[yaw]),
            yaw_passes=_passes(_PASSES[0], extents[yaw], duration_s),
            pitch_range_deg=_rounded(extents[pitch]),
            pitch_centre_deg=_rounded(centre[pitch]),
            pitch_passes=_passes(_PASSES[1], extents[pitch], duration_s),
            roll="continuous" if reach.rolls and roll == last else "sweep",
            roll_range_deg=_rounded(extents[roll]),
            roll_deg_per_s=_rounded(
                13.9
                if reach.rolls and roll == last
                else _passes(22, extents[roll], duration_s) * extents[roll] / duration_s
            ),
            locked_deg=tuple(home[joint] for joint in range(reach.arm.dof) if joint not in joints),
            corner_s=min(0.5, duration_s / 60.0),
            joints=(yaw + 1, pitch + 1, roll + 1),
            limits_deg=reach.checked,
        )
        if made is not None and reach.allows(made):
            return made
    return None


def _variants(reach: Reach, sweep: TorusSweep) -> Iterator[TorusSweep]:
    """The sweep with a locked joint elsewhere, at other speeds, with other ranges, and with a roll that reverses."""
    for index, angle in itertools.product(range(len(sweep.locked_deg)), _ELSEWHERE):
        yield from _other(sweep, locked_deg=_with(sweep.locked_deg, index, sweep.locked_deg[index] + angle))
    for factor in _SPEEDS:
        yaw, pitch = (max(1, round(factor * passes)) for passes in (sweep.yaw_passes, sweep.pitch_passes))
        roll = factor * sweep.roll_deg_per_s
        yield from _other(sweep, yaw_passes=yaw)
        yield from _other(sweep, pitch_passes=pitch)
        yield from _other(sweep, roll_deg_per_s=roll)
        yield from _other(sweep, yaw_passes=yaw, pitch_passes=pitch, roll_deg_per_s=min(roll, _FAST_DEG_S))
    for share in (0.3, 0.6):
        yield from _other(sweep, yaw_range_deg=share * sweep.yaw_range_deg)
        yield from _other(sweep, pitch_range_deg=share * sweep.pitch_range_deg)
    if sweep.roll == "continuous":
        low, high = reach.limits_deg
        roll = sweep.joints[2] - 1
        widest = _SHARE * 2.0 * min(high[roll], -low[roll])
        for speed in (0.25, 1.0):
            yield from _other(
                sweep, roll="sweep", roll_range_deg=_rounded(widest), roll_deg_per_s=speed * sweep.roll_deg_per_s
            )


def _passes(most: int, extent_deg: float, duration_s: float) -> int:
    return int(np.clip(duration_s * _SLOW_DEG_S / max(extent_deg, 1.0), 1, most))


def stops(reach: Reach, duration_s: float, rate_Hz: float, seed: int, spread: float, held: float) -> StaticPoses:
    """Stops at random poses of all joints, every third come back to from the other side."""
    rng = np.random.default_rng(seed)
    poses: list[tuple[float, ...]] = []
    count = 3 * int(np.clip(duration_s / (3.0 * _STOP_S), 1, _POSES // 3))
    cycle = duration_s / count
    while len(poses) < count:
        poses += _approached(reach, rng, spread)
    return StaticPoses(
        poses_deg=tuple(poses),
        hold_s=held * cycle,
        move_s=(1.0 - held) * cycle,
        rate_Hz=rate_Hz,
        limits_deg=reach.checked,
    )


def _approached(reach: Reach, rng: np.random.Generator, spread: float) -> list[tuple[float, ...]]:
    """A random pose, one beside it, and the first again."""
    low, high = reach.limits_deg
    for _ in range(100):  # poses that a clear arm can hold are common
        pose = reach.home_deg + spread * rng.uniform(low - reach.home_deg, high - reach.home_deg)
        if reach.allows(StaticPoses(poses_deg=(_pose(pose),), limits_deg=None)):
            break
    beside = np.clip(pose + rng.choice([-15.0, 15.0], size=len(pose)), low, high)
    return [_pose(pose), _pose(beside), _pose(pose)]


def neighbours(reach: Reach, maneuver: TorusSweep | StaticPoses, step: float) -> Iterator[TorusSweep | StaticPoses]:
    """The maneuver with one thing a little different; ``step`` is 1 for the widest steps."""
    if isinstance(maneuver, StaticPoses):
        for factor in (1.0 - 0.4 * step, 1.0 + 0.4 * step):
            cycle = maneuver.hold_s + maneuver.move_s
            hold = min(factor * maneuver.hold_s, 0.9 * cycle)
            yield replace(maneuver, hold_s=hold, move_s=cycle - hold)
        rng = np.random.default_rng(int(100 * step))
        poses = [_pose(pose) for pose in np.degrees(maneuver.angles)]
        for first in range(0, len(poses) - 2, 3):  # one exchange at a time
            other = [*poses[:first], *_approached(reach, rng, 1.0), *poses[first + 3 :]]
            yield replace(maneuver, poses_deg=tuple(other))
        return
    for index, angle in enumerate(maneuver.locked_deg):
        for change in (-20.0 * step, 20.0 * step):
            yield from _other(maneuver, locked_deg=_with(maneuver.locked_deg, index, angle + change))
    for name in ("yaw_range_deg", "pitch_range_deg", "roll_deg_per_s"):
        for factor in (1.0 - 0.3 * step, 1.0 + 0.3 * step):
            yield from _other(maneuver, **{name: _rounded(factor * getattr(maneuver, name))})
    for name in ("yaw_centre_deg", "pitch_centre_deg"):
        for change in (-15.0 * step, 15.0 * step):
            yield from _other(maneuver, **{name: _rounded(getattr(maneuver, name) + change)})
    for name in ("yaw_passes", "pitch_passes"):
        for more in (-2, 2):
            yield from _other(maneuver, **{name: getattr(maneuver, name) + more})


def _other(sweep: TorusSweep, **fields: object) -> Iterator[TorusSweep]:
    """The sweep with these fields; nothing where there is no such sweep."""
    try:
        yield replace(sweep, **fields)  # type: ignore[arg-type]
    except RigError:
        return


def _made(**fields: object) -> TorusSweep | None:
    try:
        return TorusSweep(**fields)  # type: ignore[arg-type]
    except RigError:
        return None


def _with(values: tuple[float, ...], index: int, value: float) -> tuple[float, ...]:
    return (*values[:index], _rounded(value), *values[index + 1 :])


def _pose(degrees: Array | tuple[float, ...]) -> tuple[float, ...]:
    return tuple(_rounded(angle) for angle in degrees)


def _rounded(degrees: float) -> float:
    """To a tenth: what a person may read and change."""
    return float(np.round(degrees, 1)) + 0.0
