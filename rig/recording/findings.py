"""What looks wrong in a recording, or is left open by it, in words: its times, units, joint angles, stuck values."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations, product
from math import comb
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.recording.recording_files import RecordingScan
from rig.recording.repeated_poses import equal_rows, repeated
from rig.recording.samples import Recording
from rig.recording.thinning import thinned
from rig.units import STANDARD_GRAVITY

#: Median steps from which on a step is a gap.
_GAP: Final = 10.0


def gap_words(t: Array) -> list[str]:
    """The longest gap between the times (n,) [s] of a recording, in words; empty where there is none."""
    steps = np.diff(t)
    if not len(steps) or steps.max() <= _GAP * np.median(steps):
        return []
    row = int(np.argmax(steps))
    return [f"a gap of {steps[row]:.4g} s after row {row}; the median step is {np.median(steps):.4g} s"]


#: Of gravity, and of the Earth's field: what the median magnitude lies between, in the units that say so.
_SIZES: Final = {
    **{"g": (0.5, 2.0), "m_s2": (0.5 * STANDARD_GRAVITY, 2.0 * STANDARD_GRAVITY)},
    **{"G": (0.1, 1.2), "uT": (10.0, 120.0), "nT": (1e4, 1.2e5)},
}


def unit_words(run: Recording) -> list[str]:
    """Sensors that read too much or too little for their unit, a line each."""
    found = []
    for sensor, unit in run.units.items():
        size = float(np.median(np.linalg.norm(run.readings(sensor), axis=1)))
        low, high = _SIZES.get(unit, (-np.inf, np.inf))
        if not low < size < high:
            expected = f"{low:.3g} to {high:.3g}"
            found.append(f"{sensor}: the median magnitude is {size:.3g} {unit}, expected {expected}: its unit?")
    return found


def unstated_words(run: Recording | RecordingScan, stated: Collection[str]) -> dict[str, str]:
    """Sensor -> what is taken for the size of the field that it feels, where nobody has stated that, and what follows.

    Args:
        stated: keys of the metadata.
    """
    own = run.metadata
    taken = {
        ACCELEROMETER: ("gravity_m_s2", f"gravity is not stated: {own.gravity_m_s2:g} m/s^2 taken (--gravity)"),
        MAGNETOMETER: ("magnetic_field", f"the magnetic field is not stated: {own.magnetic_field:g} taken (--field)"),
    }
    return {
        sensor: f"{words}: every 1 % in it is 1 % in every sensitivity, the other way"
        for sensor, (key, words) in taken.items()
        if sensor in run.sensors and key not in stated
    }


#: Equal readings of all three axes in a row, more than which noise, at rest or not, does not make.
_REPEATS: Final = 10
#: The chance that noise makes as many equal readings of one axis in a row; a repeat is never taken to be rarer than
#: that; and the share of all that may be such before they are the converter's, or each is written several times.
_CHANCE, _RAREST, _EVERY = 1e-4, 1e-2, 0.5
#: Repeats more often than so are of a converter so coarse that they depend on where on its step a reading lies.
_COARSE: Final = 0.2
#: A reading is on the line between its neighbours where it is off by so many of single precision's rounding errors; not
#: told where readings are ordinarily off by less than so many times that. Rows at least.
_ROUNDED, _SURE, _FILLED = 4, 100.0, 5
#: All axes at once so many times as often as by chance, or so often as one axis is: of a coarse converter each may be.
_BEYOND, _TOGETHER = 20.0, 0.8
#: Rows for which a joint that moves stands still, and how many of its ordinary steps it makes up for then, at least.
_STOPPED: Final = 5


def stuck_words(run: Recording) -> list[str]:
    """What seems stuck, a line each: channels that never change or repeat single readings, many equal readings of a
    sensor in a row, joints that stand still and make up for it with a jump, poses that are repeated; and readings that
    were filled in."""
    found = []
    for sensor in run.sensors:
        values = run.readings(sensor)
        still = np.flatnonzero(values.std(axis=0) == 0.0)
        found += [f"{sensor}: channel {channel + 1} never changes" for channel in still]
        starts, counts = equal_rows(values)
        longest = int(np.argmax(counts))
        if counts[longest] > _REPEATS and not len(still):
            row = starts[longest]
            found.append(
                f"{sensor}: {counts[longest]} readings in a row are the same, from row {row} on (first row 0): stuck?"
            )
        elif not len(still):
            found += [f"{sensor}: {words}" for k in range(3) if (words := _repeating(values[:, k], f"channel {k + 1}"))]
        if words := _filled_in(run.t, values):
            found.append(f"{sensor}: {words}")
    if words := _held(run):
        found.append(words)
    elif run.q is not None:
        found += [words for joint in range(run.q.shape[1]) if (words := _stopping(run.q, joint))]
    return found


def _held(run: Recording) -> str:
    """Whether the poses are those of a slower log, each repeated until the next one came."""
    if (found := repeated(run)) is None:
        return ""
    return (
        f"{found.words}: a slower log's, held until the next came? rig calibrate, live and diagnose put straight lines"
        " between them; the pose log as a file of its own, given to rig import, has its times as well"
    )


def _repeating(values: Array, name: str) -> str:
    """Of one channel (n,): whether it repeats readings more often in a row than noise makes it.

    A converter's readings are as often the same twice as they are one step up, or one step down.
    """
    starts, counts = equal_rows(values)
    steps = np.abs(np.diff(values))
    if not steps.any():
        return ""
    # at most twice as often, where a slow signal lies well for it
    repeat = float(np.mean((steps > 0.0) & (steps < 1.5 * steps[steps > 0.0].min())))
    if repeat > _COARSE or np.mean(steps == 0.0) > _EVERY:
        return ""
    needed = 1.0 + np.log(_CHANCE / len(values)) / np.log(np.clip(repeat, _RAREST, 0.99))
    at_an_end = (values == values.min()) | (values == values.max())  # clipped
    held = (counts > needed) & ~at_an_end[starts]
    if not held.any():
        return ""
    share = float(counts[held].sum()) / len(values)
    return (
        f"{name} repeats a reading {counts[held].min()} times and more in a row, in {100.0 * share:.2g} % of the rows,"
        f" first from row {starts[held][0]} on (first row 0): stuck now and then?"
    )


def _filled_in(t: Array, values: Array) -> str:
    """Whether readings (n, 3) at times (n,) lie on the straight line between their neighbours, all axes at once: noise
    never does."""
    if len(t) < 3 or not np.all(np.diff(t) > 0.0):
        return ""
    before, after = np.diff(t)[:-1, None], np.diff(t)[1:, None]
    off = np.abs(values[1:-1] - (values[:-2] * after + values[2:] * before) / (before + after))
    rounding = _ROUNDED * float(np.finfo(np.float32).eps) * np.abs(values).max(axis=0)
    if np.any(np.quantile(off, 0.9, axis=0) < _SURE * rounding):  # as many may be filled in
        return ""
    stuck = np.all((values[1:-1] == values[:-2]) & (values[2:] == values[:-2]), axis=1)
    there = (off <= rounding) & ~stuck[:, None]
    rows = np.flatnonzero(there.all(axis=1)) + 1
    chance = float(np.prod(there.mean(axis=0))) * len(there)  # of a converter's steps
    if len(rows) < _FILLED or (len(rows) < _BEYOND * chance and len(rows) < _TOGETHER * there.sum(axis=0).max()):
        return ""
    share = 100.0 * len(rows) / len(t)
    return (
        f"{len(rows)} readings ({share:.2g} %) lie on the straight line between their neighbours, first at row"
        f" {rows[0]} (first row 0): lost and filled in? They are no readings, and make noise look coloured"
    )


def _stopping(q: Array, joint: int) -> str:
    """Of one joint of (n, N): whether it stands still while others move, and then is where it would have been."""
    starts, counts = equal_rows(q[:, joint])
    steps = np.abs(np.diff(q[:, joint]))
    if not steps.any():
        return ""
    ordinary = float(np.median(steps[steps > 0.0]))
    others = np.any(np.diff(np.delete(q, joint, axis=1), axis=0) != 0.0, axis=1).astype(bool)
    for start, count in zip(starts[counts >= _STOPPED], counts[counts >= _STOPPED], strict=True):
        last = start + count - 1  # the row before the jump
        if start == 0 or last >= len(steps) or not np.all(others[start:last]):
            continue
        jump = float(steps[last])
        if jump > max(0.5 * count, float(_STOPPED)) * ordinary and steps[start - 1] > 0.2 * ordinary:
            return (
                f"joint{joint + 1} stands still for {count} rows, from row {start} on (first row 0), and then jumps by"
                f" {jump:.3g} rad: a log that is stuck now and then?"
            )
    return ""


#: What readings leave over has to be so many times smaller by degrees: the terms are the same, so that by chance, or by
#: whatever else is in the readings, it is about as large by either.
_TIMES: Final = 2.0
#: The samples that are looked at.
_SAMPLES: Final = 4_000
#: Fewer would follow anything.
_SAMPLES_A_TERM: Final = 4
#: What least squares leave over of a channel by rounding alone, as a share of it.
_ROUNDING: Final = 1e-6


def degrees_words(run: Recording) -> str:
    """The finding that joint angles are degrees, or nothing.

    On any arm of revolute joints a reading at rest is a sum of products of the joints' sines and cosines: of one joint,
    of two, and so on, as many as there are samples for. These are fitted to the readings, by the angles as radians and
    as degrees. Neither the arm nor how far or how fast it goes has to be known. Where readings do not follow the
    joints, or few poses are held, both fit alike.

    Args:
        run: a recording; without joint angles there is nothing to find.
    """
    if run.q is None:
        return ""
    some = thinned(run, _SAMPLES)
    assert some.q is not None
    turning = np.array([joint not in run.slides for joint in range(1, some.q.shape[1] + 1)])
    moving = some.q[:, turning & (np.ptp(some.q, axis=0) > 0.0)]
    readings = some.every_reading
    spread = np.ptp(readings, axis=0)
    readings = (readings - readings[0])[:, spread > 0.0] / spread[spread > 0.0]
    if not moving.size or not readings.size:
        return ""
    left = [_left_over(some.t, angles, readings) for angles in (moving, np.radians(moving))]
    if left[0] is None or left[1] is None or left[0] < _TIMES * left[1]:
        return ""
    times = f"{left[0] / left[1]:.3g} times"
    return f"the readings follow the joints {times} as closely if their angles are degrees: under the name of radians?"


def _left_over(t: Array, angles: Array, readings: Array) -> float | None:
    """Root mean square of what the angles (n, j) [rad] leave over of readings (n, c), as a share of these; None where
    there are too few samples to tell.

    A drift is taken out as well: of a joint that goes on turning, slow sines would stand for it.
    """
    time = (t - t.mean()) / max(float(np.ptp(t)), np.finfo(float).tiny)
    terms = [np.ones_like(time), time, time**2]
    single = [(np.cos(angle), np.sin(angle)) for angle in angles.T]
    for joints in range(1, len(single) + 1):
        if _SAMPLES_A_TERM * (len(terms) + comb(len(single), joints) * 2**joints) > len(t):
            break
        terms += [np.prod(parts, axis=0) for some in combinations(single, joints) for parts in product(*some)]
    if len(terms) <= 3:
        return None
    columns = np.stack(terms, axis=1)
    coefficients, _, rank, _ = np.linalg.lstsq(columns, readings, rcond=None)
    rest = np.square(readings - columns @ coefficients).sum(axis=0) / (len(t) - rank)
    return max(float(np.sqrt(np.mean(rest / readings.var(axis=0)))), _ROUNDING)
