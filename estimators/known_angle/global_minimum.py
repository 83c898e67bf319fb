"""The global minimum of the known-angle cost, from any data and without an initial guess.

For a fixed field direction f the model is linear in m_k = S_k |f| P_k and delta_k, with the same 3 x 3 normal matrix
A(f) for every channel once delta_k is eliminated by centring: variable projection (Golub and Pereyra, 1973). What is
left is a function of a direction only, on a half sphere, as (f, P_k) and (-f, -P_k) give the same readings. It is
evaluated on a grid all at once; SciPy's Levenberg-Marquardt (MINPACK) refines every local minimum of the grid, and the
best is taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq
from scipy.spatial import cKDTree

from estimators._small import eigh, least_squares
from estimators.known_angle.statistics import Statistics
from rig.directions import tangent_basis

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Directions on the half sphere, 7 degrees apart: on well-conditioned poses the projected cost has no detail below some
#: tens of degrees. On others it can have narrow basins, which a grid four times as fine finds.
GRID_POINTS = 400
FINE_GRID_POINTS = 6400
#: Condition of the rotations' covariance from which the fine grid is used; that of a sweep is about 4.
FINE_GRID_CONDITION = 1e3
#: Local minima of a grid that are refined at most; a fine grid on few orientations has about ten.
MOST_STARTS = 24
#: Eigenvalues of the rotations' covariance below this share of the largest are rounding: sums of entries of order one
#: are good to some 1e-15 of n.
RANK_TOLERANCE = 1e-13
#: Of residuals, over the standard deviation of the readings: they are differences of such.
_ROUNDING = 8.0 * np.finfo(float).eps


@dataclass(frozen=True)
class Compressed:
    """The centred least-squares problem of c channels in r <= 9 equations each, per sample.

    The mean square residual of channel k is ``floor[k] + |rows @ vec(f m_k^T) - target[:, k]|^2``.

    Attributes:
        rows: (r, 9). target: (r, c) [recorded unit].
        covariance: (9, 9) of vec R. cross: (9, c) covariance with the readings.
        variance: (c,) of the readings. floor: (c,) what no linear function of vec R explains; never below zero.
        condition: of the covariance of vec R, infinite where r < 9.
        mean_rotation: (9,). mean: (c,) of the readings.
        mean_square: (c,) of the readings, to which the rounding of ``floor`` is relative.
    """

    rows: Array
    target: Array
    covariance: Array
    cross: Array
    variance: Array
    floor: Array
    condition: float
    mean_rotation: Array
    mean: Array
    mean_square: Array

    @classmethod
    def of(cls, statistics: Statistics) -> Compressed:
        """Centre and compress."""
        n = statistics.count
        mean_rotation, mean = statistics.gram[:9, 9] / n, statistics.cross[9] / n
        covariance = statistics.gram[:9, :9] / n - np.outer(mean_rotation, mean_rotation)
        cross = statistics.cross[:9] / n - np.outer(mean_rotation, mean)
        mean_square = statistics.square.diagonal() / n
        variance = np.maximum(mean_square - mean * mean, 0.0)
        values, vectors = eigh(covariance)
        kept = values > RANK_TOLERANCE * max(values[-1], 1.0)
        root = np.sqrt(values[kept])
        vectors = vectors[:, kept]
        target = (vectors.T @ cross) / root[:, None]
        floor = np.maximum(variance - (target * target).sum(axis=0), 0.0)
        rows = root[:, None] * vectors.T
        condition = float(values[-1] / values[0]) if kept.all() else np.inf
        return cls(rows, target, covariance, cross, variance, floor, condition, mean_rotation, mean, mean_square)

    @property
    def grid_points(self) -> int:
        """How fine a grid of directions its cost asks for."""
        return GRID_POINTS if self.condition < FINE_GRID_CONDITION else FINE_GRID_POINTS

    @property
    def rank(self) -> int:
        """The number of dimensions that the orientations span."""
        return len(self.rows)

    def channel(self, k: int) -> Compressed:
        """One channel of it."""
        one = slice(k, k + 1)
        return Compressed(
            self.rows,
            self.target[:, one],
            self.covariance,
            self.cross[:, one],
            self.variance[one],
            self.floor[one],
            self.condition,
            self.mean_rotation,
            self.mean[one],
            self.mean_square[one],
        )


@dataclass(frozen=True)
class Solution:
    """A local minimum: the field's direction (3,), scaled axes m_k (c, 3), and the mean square residuals (c,)."""

    field: Array
    scaled_axes: Array
    mean_square: Array

    def offset(self, problem: Compressed) -> Array:
        """delta_k (c,) that belong to it [recorded unit]."""
        mean = problem.mean_rotation.reshape(3, 3)
        return problem.mean - self.scaled_axes @ (self.field @ mean)


