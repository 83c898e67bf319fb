"""When the nodes of a logged path were read: stamps scatter, motion does not.

A pose that is stamped late lies further along the path than its stamp says, in position and in orientation alike: a
burst of acceleration and its reverse, which no arm makes. The likeliest times, weighed against how far the stamps
themselves scatter, are those of a path whose accelerations between nodes are normal, of a size that the path tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from rig.arrays import Array

#: So many nodes on either side tell when one was read.
_NEIGHBOURS: Final = 6
#: Stamps that scatter by less than this share of the interval are taken as they are.
_EVEN: Final = 0.01
#: Nodes keep at least this share of the interval apart, and move by no more than that at a time.
_APART: Final = 0.1
_STEP: Final = 0.3
#: The path is looked at anew so many times.
_ROUNDS: Final = 6
#: Logarithm of the accelerations' size, as a share of what the stamps make of them.
_SMOOTHER: Final = (-8.0, 0.5)


def read_times(t: Array, groups: Sequence[Array]) -> Array:
    """(m,) [s] rising: when nodes stamped at t (m,) were read.

    Either evenly, as a controller does, or when they were stamped, give or take: whichever makes the path likelier.

    Args:
        groups: (m, k) coordinates of the nodes, each group of one unit: its accelerations are of one size.
    """
    width = 2 * _NEIGHBOURS + 1
    if len(t) < width:
        return t
    from scipy.signal import savgol_filter  # takes a third of a second and 20 MB, which few recordings need

    interval_s = float(np.median(np.diff(t)))
    count = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, np.round(np.diff(t) / interval_s)))])
    slope = float(np.polyfit(count, t, 1)[0])
    even = slope * count + savgol_filter(t - slope * count, width, 1)
    # median absolute deviation of a normal, of what a line through so many leaves
    scatter = 1.4826 * float(np.median(np.abs(t - even))) * np.sqrt(width / (width - 1.0))
    if scatter <= _EVEN * interval_s:
        return t
    ways = [_likeliest(t, scatter, groups)]
    if np.all(np.diff(even) > 0.0):
        ways.append(_likeliest(even, scatter / np.sqrt(width), groups))
    return min(ways, key=lambda way: way[0])[1]


def _likeliest(prior: Array, sigma: float, groups: Sequence[Array]) -> tuple[float, Array]:
    """Minus the log likelihood of a path read at times (m,) known to sigma [s], and the likeliest times."""
    interval_s = float(np.median(np.diff(prior)))
    spaced = _APART * interval_s * np.arange(len(prior))
    at, found = prior, _Path(prior, prior, sigma, groups)
    sizes = found.sizes  # of the accelerations as the first times have them
    loss = np.inf
    for _ in range(_ROUNDS):
        found = _Path(at, prior, sigma, groups)
        best = minimize_scalar(lambda log, path=found: path.solved(np.exp(log) * sizes)[0], bounds=_SMOOTHER)
        loss, move = found.solved(np.exp(best.x) * sizes)
        move = np.clip(move, -_STEP * interval_s, _STEP * interval_s)
        at = np.maximum.accumulate(at + move - spaced) + spaced
        if np.abs(move).max() < _EVEN * sigma:
            break
    return loss, at


@dataclass(frozen=True)
class _Path:
    """A path, linearised in the times of its nodes.

    Attributes:
        at: (m,) [s] where. prior: (m,) [s] the times before the path is looked at; known to sigma [s].
        groups: as in ``read_times``.
    """

    at: Array
    prior: Array
    sigma: float
    groups: Sequence[Array]

    @cached_property
    def _weights(self) -> Array:
        """(3, m - 2): the second divided difference of three nodes, an acceleration."""
        first, second = np.diff(self.at)[:-1], np.diff(self.at)[1:]
        both = 0.5 * (first + second)
        return np.stack([1.0 / (first * both), -1.0 / first / both - 1.0 / second / both, 1.0 / (second * both)])

    @cached_property
    def _accelerations(self) -> list[Array]:
        """(m - 2, k) of each group."""
        return [sum(w[:, None] * g[i : len(g) - 2 + i] for i, w in enumerate(self._weights)) for g in self.groups]

    @property
    def sizes(self) -> Array:
        """Root mean square acceleration of each group."""
        return np.array([max(float(np.sqrt(np.mean(each**2))), 1e-12) for each in self._accelerations])

    @cached_property
    def _normal(self) -> list[tuple[Array, Array, float]]:
        """Of each group the bands (3, m) of B'B, B'u and u'u: u the accelerations, B what the times do to them."""
        found = []
        count = len(self.at)
        for group, own in zip(self.groups, self._accelerations, strict=True):
            velocity = CubicSpline(self.at, group, axis=0)(self.at, 1)
            bands, moment = np.zeros((3, count)), np.zeros(count)
            columns = [w[:, None] * velocity[i : count - 2 + i] for i, w in enumerate(self._weights)]
            for i in range(3):
                moment[i : count - 2 + i] += np.sum(columns[i] * own, axis=1)
                for j in range(i, 3):  # lower form: the entry (j, i) of three nodes' block
                    bands[j - i, i : count - 2 + i] += np.sum(columns[i] * columns[j], axis=1)
            found.append((bands, moment, float(np.sum(own**2))))
        return found

    def solved(self, sizes: Array) -> tuple[float, Array]:
        """Minus the log likelihood with accelerations of these sizes, and how far the times move (m,)."""
        gone = self.at - self.prior
        bands, moment = np.zeros((3, len(self.at))), -gone / self.sigma**2
        bands[0] = 1.0 / self.sigma**2
        misfit = float(gone @ gone) / self.sigma**2
        loss = len(self.at) * float(np.log(self.sigma))
        for (own, along, square), group, size in zip(self._normal, self.groups, sizes, strict=True):
            bands, moment = bands + own / size**2, moment + along / size**2
            misfit += square / size**2
            loss += group.shape[1] * float(np.sum(np.log(size / self._weights[2])))
        factor = cholesky_banded(bands, lower=True)
        move = np.asarray(cho_solve_banded((factor, True), moment))
        return loss + float(np.sum(np.log(factor[0]))) + 0.5 * (misfit - float(moment @ move)), move
