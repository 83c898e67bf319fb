"""Maneuvers made to fit an arm: which of its joints sweep, over what, and where the others are locked."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeVar, cast

import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver.fourier_sweep import FourierSweep
from rig.maneuver.locked_poses import LockedPoses
from rig.maneuver.static_poses import StaticPoses
from rig.maneuver.torus_sweep import TorusSweep

Fitted = TypeVar("Fitted")
Ranges = tuple[tuple[float, float], ...]

#: A joint sweeps over at most this share of its range and goes at at most this share of its speed.
_SHARE: Final = 0.97
#: Locked joints are tried at multiples of this [deg]; coarser where there would be too many ways.
_STEPS_DEG: Final = (45.0, 60.0, 90.0, 180.0)
_MOST_WAYS: Final = 20_000
#: A torus needs its three joints this near to right angles (product of two sines), and to tilt so far [deg].
_SQUARE: Final = 0.5
_TILT_DEG: Final = 60.0
#: A pose keeps the arm so far above the plane of its base [m], where any pose does.
_CLEAR_M: Final = 0.05
_DRAWN: Final = 2000  # random poses to choose the locked ones from


def fitted(maneuver: Fitted, arm: Arm, stated: Collection[str] = ()) -> Fitted:
    """A maneuver for an arm: as it is for the A465, else with joints, ranges and poses that suit the arm.

    Args:
        maneuver: its duration, rate and number of passes are kept.
        arm: with its limits and speeds.
        stated: fields that its author has decided; poses or joints among them are kept.

    Raises:
        RigError: the arm cannot make such a maneuver.
    """
    if arm.is_a465 or not isinstance(maneuver, TorusSweep | FourierSweep | LockedPoses | StaticPoses):
        return maneuver
    slides = arm.slide_numbers
    if {"joints", "locked_deg", "poses_deg", "centre_deg"} & set(stated):
        return replace(maneuver, slides=slides)
    if isinstance(maneuver, FourierSweep):
        raise RigError(
            f"arm {arm.name}: no fourier-sweep suits every arm, expected centre_deg, cosine_deg and sine_deg"
        )
    if isinstance(maneuver, LockedPoses):
        return replace(maneuver, slides=slides, poses_deg=locked_poses_deg(arm))
    if isinstance(maneuver, StaticPoses):
        poses = _as_shown(arm, _drawn(arm, maneuver.count, np.random.default_rng(maneuver.seed)))
        return replace(maneuver, slides=slides, poses_deg=poses, limits_deg=None)
    return cast(Fitted, torus_sweep(arm, maneuver))


def unlimited(maneuver: type[Any]) -> dict[str, Any]:
    """What a maneuver for another arm than the A465 begins with, so that the A465's limits are not held against it."""
    return {"limits_deg": None} if any(item.name == "limits_deg" for item in fields(maneuver)) else {}


def checked_limits(arm: Arm) -> Ranges | None:
    """The limits [deg] that a maneuver checks by itself: the A465's; another arm checks its own."""
    return TorusSweep.limits_deg if arm.is_a465 else None


def stops_at(arm: Arm, values: Array, hold_s: float, move_s: float, rate_Hz: float) -> StaticPoses:
    """Stops of an arm at poses (k, N) [deg, m]."""
    return StaticPoses(
        poses_deg=tuple(tuple(map(float, row)) for row in values),
        hold_s=hold_s,
        move_s=move_s,
        rate_Hz=rate_Hz,
        limits_deg=checked_limits(arm),
        slides=arm.slide_numbers,
    )


def reach(arm: Arm) -> tuple[Array, Array]:
    """Lower and upper (N,) [rad, m] that maneuvers keep to: the limits, or a turn about zero, or 0.1 m, where free."""
    free = np.where(arm.slides, 0.1, np.pi)
    low, high = np.where(np.isfinite(arm.lower), arm.lower, -free), np.where(np.isfinite(arm.upper), arm.upper, free)
    turns = ~np.array(arm.slides)
    wide = turns & (high - low > 2.0 * np.pi)
    return np.where(wide, np.maximum(low, -np.pi), low), np.where(wide, np.minimum(high, np.pi), high)


@dataclass(frozen=True)
class _Torus:
    """A way to make a torus.

    Attributes:
        joints: the columns of those that yaw, tilt and roll.
        q: (N,) [rad, m] where the others are locked.
        square: product of the sines between their axes.
        centre_deg, room_deg: of the tilting joint.
    """

    joints: tuple[int, int, int]
    q: Array
    square: float
    centre_deg: float
    room_deg: float