@cache
def half_sphere(points: int) -> tuple[Array, Indices, Array]:
    """Directions (g, 3) spread evenly over a half sphere, the neighbours (g, 8) of each, and products f_i f_j (g, 9).

    A Fibonacci lattice; a direction at the rim has neighbours across it, as f and -f are the same here.
    """
    index = np.arange(points) + 0.5
    z = 1.0 - index / points
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)
    tree = cKDTree(np.vstack([directions, -directions]))
    neighbours = tree.query(directions, k=9)[1][:, 1:] % points
    products = (directions[:, :, None] * directions[:, None, :]).reshape(-1, 9)
    return directions, neighbours, products


def explained(problem: Compressed) -> Array:
    """Mean square (g, c) of each channel's readings that the best m_k explains, for every field direction of the
    grid."""
    directions, _, products = half_sphere(problem.grid_points)
    normal = products @ problem.covariance.reshape(3, 3, 3, 3).transpose(0, 2, 1, 3).reshape(9, 9)
    channels = problem.cross.shape[1]
    right = (directions @ problem.cross.reshape(3, 3 * channels)).reshape(-1, 3, channels)
    # A tiny ridge: where A(f) is singular the directions it cannot see explain nothing.
    factor = cholesky(np.ascontiguousarray(normal.T), 1e-12 * float(np.trace(problem.covariance)) + 1e-300)
    z1, z2, z3 = forward(tuple(entry[:, None] for entry in factor), right.swapaxes(0, 1))
    return np.asarray(z1 * z1 + z2 * z2 + z3 * z3)


def cholesky(normal: Array, ridge: float | Array) -> tuple[Array, ...]:
    """Factors of symmetric (3, 3) matrices given as (9, ..): 11, 21, 31, 22, 32, 33."""
    a11, a21, a31, a22, a32, a33 = (normal[i] for i in (0, 3, 6, 4, 7, 8))
    l11 = np.sqrt(np.maximum(a11, 0.0) + ridge)
    l21, l31 = a21 / l11, a31 / l11
    l22 = np.sqrt(np.maximum(a22 - l21 * l21, 0.0) + ridge)
    l32 = (a32 - l31 * l21) / l22
    l33 = np.sqrt(np.maximum(a33 - l31 * l31 - l32 * l32, 0.0) + ridge)
    return l11, l21, l31, l22, l32, l33


def forward(factor: tuple[Array, ...], right: Array) -> tuple[Array, Array, Array]:
    """L z = right, for right (3, ..)."""
    l11, l21, l31, l22, l32, l33 = factor
    z1 = right[0] / l11
    z2 = (right[1] - l21 * z1) / l22
    return z1, z2, (right[2] - l31 * z1 - l32 * z2) / l33


def local_minima(problem: Compressed, explained_on_grid: Array, weights: Array) -> list[Solution]:
    """Every local minimum of the weighted cost, best first; those the refinement finds to be the same are given once.

    Args:
        problem: of c channels that share one field direction.
        explained_on_grid: (g, c) ``explained``.
        weights: (c,) of the channels.
    """
    directions, neighbours, _ = half_sphere(problem.grid_points)
    value = explained_on_grid @ weights
    starts = np.flatnonzero(value >= value[neighbours].max(axis=1))
    found: list[tuple[float, Solution]] = []
    for start in starts[np.argsort(-value[starts])][:MOST_STARTS]:
        solution = refine(problem, directions[start], weights)
        if all(abs(float(solution.field @ other.field)) < 1.0 - 1e-10 for _, other in found):
            found.append((float(solution.mean_square @ weights), solution))
    found.sort(key=lambda pair: pair[0])
    return [solution for _, solution in found]


