"""Poses at rest without what single readings have beside their noise: readings at a limit, and spikes.

The effects that make these are asked for them, as they are in any recording.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import ndtri

from estimators.gap.floor.censored import uncut
from estimators.noise.procedure import SHORTEST_POSE
from rig.arrays import Array, Mask, Rows
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Finding, Readings

#: The largest of the steps from reading to reading, so many, tell nothing of the spread by which spikes are judged, as
#: these may have made them. Of normal steps that quantile is six tenths as efficient as the mean square; the floor's
#: own variance is not taken from it.
_LARGEST: Final = 0.2
#: A spike's place is taken by one of so many readings on either side.
_NEARBY: Final = 25
#: A channel has so many limits.
_LIMITS: Final = 2


def sound(values: Array, labels: Rows, step: float, spiky: bool = True) -> tuple[list[Array], float]:
    """The segments (n,) of a channel at rest, one a pose, and the share that they tell of what so many readings do.

    Poses with readings at a limit of the channel are left out where any other is long enough to be one; where none is,
    what lies beyond the limit is filled up (``estimators.gap.floor.censored``). A spike's place is taken by a reading
    nearby, drawn at random: so the variance stays, and what is slow.

    Args:
        values: (n,) [recorded unit]. labels: (n,) number of the pose, -1 where the arm moves.
        step: of the converter [recorded unit], zero for none.
        spiky: whether spikes are looked for.
    """
    held = labels >= 0
    own, poses = values[held], labels[held]
    cut = _at_a_limit(own, poses)
    rows = [poses == pose for pose in np.unique(poses)]
    free = [at for at in rows if not cut[at].any()]
    clean = not cut.any() or any(np.count_nonzero(at) >= SHORTEST_POSE for at in free)
    judged = np.any(free, axis=0) if clean else ~cut
    if spiky:
        own = own.copy()
        own[judged] = _without_spikes(own[judged], poses[judged])
    if clean:
        return [own[at] for at in free], 1.0
    return uncut([own[at] for at in rows], [cut[at] for at in rows], step)


def _at_a_limit(own: Array, poses: Rows) -> Mask:
    """(n,) the readings at a limit of the channel."""
    cut, left = np.zeros(len(own), dtype=bool), np.flatnonzero(np.isfinite(own))
    for _ in range(_LIMITS):
        found = _examined("saturation", own[left], poses[left])
        if found is None:
            break
        (level,) = found.effect.strengths
        cut[left] |= np.abs(own[left] - level) <= 1e-9 * max(1.0, abs(level))
        left = left[~found.affected[:, 0]]
    return cut


def _without_spikes(own: Array, poses: Rows) -> Array:
    """Readings (n,) with others of their pose in the places of spikes."""
    found = _examined("outliers", own, poses)
    if found is None:
        return own
    spikes = found.affected[:, 0]
    rng, filled = np.random.default_rng(0), own.copy()
    for place in np.flatnonzero(spikes):
        near = slice(max(place - _NEARBY, 0), place + _NEARBY + 1)
        others = own[near][~spikes[near] & (poses[near] == poses[place])]
        if len(others):
            filled[place] = rng.choice(others)
    return filled


def _examined(name: str, own: Array, poses: Rows) -> Finding | None:
    """What an effect shows in one channel, as if it were the first: beside the mean of each pose, in deviations as
    neighbouring readings tell them."""
    expected = (np.bincount(poses, own) / np.maximum(np.bincount(poses), 1))[poses]
    left = own - expected
    steps = np.quantile(np.abs(np.diff(left)), 1.0 - _LARGEST) if len(left) > 1 else 0.0
    sigma = float(steps / np.sqrt(2.0)) / float(-ndtri(0.5 * _LARGEST)) or float(left.std())
    if not sigma > 0.0:
        return None
    rest = Readings(
        own[:, None],
        expected[:, None],
        np.array([sigma]),
        left[:, None] / sigma,
        np.zeros((len(own), 1), dtype=bool),
        np.zeros(1),
    )
    effect = EFFECTS[name]
    return effect.examined(rest, CHANNELS[0] if CHANNELS[0] in effect.places else effect.places[0])