def torus_sweep(arm: Arm, sweep: TorusSweep) -> TorusSweep:
    """The sweep by an arm's own joints: the first that turns yaws, the last one rolls, one between them tilts.

    Of all joints between and all angles of the others, those are taken at which yaw and tilt, tilt and roll are nearest
    to right angles, clear of the plane of the base; of equals the joint nearest to the tool. The tilt is centred where
    the roll axis is at right angles to the yaw axis.

    Raises:
        RigError: no joints are near enough to right angles, with the reason and what to do instead.
    """
    torus = _best_torus(arm)
    yaw, pitch, roll = torus.joints
    q = torus.q
    low, high = (np.degrees(values) for values in reach(arm))
    ranges = {
        yaw: _down(min(sweep.yaw_range_deg, _SHARE * float(high[yaw] - low[yaw]))),
        pitch: _down(min(sweep.pitch_range_deg, _SHARE * torus.room_deg)),
        roll: _down(min(sweep.roll_range_deg, _SHARE * float(high[roll] - low[roll]))),
    }

    def centre(joint: int, wanted: float) -> float:
        return _neat(wanted, low[joint] + ranges[joint] / 2, high[joint] - ranges[joint] / 2)

    speed = np.degrees(arm.speed) * _SHARE
    rolls = not np.isfinite(arm.lower[roll]) and not np.isfinite(arm.upper[roll])
    slides = arm.slide_numbers
    locked = [joint for joint in range(arm.dof) if joint not in torus.joints]
    return replace(
        sweep,
        joints=(yaw + 1, pitch + 1, roll + 1),
        locked_deg=tuple(float(q[j]) if j + 1 in slides else _neat(np.degrees(q[j]), low[j], high[j]) for j in locked),
        yaw_range_deg=ranges[yaw],
        yaw_centre_deg=centre(yaw, 0.0),
        yaw_passes=_passes(sweep.yaw_passes, ranges[yaw], sweep, float(speed[yaw])),
        pitch_range_deg=ranges[pitch],
        pitch_centre_deg=centre(pitch, torus.centre_deg),
        pitch_passes=_passes(sweep.pitch_passes, ranges[pitch], sweep, float(speed[pitch])),
        roll=sweep.roll if rolls else "sweep",
        roll_deg_per_s=min(abs(sweep.roll_deg_per_s), float(speed[roll]) / 2.0),
        roll_range_deg=ranges[roll],
        roll_centre_deg=centre(roll, 0.0),
        limits_deg=None,
        slides=slides,
    )


def _passes(wanted: int, extent: float, sweep: TorusSweep, speed: float) -> int:
    """As many passes, or fewer where the joint [deg/s] cannot keep up."""
    able = speed * sweep.duration_s / max(extent, 1e-9)
    return wanted if not np.isfinite(able) or wanted <= able else max(1, int(able))


def _down(value: float) -> float:
    """A range [deg] in whole tenths, never wider."""
    return float(np.floor(10.0 * value + 1e-9) / 10.0)


def _neat(value: float, low: float, high: float) -> float:
    return float(np.clip(round(float(value), 1), low, high))


def _best_torus(arm: Arm) -> _Torus:
    turning = [joint for joint in range(arm.dof) if not arm.slides[joint]]
    names = [arm.joint_names[joint] for joint in turning]
    if len(turning) < 3:
        raise _no_torus(arm, f"found {len(turning)} joints that turn ({', '.join(names) or 'none'}), expected three")
    yaw, roll = turning[0], turning[-1]
    low, high = (np.degrees(values) for values in reach(arm))
    found = []
    for pitch in turning[1:-1]:
        if high[pitch] - low[pitch] < _TILT_DEG:
            continue
        q = _ways(arm, (yaw, pitch, roll))
        axes, heights = _axes(arm, q)
        square = np.linalg.norm(np.cross(axes[:, yaw], axes[:, pitch]), axis=1)
        square *= np.linalg.norm(np.cross(axes[:, pitch], axes[:, roll]), axis=1)
        centre, room = _tilt(arm, q, (yaw, pitch, roll), float(low[pitch]), float(high[pitch]))
        merit = np.round(square * np.minimum(1.0, room / 180.0), 3) + 0.3 * (heights > _CLEAR_M)
        merit += 0.01 * pitch - 1e-4 * np.abs(q).sum(axis=1)
        merit[room < _TILT_DEG] = -1.0
        at = int(np.argmax(merit))
        way = _Torus((yaw, pitch, roll), q[at], float(square[at]), float(centre[at]), float(room[at]))
        found.append((float(merit[at]), way))
    _, torus = max(found, key=lambda each: each[0], default=(0.0, None))
    if torus is None or torus.square < _SQUARE or torus.room_deg < _TILT_DEG:
        raise _no_torus(
            arm,
            f"no joint between {names[0]} and {names[-1]} tilts the one against the other, expected axes near right"
            " angles",
        )
    return torus


