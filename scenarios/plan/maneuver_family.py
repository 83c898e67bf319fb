"""Maneuvers that an arm could make next: sweeps of other joints, ranges, speeds and poses, and stops all over."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rig.arm import Arm
from rig.arm.clearance import Clearance, finite_limits
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver import StaticPoses, TorusSweep
from rig.maneuver.fitting import checked_limits
from rig.maneuver.moves import Dynamics
from rig.maneuver.static_poses import between

#: Samples of a recording at which contacts are looked for.
_SEEN: Final = 300
_SLACK: Final = 1.0 + 1e-6
#: A joint whose file states no speed may go so much faster than it was seen to go, or so fast [rad/s, m/s].
_FASTER: Final = 2.0
_LEAST_SPEED: Final = (0.17, 0.02)
#: A joint is swept over at most this share of its range, so that no limit is touched.
_SHARE: Final = 0.97
_SPEEDS: Final = (0.25, 0.5, 2.0, 4.0, 16.0)
#: Angles [deg] to which a locked joint is moved from where it was; one that slides goes as much of its range as that
#: is of half a turn.
_ELSEWHERE: Final = (-60.0, -30.0, 30.0, 60.0, 90.0)
_HALF_TURN: Final = 180.0
#: A sweep's passes and a maneuver's stops are so many, or fewer in a short time: so slow a joint [deg/s], so long a
#: stop with the way to it [s].
_PASSES: Final = (15, 7)
_SLOW_DEG_S: Final = 12.0
#: The fastest roll that is tried [deg/s].
_FAST_DEG_S: Final = 120.0
_POSES: Final = 30
_STOP_S: Final = 4.0
#: How far beside a stop the arm goes to come back to it [deg]; stops belong together in threes.
_BESIDE: Final = 15.0
_FEWEST_POSES: Final = 3
#: Random stops that are tried for one, and how much of the time moves may take.
_DRAWS: Final = 200
_LONGEST_MOVE: Final = 0.9


@dataclass(frozen=True, eq=False)
class Family:
    """The maneuvers of a recorded arm.

    Attributes:
        arm: with its joints' limits. clearance: what it may not touch. dynamics: how fast it may go.
        home: (N,) where its joints were, on average [deg; m of joints that slide].
        rolls: whether the last joint may roll on for ever.
    """

    arm: Arm
    clearance: Clearance
    dynamics: Dynamics
    home: Array
    rolls: bool

    @classmethod
    def of(cls, arm: Arm, t: Array, q: Array) -> Family:
        """Of an arm that was recorded at times (n,) [s] with joint values (n, N) [rad, m].

        It stands on a table at the height of its base, where it has no scene of its own. What touches in the recording
        is no collision, as the arm has done it; a speed that is not stated is twice what was seen.

        Raises:
            RigError: as ``Clearance.of``.
        """
        seen = q[:: max(1, len(q) // _SEEN)]
        fastest = np.abs(np.diff(q, axis=0) / np.diff(t)[:, None]).max(axis=0, initial=0.0)
        faster = np.maximum(_FASTER * fastest, np.where(arm.slides, _LEAST_SPEED[1], _LEAST_SPEED[0]))
        stated = replace(arm, speed=np.where(np.isfinite(arm.speed), arm.speed, faster))
        clearance = Clearance.of(arm, None if arm.is_a465 else 0.0).without(seen)
        rolls = bool(np.ptp(q[:, -1]) > 2.0 * np.pi)
        made = cls(arm, clearance, Dynamics.of(stated), np.zeros(arm.dof), rolls)
        low, high = made.limits
        home = arm.in_degrees(np.median(q, axis=0))
        home = np.where((home < low) | (home > high), 0.5 * (low + high), home)
        return replace(made, home=np.array([made.rounded(joint, value) for joint, value in enumerate(home)]))

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper (N,) [deg, m]; of a joint without any, one turn."""
        low, high = finite_limits(self.arm)
        return self.arm.in_degrees(low), self.arm.in_degrees(high)

    def allows(self, maneuver: TorusSweep | StaticPoses) -> bool:
        """Whether the arm can make a maneuver: within limits, speeds and accelerations, and clear."""
        speed, acceleration = maneuver.peaks()
        if (speed > _SLACK * self.dynamics.speed).any() or (acceleration > _SLACK * self.dynamics.acceleration).any():
            return False
        way = maneuver.way()
        try:
            self.arm.check_limits(way, "the maneuver")
        except RigError:
            return False
        return self.clear(way)

    def clear(self, q: Array) -> bool:
        """Whether the arm touches nothing at joint values (n, N) [rad, m]."""
        return self.clearance.first_contact(q) is None

    def way(self, joint: int, degrees: float) -> float:
        """How far a joint (a column) goes for so many degrees: these, or as much of a slide's range."""
        low, high = self.limits
        return degrees / _HALF_TURN * float(high[joint] - low[joint]) if self.arm.slides[joint] else degrees

    def rounded(self, joint: int, value: float) -> float:
        """A joint's value [deg, m] as a person may read and change it."""
        return float(np.round(value, 4 if self.arm.slides[joint] else 1)) + 0.0

    def pose(self, values: Array | tuple[float, ...]) -> tuple[float, ...]:
        """A rounded pose (N,) [deg, m] within the limits."""
        low, high = self.limits
        return tuple(self.rounded(joint, value) for joint, value in enumerate(np.clip(values, low, high)))


