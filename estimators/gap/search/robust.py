"""What a fit is worth where the model is wrong: widths from how the misfit really scatters over time.

Where something outside the catalogue is part of an explanation, neither the floor nor a stand-in for the rest tells how
far a parameter may be off: the misfit itself does. Covariance A^-1 J A^-1, A the information and J how the score
scatters (White, Econometrica 50, 1982; of a posterior: Muller, Econometrica 81, 2013): from block to block of time,
with what neighbouring blocks share (Newey and West, Econometrica 55, 1987), and from channel to channel, which should
agree: the sum of both, which what both hold twice makes too wide, not too narrow (Davezies, D'Haultfoeuille and
Guyonvarch, Annals of Statistics 49, 2021). As J is of few blocks, widths are what 95 % need (Kiefer and Vogelsang,
Econometric Theory 21, 2005).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.weighed import Weighed
from rig.arrays import Array

#: Blocks of time: enough for a covariance to be known to a fifth. So many neighbours of each may share a misfit.
BLOCKS: Final = 16
_SHARED: Final = 3
#: What 95 % need beyond 1.96 widths, where these are of Bartlett's weights on this share of the blocks (equation and
#: table 1 of Kiefer and Vogelsang). Of six channels Student's t asks for 1.31.
_OF_BLOCKS: Final = (_SHARED + 1.0) / BLOCKS
_WIDER: Final = 1.0 + (2.9694 * _OF_BLOCKS + 0.4160 * _OF_BLOCKS**2 - 0.5324 * _OF_BLOCKS**3) / 1.9600


def moments(linear: Linear, channels: int, beside: Weighed | None = None) -> tuple[Array, Array]:
    """Posterior mean less the fitted values (p,), and covariance (p, p), in typical sizes.

    Args:
        linear: a set of effects, fitted. channels: that its samples are of, one after another.
        beside: the term of a discrepancy under which it is judged; None: under its own floor.
    """
    if not len(linear.point):
        return np.zeros(0), np.zeros((0, 0))
    gram, shrunk = linear.gram, np.zeros((0, len(linear.point)))
    if beside is not None:
        variance = float(beside.term.variances[int(np.argmax(beside.gains))])
        along = beside.term.along(linear.tangent)
        shrunk = along * (variance / (1.0 + variance * beside.term.values))[:, None]
        gram = gram - shrunk.T @ along
    parts = []
    for channel in range(channels):  # one by one: of a long recording all are large
        masked = _in_blocks(linear.left, channels, channel)
        parts.append(linear.tangent.T @ masked)
        if beside is not None:
            parts[-1] -= shrunk.T @ beside.term.along(masked)
    scores = np.concatenate(parts, axis=1)
    precision = linear.likeliest
    mean, covariance = linear.posterior(precision, gram, scores.sum(axis=1))
    both = scores.reshape(len(scores), channels, BLOCKS)
    spread = _WIDER**2 * (_spread(both.sum(axis=1)) + _clusters(both.sum(axis=2)))
    values, vectors = np.linalg.eigh(spread / np.sqrt(np.outer(size := np.diag(gram) + precision, size)))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) * np.sqrt(size)[:, None]
    return mean, covariance @ (root @ root.T + np.diag(precision)) @ covariance


def _in_blocks(values: Array, channels: int, channel: int) -> Array:
    """(m, b): the values (m,) of a channel in each block of time, zero elsewhere."""
    count = len(values) // channels
    rows = np.arange(count)
    found = np.zeros((len(values), BLOCKS))
    found[channel * count + rows, rows * BLOCKS // count] = values[channel * count + rows]
    return found


def _spread(scores: Array) -> Array:
    """(p, p) covariance of a sum of contributions (p, b) of which neighbours may share something."""
    off = (scores - scores.mean(axis=1, keepdims=True)) * np.sqrt(BLOCKS / (BLOCKS - 1.0))
    found = off @ off.T
    for lag in range(1, _SHARED + 1):
        shared = off[:, lag:] @ off[:, :-lag].T
        found += (1.0 - lag / (_SHARED + 1.0)) * (shared + shared.T)
    return np.asarray(found)


def _clusters(scores: Array) -> Array:
    """(p, p) covariance of a sum of independent contributions (p, c)."""
    many = scores.shape[1]
    off = scores - scores.mean(axis=1, keepdims=True)
    return np.asarray(off @ off.T * (many / (many - 1.0)))