def refine(problem: Compressed, field: Array, weights: Array) -> Solution:
    """The local minimum of the weighted cost next to a field direction (3,), by Levenberg-Marquardt.

    The channels' m_k start at their linear optimum.
    """
    descent = _Descent(problem, field, weights)
    start = np.concatenate([np.zeros(2), descent.axes(field).ravel()])
    if problem.target.size < len(start):
        return descent.solution(start)
    # full_output keeps MINPACK from warning that it has reached the last digit, which is what is asked of it.
    found = leastsq(
        descent.residual, start, Dfun=descent.derivative, full_output=True, ftol=1e-15, xtol=1e-13, maxfev=200
    )[0]
    # It stops where the cost no longer changes, some 1e-6 of a standard deviation from the minimum; one step of
    # Gauss-Newton takes that to rounding, so that the answer does not depend on where the descent began.
    improved = descent.step(found)
    return descent.solution(found if improved is None else improved)


def reweighted(problem: Compressed, solution: Solution, weights: Array) -> Solution:
    """A solution moved to the minimum of a cost whose weights have changed a little, by one step of Gauss-Newton."""
    descent = _Descent(problem, solution.field, weights)
    moved = descent.step(np.concatenate([np.zeros(2), solution.scaled_axes.T.ravel()]))
    return refine(problem, solution.field, weights) if moved is None else descent.solution(moved)


class _Descent:
    """The weighted residuals of a problem as a function of x: two tangent coordinates about a direction, then m_k."""

    def __init__(self, problem: Compressed, field: Array, weights: Array) -> None:
        self._problem = problem
        self._field = field
        self._basis = tangent_basis(field)
        self._root = np.sqrt(weights / weights.max())
        r, c = self._shape = problem.target.shape
        # f @ this, as (r, 3), are the rows that belong to m.
        self._by_field = np.ascontiguousarray(problem.rows.reshape(r, 3, 3).swapaxes(0, 1).reshape(3, 3 * r))
        self._jacobian = np.zeros((r, c, 2 + 3 * c))
        self._by_axes = np.einsum("rkik->rik", self._jacobian[:, :, 2:].reshape(r, c, 3, c))  # a view: m_k by its own k
        self._at = (math.nan, math.nan)
        self._direction = (field, 1.0, problem.rows)

    def residual(self, x: Array) -> Array:
        """(r c,)."""
        _, _, for_axes = self._towards(x)
        error = for_axes @ x[2:].reshape(3, -1)
        error -= self._problem.target
        error *= self._root
        return np.asarray(error.ravel())

    def derivative(self, x: Array) -> Array:
        """(r c, 2 + 3 c); overwritten by the next call."""
        r, c = self._shape
        f, length, for_axes = self._towards(x)
        turned = (self._basis - (self._basis @ f)[:, None] * f) / length
        by_tangent = (turned @ self._by_field).reshape(2, r, 3) @ x[2:].reshape(3, c)
        np.multiply(by_tangent.transpose(1, 2, 0), self._root[:, None], out=self._jacobian[:, :, :2])
        np.multiply(for_axes[:, :, None], self._root, out=self._by_axes)
        return self._jacobian.reshape(r * c, -1)

    def step(self, x: Array) -> Array | None:
        """One step of Gauss-Newton; None where it would make the cost larger, beyond what rounding does."""
        error = self.residual(x)
        moved = x - least_squares(self.derivative(x), error)
        after = self.residual(moved)
        before = math.sqrt(error @ error)
        rounding = 1e-12 * before + _ROUNDING * math.sqrt(self._problem.variance.sum())
        return moved if math.sqrt(after @ after) <= before + rounding else None

    def solution(self, x: Array) -> Solution:
        """What x stands for, with the residuals it leaves."""
        f, _, for_axes = self._towards(x)
        m = x[2:].reshape(3, -1)
        error = for_axes @ m - self._problem.target
        return Solution(f, m.T.copy(), self._problem.floor + (error * error).sum(axis=0))

    def axes(self, f: Array) -> Array:
        """(3, c) the best m_k, as columns, of a field direction (3,)."""
        return least_squares((f @ self._by_field).reshape(-1, 3), self._problem.target)

    def _towards(self, x: Array) -> tuple[Array, float, Array]:
        """The field direction of x, its length before it was made a unit vector, and the equations (r, 3) for m_k.

        Kept until another is asked for: residuals, derivatives and the solution are wanted at the same place.
        """
        at = (float(x[0]), float(x[1]))
        if at != self._at:
            moved = self._field + x[:2] @ self._basis
            length = math.sqrt(moved @ moved)
            f = moved / length
            self._direction = f, length, (f @ self._by_field).reshape(-1, 3)
            self._at = at
        return self._direction