def family(room: Family, recorded: TorusSweep | StaticPoses) -> Iterator[TorusSweep | StaticPoses]:
    """Maneuvers to choose from, all of the recorded one's duration and rate: itself first; some may not be allowed."""
    yield recorded
    sweep = recorded if isinstance(recorded, TorusSweep) else None
    turning = [joint for joint in range(room.arm.dof) if not room.arm.slides[joint]]
    for joints in itertools.combinations(turning, 3):
        made = _sweep(room, joints, recorded.duration_s, recorded.rate_Hz)
        if made is None:
            continue
        sweep = sweep or made
        yield made
    if sweep is not None:
        yield from _variants(room, sweep)
    for seed, (spread, held) in enumerate(itertools.product((0.5, 1.0), (0.1, 0.5, 0.9))):
        yield stops(room, recorded.duration_s, recorded.rate_Hz, seed, spread, held)


def _sweep(room: Family, joints: tuple[int, ...], duration_s: float, rate_Hz: float) -> TorusSweep | None:
    """These joints over as much of their ranges as the clearance lets them, the rest at home."""
    low, high = room.limits
    home = room.home
    yaw, pitch, roll = joints
    last = room.arm.dof - 1
    for share in (_SHARE, 0.6, 0.3):
        widest = share * (high - low)
        centre = np.clip(home, low + 0.5 * widest, high - 0.5 * widest)
        extents = np.where(np.isin(np.arange(room.arm.dof), (0, last)), _SHARE * (high - low), widest)
        centre = np.where(np.isin(np.arange(room.arm.dof), (0, last)), 0.5 * (low + high), centre)
        made = _made(
            duration_s=duration_s,
            rate_Hz=rate_Hz,
            yaw_range_deg=_rounded(extents[yaw]),
            yaw_centre_deg=_rounded(centre[yaw]),
            yaw_passes=_passes(_PASSES[0], extents[yaw], duration_s),
            pitch_range_deg=_rounded(extents[pitch]),
            pitch_centre_deg=_rounded(centre[pitch]),
            pitch_passes=_passes(_PASSES[1], extents[pitch], duration_s),
            roll="continuous" if room.rolls and roll == last else "sweep",
            roll_range_deg=_rounded(extents[roll]),
            roll_centre_deg=_rounded(centre[roll]),
            roll_deg_per_s=_rounded(
                13.9
                if room.rolls and roll == last
                else _passes(22, extents[roll], duration_s) * extents[roll] / duration_s
            ),
            locked_deg=tuple(float(home[joint]) for joint in range(room.arm.dof) if joint not in joints),
            corner_s=min(0.5, duration_s / 60.0),
            joints=(yaw + 1, pitch + 1, roll + 1),
            limits_deg=checked_limits(room.arm),
            slides=room.arm.slide_numbers,
        )
        if made is not None and room.allows(made):
            return made
    return None


def _variants(room: Family, sweep: TorusSweep) -> Iterator[TorusSweep]:
    """The sweep with a locked joint elsewhere, at other speeds, with other ranges, and with a roll that reverses."""
    for index, angle in itertools.product(range(len(sweep.locked_deg)), _ELSEWHERE):
        yield from _other(sweep, locked_deg=_moved(room, sweep, index, angle))
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
        low, high = room.limits
        roll = sweep.joints[2] - 1
        for speed in (0.25, 1.0):
            yield from _other(
                sweep,
                roll="sweep",
                roll_range_deg=_rounded(_SHARE * (high[roll] - low[roll])),
                roll_centre_deg=_rounded(0.5 * (low[roll] + high[roll])),
                roll_deg_per_s=speed * sweep.roll_deg_per_s,
            )


