"""When the nodes of a logged path were read: stamps scatter, motion does not.

A pose that is stamped late lies further along the path than its stamp says, in position and in orientation alike: a
burst of acceleration and its reverse, which no arm makes. The likeliest times, weighed against how far the stamps
themselves scatter, are those of a path whose accelerations between nodes are normal, of a size that the path tells.
Stamps that do not scatter may be a clock's, of poses that were read before or after its ticks: by how much the path
tells, too. Then the size is that of each stretch, as an arm speeds up and goes on: with one size for all, whatever is
more sudden would be such a scatter. That they are off is told by the accelerations, which any arm may change within an
interval; when poses were read, by how these change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize

from rig.arrays import Array

#: So many nodes on either side tell when one was read.
_NEIGHBOURS: Final = 6
#: Stamps that scatter by less than this share of the interval do not tell how well they are known.
_EVEN: Final = 0.01
#: Shares of the interval by which poses may be read off such stamps, and where the search for that starts.
_OFF: Final = (1e-3, 0.3)
_START: Final = 0.03
#: A share that is nothing.
_NONE: Final = 1.5e-3
#: Nodes keep at least this share of the interval apart, and move by no more than that at a time.
_APART: Final = 0.1
_STEP: Final = 0.3
#: The path is looked at anew so many times.
_ROUNDS: Final = 6
#: Logarithm of the changes' size, as a share of what the times at hand make of them.
_SMOOTHER: Final = (-8.0, 0.5)
#: Orders of a path's changes.
_ACCELERATION, _JERK, _SNAP = 2, 3, 4
#: Changes of so many nodes are a stretch, whose mean square is no less than this share of the path's.
_ALIKE, _LEAST = 13, 1e-3


def read_times(t: Array, groups: Sequence[Array]) -> tuple[Array, ...]:
    """Each (m,) [s] rising: when nodes stamped at t (m,) were read, the likeliest first.

    Either evenly, as a controller does, or when they were stamped, give or take: whichever makes the path likelier.
    Even stamps are known to what makes the path's accelerations likeliest, or its jerks, or how these change: the
    higher, the better they tell, of an arm that moves smoothly, how far the stamps are off; one that starts and stops
    within an interval they take for that. How likely each is does not say which of these it is.

    Args:
        groups: (m, k) coordinates of the nodes, each group of one unit: its accelerations are of one size.
    """
    width = 2 * _NEIGHBOURS + 1
    if len(t) < width:
        return (t,)
    from scipy.signal import savgol_filter  # takes a third of a second and 20 MB, which few recordings need

    interval_s = float(np.median(np.diff(t)))
    count = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, np.round(np.diff(t) / interval_s)))])
    slope = float(np.polyfit(count, t, 1)[0])
    even = slope * count + savgol_filter(t - slope * count, width, 1)
    # median absolute deviation of a normal, of what a line through so many leaves
    scatter = 1.4826 * float(np.median(np.abs(t - even))) * np.sqrt(width / (width - 1.0))
    if scatter <= _EVEN * interval_s:
        found = _likeliest(t, None, groups, _ACCELERATION)
        if found.sigma < _NONE * interval_s:
            return (t,)
        ways = [
            _likeliest(t, sigma, groups, order) for sigma, order in ((found.sigma, _JERK), (None, _JERK), (None, _SNAP))
        ]
        return tuple(way.at for way in ways)
    ways = [_likeliest(t, scatter, groups, _ACCELERATION)]
    if np.all(np.diff(even) > 0.0):
        ways.append(_likeliest(even, scatter / np.sqrt(width), groups, _ACCELERATION))
    return (min(ways, key=lambda way: way.loss).at,)


class _Times(NamedTuple):
    """Likely times of nodes.

    Attributes:
        loss: minus the log likelihood. at: (m,) [s]. sigma: [s] to which they were known before.
    """

    loss: float
    at: Array
    sigma: float


def _likeliest(prior: Array, known: float | None, groups: Sequence[Array], order: int) -> _Times:
    """The times at which a path was likely read, by what they were taken to be (m,).

    Args:
        known: [s] to which that is known; None: to what makes the path likeliest. order: of the path's changes.
    """
    interval_s = float(np.median(np.diff(prior)))
    spaced = _APART * interval_s * np.arange(len(prior))
    at, loss, sigma, logs, bounds = prior, np.inf, known or _START * interval_s, [0.0], [_SMOOTHER]
    if known is None:
        logs.append(np.log(sigma))
        bounds.append((np.log(_OFF[0] * interval_s), np.log(_OFF[1] * interval_s)))
    varied = known is None or order > _ACCELERATION
    for _ in range(_ROUNDS):
        path = _Path(at, prior, groups, order, varied)

        def solved(logs: Array, path: _Path = path) -> tuple[float, Array]:
            return path.solved(float(np.exp(logs[0])), known or float(np.exp(logs[1])))

        logs = minimize(lambda logs: solved(logs)[0], logs, bounds=bounds, method="Nelder-Mead").x
        sigma = known or float(np.exp(logs[1]))
        loss, move = solved(logs)
        move = np.clip(move, -_STEP * interval_s, _STEP * interval_s)
        at = np.maximum.accumulate(at + move - spaced) + spaced
        if np.abs(move).max() < _EVEN * sigma:
            break
    return _Times(loss, at, sigma)


@dataclass(frozen=True)
class _Path:
    """A path, linearised in the times of its nodes.

    Attributes:
        at: (m,) [s] where. prior: (m,) [s] the times before the path is looked at.
        groups: as in ``read_times``. order: of the changes that are normal.
        varied: whether these differ in size from stretch to stretch.
    """

    at: Array
    prior: Array
    groups: Sequence[Array]
    order: int
    varied: bool

    @cached_property
    def _weights(self) -> Array:
        """(order + 1, m - order): of nodes next to each other, what makes the divided difference of that order."""
        near = sliding_window_view(self.at, self.order + 1).T
        apart = near[:, None] - near[None]
        apart[np.diag_indices(self.order + 1)] = 1.0
        return np.asarray(factorial(self.order) / np.prod(apart, axis=1))

    @cached_property
    def _sums(self) -> tuple[Array, Array, float, float]:
        """The bands (order + 1, m) of B'WB, B'Wu and u'Wu: u the changes, B what the times do to them, W the inverse of
        their mean squares around each; and minus the log normalisation of the positions' density with these."""
        count = len(self.at)
        rest = count - self.order
        bands, moment, square, log_size = np.zeros((self.order + 1, count)), np.zeros(count), 0.0, 0.0
        for group in self.groups:
            own = sum(w[:, None] * group[i : rest + i] for i, w in enumerate(self._weights))
            mean = np.mean(own**2, axis=1)
            whole = max(float(mean.mean()), 1e-24)
            around = uniform_filter1d(mean, _ALIKE, mode="nearest") if self.varied else np.full(rest, whole)
            weight = 1.0 / np.maximum(around, _LEAST * whole)
            velocity = CubicSpline(self.at, group, axis=0)(self.at, 1)
            columns = [w[:, None] * velocity[i : rest + i] for i, w in enumerate(self._weights)]
            for i, column in enumerate(columns):
                moment[i : rest + i] += weight * np.sum(column * own, axis=1)
                for j, other in enumerate(columns[i:]):  # lower form: the entry (i + j, i) of a block
                    bands[j, i : rest + i] += weight * np.sum(column * other, axis=1)
            square += float(weight @ np.sum(own**2, axis=1))
            log_size -= group.shape[1] * float(np.sum(0.5 * np.log(weight) + np.log(self._weights[-1])))
        return bands, moment, square, log_size

    def solved(self, share: float, sigma: float) -> tuple[float, Array]:
        """Minus the log likelihood, and how far the times move (m,).

        Args:
            share: of the changes' sizes as they are. sigma: [s] to which the times are known.
        """
        gone = self.at - self.prior
        bands, moment, square, log_size = self._sums
        bands, moment = bands / share**2, moment / share**2 - gone / sigma**2
        bands[0] += 1.0 / sigma**2
        numbers = (len(self.at) - self.order) * sum(group.shape[1] for group in self.groups)
        loss = len(self.at) * float(np.log(sigma)) + log_size + numbers * float(np.log(share))
        misfit = float(gone @ gone) / sigma**2 + square / share**2
        factor = cholesky_banded(bands, lower=True)
        move = np.asarray(cho_solve_banded((factor, True), moment))
        return loss + float(np.sum(np.log(factor[0]))) + 0.5 * (misfit - float(moment @ move)), move
