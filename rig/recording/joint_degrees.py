"""Whether joint angles are degrees under the name of radians, which the readings that follow them tell."""

from __future__ import annotations

from itertools import combinations, product
from math import comb
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.recording.samples import Recording
from rig.recording.thinning import thinned

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
    readings = np.concatenate([some.readings(sensor) for sensor in some.sensors], axis=1)
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