def _passes(most: int, extent_deg: float, duration_s: float) -> int:
    return int(np.clip(duration_s * _SLOW_DEG_S / max(extent_deg, 1.0), 1, most))


def stops(room: Family, duration_s: float, rate_Hz: float, seed: int, spread: float, held: float) -> StaticPoses:
    """Stops at random poses of all joints, every third come back to from the other side.

    Held for this share of the time, or less where the joints need longer for the moves.
    """
    rng = np.random.default_rng(seed)
    poses: list[tuple[float, ...]] = []
    count = 3 * int(np.clip(duration_s / (3.0 * _STOP_S), 1, _POSES // 3))
    while len(poses) < count:
        poses += _approached(room, rng, spread, poses[-1:])
    while True:
        made = StaticPoses(
            poses_deg=tuple(poses), rate_Hz=rate_Hz, limits_deg=checked_limits(room.arm), slides=room.arm.slide_numbers
        )
        q = made.angles
        longest = float(np.ceil(100.0 * room.dynamics.seconds(q[:-1], q[1:]).max()) / 100.0)
        cycle = duration_s / len(poses)
        move = max((1.0 - held) * cycle, longest)
        if move < _LONGEST_MOVE * cycle or len(poses) == _FEWEST_POSES:
            return replace(
                made, move_s=min(move, _LONGEST_MOVE * cycle), hold_s=max(cycle - move, (1.0 - _LONGEST_MOVE) * cycle)
            )
        poses = poses[:-_FEWEST_POSES]


def _approached(
    room: Family,
    rng: np.random.Generator,
    spread: float,
    before: Sequence[tuple[float, ...]],
    after: Sequence[tuple[float, ...]] = (),
) -> list[tuple[float, ...]]:
    """A random pose, one beside it, and the first again, with free ways from the pose before and to the one after."""
    low, high = room.limits
    beside_by = np.array([room.way(joint, _BESIDE) for joint in range(room.arm.dof)])
    for _ in range(_DRAWS):
        drawn = room.home + spread * rng.uniform(low - room.home, high - room.home)
        pose = room.pose(drawn)
        if not room.clear(room.arm.from_degrees([pose])):
            continue
        there = [pose, room.pose(drawn + rng.choice([-1.0, 1.0], size=len(drawn)) * beside_by), pose]
        way = room.arm.from_degrees([*before, *there, *after])
        if room.clear(between(way)):
            break
    else:  # what touches is refused later on, as a whole
        there = [pose] * 3
    return there


def neighbours(room: Family, maneuver: TorusSweep | StaticPoses, step: float) -> Iterator[TorusSweep | StaticPoses]:
    """The maneuver with one thing a little different; ``step`` is 1 for the widest steps."""
    if isinstance(maneuver, StaticPoses):
        for factor in (1.0 - 0.4 * step, 1.0 + 0.4 * step):
            cycle = maneuver.hold_s + maneuver.move_s
            hold = min(factor * maneuver.hold_s, 0.9 * cycle)
            yield replace(maneuver, hold_s=hold, move_s=cycle - hold)
        rng = np.random.default_rng(int(100 * step))
        poses = [room.pose(pose) for pose in room.arm.in_degrees(maneuver.angles)]
        for first in range(0, len(poses) - 2, 3):  # one exchange at a time
            before, after = poses[:first], poses[first + 3 :]
            other = [*before, *_approached(room, rng, 1.0, before[-1:], after[:1]), *after]
            yield replace(maneuver, poses_deg=tuple(other))
        return
    for index in range(len(maneuver.locked_deg)):
        for change in (-20.0 * step, 20.0 * step):
            yield from _other(maneuver, locked_deg=_moved(room, maneuver, index, change))
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


def _moved(room: Family, sweep: TorusSweep, index: int, degrees: float) -> tuple[float, ...]:
    """The places of the locked joints with one of them elsewhere."""
    joint = [number for number in range(room.arm.dof) if number + 1 not in sweep.joints][index]
    value = room.rounded(joint, sweep.locked_deg[index] + room.way(joint, degrees))
    return (*sweep.locked_deg[:index], value, *sweep.locked_deg[index + 1 :])


def _rounded(degrees: float) -> float:
    """To a tenth: what a person may read and change."""
    return float(np.round(degrees, 1)) + 0.0