def _no_torus(arm: Arm, reason: str) -> RigError:
    return RigError(f"arm {arm.name}: cannot sweep a torus: {reason}; the maneuver static-poses suits any arm")


def _ways(arm: Arm, swept: tuple[int, int, int]) -> Array:
    """Poses (k, N) [rad, m] with the swept joints at zero or the middle of their ranges and the others all over."""
    low, high = reach(arm)
    middle = np.clip(0.0, low, high)
    free = [joint for joint in range(arm.dof) if joint not in swept and not arm.slides[joint]]
    for step in _STEPS_DEG:
        choices = []
        for joint in free:
            angles = np.radians(np.arange(-180.0, 180.0 + step / 2, step))
            within = angles[(angles >= low[joint]) & (angles <= high[joint])]
            choices.append(within if within.size else np.array([0.5 * (low[joint] + high[joint])]))
        if np.prod([len(each) for each in choices]) <= _MOST_WAYS:
            break
    ways = np.array(list(itertools.product(*choices)))
    q = np.tile(middle, (len(ways), 1))
    q[:, free] = ways.reshape(len(ways), len(free))
    return q


def _axes(arm: Arm, q: Array) -> tuple[Array, Array]:
    """The joints' axes (n, N, 3) in the base frame at q (n, N), and how high the lowest link or the tip is (n,) [m]."""
    chain = arm.chain
    axes, links, site = chain.evaluated(q, xaxis=chain.places, xpos=chain.links[1:], site_xpos=[0])
    height = np.minimum(links[:, :, 2].min(axis=1, initial=np.inf), site[:, 0, 2])
    return axes / np.linalg.norm(axes, axis=2, keepdims=True), height


def _tilt(arm: Arm, q: Array, joints: tuple[int, int, int], low: float, high: float) -> tuple[Array, Array]:
    """Of poses q (n, N): the tilting joint's centre (n,) [deg], where roll and yaw axes are at right angles, and how
    far it may swing there (n,) [deg] within its limits."""
    yaw, pitch, roll = joints
    cosines = []
    for angle in (0.0, np.pi / 2, np.pi):
        turned = q.copy()
        turned[:, pitch] = angle
        axes, _ = _axes(arm, turned)
        cosines.append(np.einsum("ni,ni->n", axes[:, yaw], axes[:, roll]))
    zero, quarter, half = cosines
    mean = 0.5 * (zero + half)
    angle = np.degrees(np.arctan2(-(zero - mean), quarter - mean))
    centres = angle[:, None] + np.array([-360.0, -180.0, 0.0, 180.0, 360.0])
    room = np.maximum(2.0 * np.minimum(centres - low, high - centres), 0.0)
    best = np.argmax(np.round(room, 6) - 1e-9 * np.abs(centres), axis=1)[:, None]
    return np.take_along_axis(centres, best, 1)[:, 0], np.take_along_axis(room, best, 1)[:, 0]


def _drawn(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Random poses (count, N) [rad, m] within the limits, clear of the base's plane where such can be found."""
    low, high = reach(arm)
    margin = 0.5 * (1.0 - _SHARE) * (high - low)
    pool = rng.uniform(low + margin, high - margin, (10 * count, arm.dof))
    turns = ~np.array(arm.slides)
    pool[:, turns] = np.radians(np.round(np.degrees(pool[:, turns]), 1))
    clear = _axes(arm, pool)[1] > _CLEAR_M
    return np.asarray(np.concatenate([pool[clear], pool[~clear]])[:count])


def locked_poses_deg(arm: Arm) -> tuple[tuple[float, ...], ...]:
    """Three poses [deg, m] that differ: one by one that whose gravity, in the tool, is farthest from all before.

    Up to a right angle: three directions at right angles show every sensor axis at different fields. What is equal in
    that, as on an arm that never tips its tool, is told apart by how far the tool is turned.
    """
    low, high = reach(arm)
    home = np.clip(0.0, low, high)
    pool = np.concatenate([home[None], _drawn(arm, _DRAWN, np.random.default_rng(0))])
    rotation = arm.rotation_map.rotations(pool).reshape(-1, 3, 3)
    down = -rotation[:, 2]  # R^T (0, 0, -1)
    chosen = [0]
    while len(chosen) < 3:
        apart = np.degrees(np.arccos(np.clip(np.abs(down @ down[chosen].T), 0.0, 1.0))).min(axis=1)
        trace = np.einsum("nij,mij->nm", rotation, rotation[chosen])
        turned = np.degrees(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))).min(axis=1)
        chosen.append(int(np.argmax(np.minimum(apart, 89.0) + 0.01 * turned)))
    return _as_shown(arm, pool[chosen])


def _as_shown(arm: Arm, q: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(arm.shown(joint, value)[0] for joint, value in enumerate(pose)) for pose in q.tolist())
