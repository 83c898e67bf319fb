"""Which path the nodes of a log are of: the readings tell.

When nodes were read, and how noisy they are, a path tells by how smooth it is, of an arm that nobody knows. Readings
that depend on it tell it better: of the likely paths that one is taken whose rotations and accelerations explain most
of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.fft import dct
from scipy.optimize import minimize

from rig.arrays import Array, Mask
from rig.channels import ACCELEROMETER
from rig.effects._numerics import curvature, low_passed
from rig.pose_nodes import PoseNodes

#: [s] by which readings may be late, and forget: as long as boards, buses and filters of laboratories delay.
_LATE: Final = (-0.1, 0.4)
_FORGOTTEN: Final = (0.0, 0.3)
#: Where the search for these starts.
_LATENCIES: Final = (0.0, 0.03, 0.06, 0.1, 0.2)
_LAG: Final = 0.01
#: Waves shorter than so many times two intervals may be noise of the nodes: longer in steps of a half, which change
#: what is left of a wave by four.
_SMOOTHED: Final = (1.0, 1.4, 2.0, 2.8, 4.0)
#: Readings are explained better if their log likelihood grows by more than this.
_BETTER: Final = 3.0
#: Fewer readings tell nothing of the path. The lowest octave has twice as many waves at least: of fewer, what fits
#: would leave nothing.
_FEWEST: Final = 64
#: So many samples next to each other are enough.
_MOST: Final = 8192
#: Sizes of what is left are looked at anew so many times.
_ROUNDS: Final = 4


def likely_path(nodes: PoseNodes, t: Array, readings: Mapping[str, Array], kept: Mask) -> PoseNodes:
    """The nodes with the path that explains most of the readings.

    Args:
        t: (n,) [s]. readings: sensor -> (n, 3), late by what they like, and lagging.
        kept: (n,) which of them count; where these are few, the nodes stay what they are. An axis that
            is constant, or without numbers somewhere, is left out.
    """
    readings = {name: own[:, np.ptp(own, axis=0) > 0.0] for name, own in readings.items()}
    every = np.hstack(list(readings.values()))
    if not every.size:
        return nodes
    part = _liveliest(every)
    t, kept = t[part], kept[part]
    if np.count_nonzero(kept) < _FEWEST:
        return nodes
    responses = [_Response(t, own[part][kept], kept, name == ACCELEROMETER) for name, own in readings.items()]
    found, least = nodes, _loss(responses, nodes)

    def weigh(tried: PoseNodes) -> None:
        nonlocal found, least
        missed = _loss(responses, tried)
        if missed > least - _BETTER:
            return
        least = min(least, _loss(responses, found))  # also from where the last search ended
        if missed <= least - _BETTER:
            found, least = tried, missed

    for read in nodes.likely_read_s[1:]:
        weigh(replace(nodes, read=read))
    found = replace(found, read=found.read_s)
    for smoothed in _SMOOTHED:
        weigh(replace(found, smoothed=(0.0, smoothed)))
    moves = found.smoothed[1]
    for smoothed in _SMOOTHED:
        weigh(replace(found, smoothed=(smoothed, moves)))
    return found


def _liveliest(readings: Array) -> slice:
    """Of many samples (n, k) those next to each other that change the most."""
    count = len(readings)
    if count <= _MOST:
        return slice(count)
    size = np.sum(np.diff(readings / readings.std(axis=0), axis=0) ** 2, axis=1)
    gone = np.concatenate([[0.0], np.cumsum(size)])
    first = int(np.argmax(gone[_MOST - 1 :] - gone[: 1 - _MOST]))
    return slice(first, first + _MOST)


def _loss(responses: Sequence[_Response], nodes: PoseNodes) -> float:
    return sum(response.loss(nodes) for response in responses)


@dataclass
class _Response:
    """How a sensor's readings follow a path: its axes and offsets are what fits, as are a latency and a lag.

    Attributes:
        t: (n,) [s]. readings: (m, k) of its axes. kept: (n,) where these are.
        accelerated: whether it reads accelerations.
        late: latency and lag [s] of the path that was looked at last.
    """

    t: Array
    readings: Array
    kept: Mask
    accelerated: bool
    late: Array | None = None

    def loss(self, nodes: PoseNodes) -> float:
        """Minus the log likelihood of the readings, their noise of any size in each octave of frequency."""
        rotation, position = nodes.smooth(self.t)
        columns = [np.swapaxes(rotation, 1, 2).reshape(len(self.t), 9)]
        if self.accelerated and position.size:
            columns.append(np.einsum("nji,nj->ni", rotation, curvature(self.t, position)))
        inputs = np.hstack(columns)

        def missed(late: Array) -> float:
            return self._missed(inputs, late)

        if self.late is None:
            self.late = min((np.array([late, _LAG]) for late in _LATENCIES), key=missed)
        found = minimize(
            missed,
            self.late,
            bounds=(_LATE, _FORGOTTEN),
            method="Nelder-Mead",
            options={"xatol": 2e-4, "fatol": 0.3},
        )
        self.late = found.x
        return float(found.fun)

    def _missed(self, inputs: Array, late: Array) -> float:
        latency, lag = late
        lagging = low_passed(self.t, inputs, lag) if lag > 0.0 else inputs
        at = self.t[self.kept] - latency
        follows = np.stack([np.interp(at, self.t, column) for column in lagging.T], axis=1)
        design = dct(np.hstack([follows, np.ones((len(at), 1))]), axis=0, norm="ortho")
        return sum(_misfit(design, column, self._bands) for column in self._waves.T)

    @cached_property
    def _waves(self) -> Array:
        return np.asarray(dct(self.readings, axis=0, norm="ortho"))

    @cached_property
    def _bands(self) -> list[slice]:
        """Octaves of frequency, the lowest of enough waves."""
        edges = [len(self.readings)]
        while edges[0] >= 4 * _FEWEST:
            edges.insert(0, edges[0] // 2)
        return [slice(*pair) for pair in pairwise([0, *edges])]


def _misfit(design: Array, waves: Array, bands: Sequence[slice]) -> float:
    """Minus the log likelihood of waves (m,) that follow a design (m, k), what is left of one size in each band."""
    grams = np.stack([design[band].T @ design[band] for band in bands])
    moments = np.stack([design[band].T @ waves[band] for band in bands])
    squares = np.array([waves[band] @ waves[band] for band in bands])
    counts = np.array([band.stop - band.start for band in bands], dtype=float)
    sizes = np.ones(len(bands))
    for _ in range(_ROUNDS):
        gram = np.tensordot(1.0 / sizes, grams, axes=1)
        gram[np.diag_indices(len(gram))] += 1e-9 * np.trace(gram) / len(gram)
        fitted = np.linalg.solve(gram, np.tensordot(1.0 / sizes, moments, axes=1))
        left = squares - 2.0 * moments @ fitted + np.einsum("i,bij,j->b", fitted, grams, fitted)
        sizes = np.maximum(left, 1e-12 * squares + np.finfo(float).tiny) / counts
    return float(0.5 * counts @ np.log(sizes))
