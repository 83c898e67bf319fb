"""When a sensor stands still: by the variance of its readings, and by the speed of the arm where that is known.

Camps et al., 6.2, leave out measurements of high temporal variance, in which the sensor is not static; their threshold
is 0.0016 V^2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimators._rows import working_rows
from estimators.stillness.stretches import Signals, mask_of, split_where_it_drifts, stretches_of
from estimators.stillness.threshold import choose_threshold
from estimators.stillness.variance import variance_by_half_windows, weighted_variance, windowed_variance
from rig.arm.rotation_map import moving_joints
from rig.arrays import Array, Mask, Rows
from rig.channels import ACCELEROMETER, CHANNELS_OF
from rig.errors import RefusedFit, RigError, check_name
from rig.pose_nodes import one_sign
from rig.recording import Recording

#: Camps et al., 6.2 [V^2].
CAMPS_THRESHOLD_V2: Final = 0.0016
#: A joint, or the tool, that turns faster is moving [rad/s]. In a window of a second it is 2 mrad, which moves no
#: reading by more than 0.2 % of the field; encoders toggle by some 1e-5 rad, tracking systems tremble by some 1e-4.
SPEED_LIMIT: Final = 2e-3
#: Successive stretches whose means differ by less than this many standard deviations of a reading (RMS over the
#: channels) are one pose: a knock between them is no new orientation. A stretch that drifts farther, too slowly for
#: any window to see, is more than one.
SAME_POSE: Final = 3.0
#: So are those between which the joints, or the tool, have turned by less [rad].
SAME_ANGLE: Final = 2e-3

_SHORTEST: Final = 11  # samples of a window
#: What seems to be noise is a steady motion from this share of the variance on.
TREND_LIMIT: Final = 0.5
_TREND_WINDOWS: Final = 400
_BLOCK: Final = 8192  # samples of the pose that stay in the second-level cache


@dataclass(frozen=True, eq=False)
class Stillness:
    """When the sensor stood still.

    Attributes:
        still: (n,) whether a sample belongs to a pose.
        first, stop: (s,) the stretches it stood still: samples first to stop - 1.
        pose: (s,) number of each stretch's pose, from 0 on; successive stretches in the same orientation share one.
        channels: (c,) those that were looked at. noise: (c,) their standard deviation while still [recorded unit].
        window: samples of the sliding window.
        false_alarm: probability that a window of a sensor standing still is taken for moving; None where the threshold
            was given.
        rule: how it was decided, in words.
    """

    still: Mask
    first: Rows
    stop: Rows
    pose: Rows
    channels: tuple[str, ...]
    noise: Array
    window: int
    false_alarm: float | None
    rule: str

    @property
    def poses(self) -> int:
        """How many different poses in succession."""
        return int(self.pose[-1]) + 1


def find_still(
    recording: Recording,
    *,
    window_s: float = 1.0,
    threshold: float | Mapping[str, float] | None = None,
    sensors: Sequence[str] | None = None,
    speed_limit: float = SPEED_LIMIT,
) -> Stillness:
    """Find the stretches in which the sensor stands still.

    A sample counts if the window centred on it is quiet, so half a window at either end of a pose is given up; a
    stretch that is left with less than half a window is none. With joint angles or tool poses the arm must stand still
    over the window as well.

    Args:
        recording: with or without a pose.
        window_s: length of the window [s]; it has 11 samples at least.
        threshold: the sensor moves where the variance of any channel exceeds it [recorded unit squared]: a number for
            the accelerometer (without one, for the magnetometer), such as ``CAMPS_THRESHOLD_V2``, or sensor -> number.
            None: chosen from the data, see ``estimators.stillness.threshold``.
        sensors: whose readings decide; None: all, or those with a threshold.
        speed_limit: of joints, or of the tool's rotation [rad/s].

    Raises:
        RigError: an option out of its range, an unknown sensor, or a recording shorter than the window.
        RefusedFit: it never stands still.
    """
    where = recording.origin or recording.name
    window = _window(recording, window_s, where)
    given = _given(recording, threshold, where)
    chosen = tuple(sensors) if sensors is not None else recording.sensors if given is None else tuple(given)
    columns = [column for sensor in chosen for column in recording.readings(sensor).T]
    names = tuple(name for sensor in chosen for name in CHANNELS_OF[sensor])
    half = window // 2
    joints = [] if recording.q is None else [recording.q[:, joint] for joint in moving_joints(recording.q)]
    held = _held(recording, joints, half, speed_limit)
    if held is not None and not held.any():
        raise RefusedFit(
            f"{where}: never stands still: its pose turns faster than {speed_limit:g} rad/s all the time, expected"
            " poses held without motion"
        )
    variance, means = variance_by_half_windows(columns, window)
    if given is not None:
        limits = np.repeat([given[sensor] for sensor in chosen if sensor in given], 3)
        if len(limits) != len(columns):
            raise RigError(f"{where}: threshold: found one of {', '.join(given)}, expected one of each of {chosen}")
        activity = (windowed_variance(columns, window) / limits[:, None]).max(axis=0)
        false_alarm = None
        rule = f"variance in {window} samples below {', '.join(f'{given[sensor]:g}' for sensor in chosen)}, as given"
    else:
        found = choose_threshold(variance, window)
        activity = weighted_variance(columns, window, 1.0 / (found.floor * found.limit * len(columns)))
        false_alarm = found.false_alarm
        rule = (
            f"variance in {window} samples below {found.limit:.3g} times the floor of"
            f" {', '.join(f'{floor:.3g}' for floor in np.sqrt(found.floor))} (RMS of {', '.join(names)})"
        )
    quiet = activity < 1.0
    if held is not None:
        quiet &= held
        rule += f"; speed below {speed_limit:g} rad/s"
    if quiet.any():
        _check_trend(means, quiet, variance, window, where)
    first, stop = stretches_of(quiet, max(2, half))
    if not len(first):
        raise RefusedFit(
            f"{where}: never stands still for {1.5 * window / recording.rate_Hz:.2g} s: expected poses held without"
            f" motion ({rule})"
        )
    still = mask_of(len(recording), first, stop)
    noise = np.sqrt(_while_still(variance, still, first, stop, half))
    groups = [Signals(columns, np.square(SAME_POSE * noise)), *_pose_signals(recording, joints)]
    first, stop, pose = split_where_it_drifts(groups, first, stop, window)
    return Stillness(
        still,
        first,
        stop,
        pose,
        names,
        noise,
        window,
        false_alarm,
        rule,
    )


def _window(recording: Recording, window_s: float, where: str) -> int:
    if not (np.isfinite(window_s) and window_s > 0.0):
        raise RigError(f"window_s: found {window_s}, expected a positive time")
    if len(recording) < _SHORTEST:
        raise RigError(f"{where}: found {len(recording)} samples, expected {_SHORTEST} or more to see it stand still")
    window = max(_SHORTEST, 2 * round(0.5 * window_s * recording.rate_Hz) + 1)
    if window > len(recording):
        raise RigError(f"{where}: found {len(recording)} samples, expected at least the window's {window}")
    return window


def _given(recording: Recording, threshold: float | Mapping[str, float] | None, where: str) -> dict[str, float] | None:
    if threshold is None:
        return None
    if isinstance(threshold, Mapping):
        given = dict(threshold)
    else:
        sensor = ACCELEROMETER if ACCELEROMETER in recording.sensors else recording.sensors[0]
        given = {sensor: float(threshold)}
    for sensor, value in given.items():
        check_name("recorded sensor", sensor, recording.sensors)
        if not (np.isfinite(value) and value > 0.0):
            raise RigError(f"{where}: threshold of the {sensor}: found {value}, expected a positive variance")
    return given


def _while_still(variance: Array, still: Mask, first: Rows, stop: Rows, half: int) -> Array:
    """(c,) the mean of ``variance_by_half_windows`` over the windows about still samples, one a stretch at least."""
    windows = variance.shape[1]
    chosen = still[half : half * (windows + 1) : half].copy()
    chosen[np.clip(((first + stop) // 2 - half // 2) // half, 0, windows - 1)] = True
    return np.asarray(variance[:, chosen].mean(axis=1))


def _check_trend(means: Array, quiet: Mask, variance: Array, window: int, where: str) -> None:
    """Refuse where what seems to be the noise of a sensor at rest is a steady motion.

    A signal that rises evenly by r over a window has the variance r^2 / 12, and the means of its halves differ by
    r / 2, so that their squared difference is three times the variance. Of noise without memory it is 4 / w of the
    variance; and small for any noise whose memory is short against the window.
    """
    half = window // 2
    windows = 2 * np.flatnonzero(quiet[half : len(quiet) - half : 2 * half])
    if not len(windows):
        return
    windows = windows[:: max(1, len(windows) // _TREND_WINDOWS)]
    steps = np.square(means[:, windows + 1] - means[:, windows])
    own = variance[:, windows].mean(axis=1)
    found = float(np.mean(steps.mean(axis=1)[own > 0.0] / (3.0 * own[own > 0.0]))) if own.any() else 0.0
    if found > TREND_LIMIT:
        raise RefusedFit(
            f"{where}: never stands still: in its quietest windows of {window} samples a steady motion makes"
            f" {100.0 * min(found, 1.0):.0f} % of the variance, expected noise"
        )


def _pose_signals(recording: Recording, joints: Sequence[Array]) -> list[Signals]:
    """The recorded pose: any rotation beyond ``SAME_ANGLE`` is another pose, whatever the readings say."""
    if joints:
        return [Signals(joints, np.full(len(joints), SAME_ANGLE**2 / len(joints)))]
    if recording.q is None and recording.tool_quaternion is not None:
        return [Signals(list(one_sign(recording.tool_quaternion).T), np.full(4, (0.5 * SAME_ANGLE) ** 2 / 4.0))]
    return []


def _held(recording: Recording, joints: Sequence[Array], half: int, speed_limit: float) -> Mask | None:
    """(n,) whether a sample lies in any window from whose begin to whose end the pose hardly turns.

    None where no pose was recorded.

    Args:
        recording, speed_limit: as of ``find_still``.
        joints: (n,) each, the angles of those that move [rad].
        half: half a window [samples].
    """
    if recording.q is None and recording.tool_quaternion is None:
        return None
    count, t = len(recording), recording.t
    slow = np.empty(count - 2 * half, dtype=bool)
    work = working_rows(2, min(_BLOCK, len(slow)))
    for begin in range(0, len(slow), _BLOCK):
        end = min(begin + _BLOCK, len(slow))
        before, after = slice(begin, end), slice(begin + 2 * half, end + 2 * half)
        if recording.q is not None:
            way, turned = work[:, : end - begin]
            way[:] = 0.0
            for column in joints:
                np.subtract(column[after], column[before], out=turned)
                np.maximum(way, np.abs(turned, out=turned), out=way)
        else:
            assert recording.tool_quaternion is not None
            ahead, behind = recording.tool_quaternion[after], recording.tool_quaternion[before]
            apart, opposite = np.square(ahead - behind).sum(axis=1), np.square(ahead + behind).sum(axis=1)
            way = 2.0 * np.sqrt(np.minimum(apart, opposite))  # q and -q are the same rotation
        np.less_equal(way, speed_limit * (t[after] - t[before]), out=slow[before])
    # A sample is in no such window where those that hold it, which begin up to 2 * half before it, all turn.
    first, stop = stretches_of(~slow, 1)
    first, stop = np.where(first > 0, first + 2 * half, 0), np.where(stop < len(slow), stop, count)
    turning = first < stop
    return ~mask_of(count, first[turning], stop[turning])
