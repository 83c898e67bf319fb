"""The maneuver, of those that a scenario can name, that comes closest to a recorded motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver import HandTumble, Maneuver, StaticPoses, TorusSweep
from rig.maneuver.fitting import checked_limits, stops_at
from scenarios.decimation import evenly

#: A joint that moves less is locked: one that turns [rad], one that slides [m].
_LOCKED: Final = (1e-2, 1e-3)
#: So many samples are enough to count passes; a long recording's encoder noise would add up to extra ones.
_LOOKED_AT: Final = 4000
#: RMS over half the range of a motion back and forth at constant speed is 1/sqrt(3) = 0.577; of a sine it is 0.707.
_CONSTANT_SPEED: Final = (0.53, 0.64)
#: The two back-and-forth joints and the rolling one.
_SWEPT: Final = 3
_WAYPOINTS: Final = 60


@dataclass(frozen=True)
class ClosestManeuver:
    """A maneuver and how it differs from the recorded one, in words."""

    maneuver: Maneuver
    difference: str


def closest_maneuver(t: Array, q: Array | None, sampling_Hz: float, arm: Arm | None) -> ClosestManeuver:
    """The closest maneuver to recorded joint angles.

    A sweep of three joints, two of them back and forth at constant speed, is a torus sweep with the recorded ranges,
    passes and speeds. Any other motion of joints becomes stops at poses along its way. Without joint angles only the
    duration is kept.

    Args:
        t: (n,) [s]. q: (n, N) [rad], or None.
        sampling_Hz: of the maneuver's own samples.
        arm: whose joints they are.
    """
    duration = float(np.round((t[-1] - t[0]) * len(t) / (len(t) - 1), 9))
    if q is None or arm is None:
        tumble = HandTumble(duration_s=duration, rate_Hz=sampling_Hz)
        return ClosestManeuver(
            tumble,
            "The recording has tool poses, which no maneuver plays back: a tumble of that duration stands for them.",
        )
    sweep = _torus_sweep(duration, q[:: max(1, len(q) // _LOOKED_AT)], sampling_Hz, arm)
    if sweep is not None:
        return ClosestManeuver(
            sweep,
            "The maneuver has the recording's ranges, passes and speeds; the phases may differ, as a torus sweep "
            "begins with yaw and pitch at their low ends.",
        )
    return ClosestManeuver(
        _waypoints(duration, q, sampling_Hz, arm),
        f"The recorded motion is no torus sweep, and no maneuver plays a recording back: the arm stops at up to "
        f"{_WAYPOINTS} poses along the recorded way instead, in the recorded time.",
    )


def _torus_sweep(duration_s: float, q: Array, rate_Hz: float, arm: Arm) -> TorusSweep | None:
    """The torus sweep with these ranges and passes; None where the motion is none."""
    limits = checked_limits(arm)
    still = {joint - 1: float(np.median(q[:, joint - 1])) for joint in arm.slide_numbers}
    degrees = np.degrees(np.unwrap(q, axis=0))
    moving = [joint for joint in range(q.shape[1]) if np.ptp(q[:, joint]) > _LOCKED[joint in still]]
    if len(moving) != _SWEPT or any(joint in still for joint in moving):
        return None
    yaw, pitch, roll = moving
    if not all(_back_and_forth(degrees[:, joint]) for joint in (yaw, pitch)):
        return None
    speed = (degrees[-1, roll] - degrees[0, roll]) / duration_s * len(q) / (len(q) - 1)
    travelled = float(np.abs(np.diff(degrees[:, roll])).sum())
    continuous = abs(degrees[-1, roll] - degrees[0, roll]) > 0.98 * travelled
    passes = {joint: passes_of(degrees[:, joint]) for joint in (yaw, pitch)}
    shape = [_within(degrees[:, joint], None if limits is None else limits[joint]) for joint in (yaw, pitch)]
    low, high = float(degrees[:, roll].min()), float(degrees[:, roll].max())
    try:
        return TorusSweep(
            duration_s=duration_s,
            rate_Hz=rate_Hz,
            yaw_range_deg=shape[0][0],
            yaw_centre_deg=shape[0][1],
            yaw_passes=passes[yaw],
            pitch_range_deg=shape[1][0],
            pitch_centre_deg=shape[1][1],
            pitch_passes=passes[pitch],
            roll="continuous" if continuous else "sweep",
            roll_deg_per_s=_rounded(speed if continuous else travelled / duration_s),
            roll_start_deg=_rounded(degrees[0, roll]) if continuous else 0.0,
            roll_range_deg=360.0 if continuous else _rounded(high - low),
            roll_centre_deg=0.0 if continuous else _rounded(0.5 * (high + low)),
            locked_deg=tuple(
                still.get(joint, _rounded(float(np.median(degrees[:, joint]))))
                for joint in range(q.shape[1])
                if joint not in moving
            ),
            corner_s=min(0.5, 0.5 * duration_s / max(passes.values())),
            joints=(yaw + 1, pitch + 1, roll + 1),
            limits_deg=limits,
            slides=arm.slide_numbers,
        )
    except RigError:  # a roll that a sweep cannot have, or a joint beyond its limit
        return None


def passes_of(degrees: Array) -> int:
    """How many passes a back-and-forth motion makes: the way it goes over its range."""
    return max(1, round(float(np.abs(np.diff(degrees)).sum() / np.ptp(degrees))))


def _back_and_forth(degrees: Array) -> bool:
    """Whether a joint goes to and fro at constant speed."""
    spread = float(np.std(degrees) / (0.5 * np.ptp(degrees)))
    return passes_of(degrees) > 1 and _CONSTANT_SPEED[0] < spread < _CONSTANT_SPEED[1]


def _within(degrees: Array, limits: tuple[float, float] | None) -> tuple[float, float]:
    """Range and centre [deg], within a joint's limits."""
    low, high = _rounded(float(degrees.min())), _rounded(float(degrees.max()))
    if limits is not None:
        low, high = max(low, limits[0]), min(high, limits[1])
    return _rounded(high - low), _rounded(0.5 * (high + low))


def _rounded(degrees: float) -> float:
    """To a thousandth of a degree: what a person may read and change."""
    return float(np.round(degrees, 3)) + 0.0


def _waypoints(duration_s: float, q: Array, rate_Hz: float, arm: Arm) -> StaticPoses:
    """Stops at poses along a way; turns beyond a limit are taken back by whole turns."""
    rows = evenly(len(q), _WAYPOINTS)
    degrees = arm.in_degrees(q[rows])
    if (limits := checked_limits(arm)) is not None:
        low, high = np.array(limits).T
        degrees = np.where((degrees < low) | (degrees > high), (degrees + 180.0) % 360.0 - 180.0, degrees)
        degrees = np.clip(degrees, low, high)
    cycle = duration_s / len(rows)
    return stops_at(arm, np.round(degrees, 3) + 0.0, 0.1 * cycle, 0.9 * cycle, rate_Hz)
