"""A hidden Markov chain of two states (Rabiner, Proceedings of the IEEE 77, 1989): of what switches between two levels,
again and again, at instants that single readings do not tell."""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array

#: Log odds of two readings beyond which they are certain.
_CERTAIN: Final = 500.0


def forward(log_odds: Array, share: Array, rate: Array) -> tuple[Array, Array]:
    """Log likelihoods (k,) against the lower level throughout, and (n, k) the probability of the upper one given all
    samples so far.

    Args:
        log_odds: (n, k) of each sample at the upper level, against the lower. share: (k,) of the time at the upper one.
        rate: (k,) switches a sample.
    """
    leaves, comes = 2.0 * rate * (1.0 - share), 2.0 * rate * share
    stays = 1.0 - leaves - comes
    odds = np.exp(np.clip(log_odds, -_CERTAIN, _CERTAIN))
    found, filtered = np.empty_like(odds), share
    summed = np.empty_like(odds)
    for index, ratio in enumerate(odds):
        likely = filtered * ratio
        total = likely + 1.0 - filtered
        summed[index] = total
        found[index] = likely / total
        filtered = comes + stays * found[index]
    return np.log(summed).sum(axis=0), found


def smoothed(filtered: Array, share: float, rate: float) -> Array:
    """(n,) the probability of the upper level given all samples, from that given those so far (n,)."""
    leaves, comes = 2.0 * rate * (1.0 - share), 2.0 * rate * share
    ahead = comes + (1.0 - leaves - comes) * filtered
    found = np.empty_like(filtered)
    found[-1] = filtered[-1]
    for index in range(len(found) - 2, -1, -1):
        own, later = filtered[index], found[index + 1]
        stayed = later * (1.0 - leaves) / max(ahead[index], 1e-300)
        went = (1.0 - later) * leaves / max(1.0 - ahead[index], 1e-300)
        found[index] = own * (stayed + went)
    return found
