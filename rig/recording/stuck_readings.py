"""Values that were not read: a sensor, an encoder, or the line to it, that is stuck, and readings filled in."""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array, Rows
from rig.recording.samples import Recording

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
    sensor in a row, joints that stand still and make up for it with a jump; and readings that were filled in."""
    found = []
    for sensor in run.sensors:
        values = run.readings(sensor)
        still = np.flatnonzero(values.std(axis=0) == 0.0)
        found += [f"{sensor}: channel {channel + 1} never changes" for channel in still]
        starts, counts = _equal(values)
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
    if run.q is not None:
        found += [words for joint in range(run.q.shape[1]) if (words := _stopping(run.q, joint))]
    return found


def _equal(values: Array) -> tuple[Rows, Rows]:
    """Where runs of equal rows of (n,) or (n, k) begin, and how many each has."""
    changed = np.diff(values.reshape(len(values), -1), axis=0).any(axis=1)
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    return starts, np.diff(np.concatenate([starts, [len(values)]]))


def _repeating(values: Array, name: str) -> str:
    """Of one channel (n,): whether it repeats readings more often in a row than noise makes it.

    A converter's readings are as often the same twice as they are one step up, or one step down.
    """
    starts, counts = _equal(values)
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
    there = off <= rounding
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
    starts, counts = _equal(q[:, joint])
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
