"""The global minimum of the known-angle cost, from any data and without an initial guess, for many data sets at once.

For a fixed field direction f the model is linear in m_k = S_k |f| P_k and delta_k, with the same 3 x 3 normal matrix
A(f) for every channel once delta_k is eliminated by centring: variable projection (Golub and Pereyra, 1973). What is
left is a function of a direction only, on a half sphere, as (f, P_k) and (-f, -P_k) give the same readings. It is
evaluated on a grid all at once, and from every local minimum of the grid Newton's method with the exact Hessian of the
projected cost takes some five steps in two tangent coordinates, each a few products over all data sets.

Arrays have the data sets last: (3, P) directions, (9, P) products. A data set's weights are put into its readings:
every channel is multiplied by the root of its weight, and the cost is then an unweighted sum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy.spatial import cKDTree

from rig.arrays import Array, Mask, Rows
from rig.directions import spiral, tangent_basis
from rig.errors import RefusedFit

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
#: A step shorter than this [rad] is the last one: Newton's method squares it.
_LAST_STEP = 1e-8
#: Steps are cut to this [rad], two of the grid's meshes.
_LONGEST_STEP = 0.25
_MOST_STEPS = 60
#: Numbers of a block of the grid's values: 4 MiB stay in a core's cache.
_BLOCK_NUMBERS = 1 << 19


@cache
def half_sphere(points: int) -> tuple[Array, Rows, Array]:
    """Directions (g, 3) spread evenly over a half sphere, the neighbours (g, 8) of each, and products f_i f_j (g, 9).

    A direction at the rim has neighbours across it, as f and -f are the same here.
    """
    directions = spiral(points, 1.0)
    tree = cKDTree(np.vstack([directions, -directions]))
    neighbours = tree.query(directions, k=9)[1][:, 1:] % points
    products = (directions[:, :, None] * directions[:, None, :]).reshape(-1, 9)
    return directions, neighbours, products


@dataclass(frozen=True)
class Problems:
    """P centred least-squares problems of c channels that share a field direction, per sample.

    Attributes:
        covariance: (9, 9) of vec R, the same for all, or (P, 9, 9).
        cross: (9, P, c) covariance of vec R and the weighted readings.
        variance: (P, c) of the weighted readings.
    """

    covariance: Array
    cross: Array
    variance: Array

    @property
    def count(self) -> int:
        """P."""
        return int(self.cross.shape[1])

    @cached_property
    def trace(self) -> Array:
        """() or (P,) of the covariance."""
        return np.asarray(np.trace(self.covariance, axis1=-2, axis2=-1))

    @cached_property
    def for_axes(self) -> Array:
        """(9, 9) or (P, 9, 9): maps f_i f_k to A_jl, the equations for m."""
        return _permuted(self.covariance, (1, 3, 0, 2))

    @cached_property
    def for_field(self) -> Array:
        """Maps m_j m_l to G_ik, the equations for f."""
        return _permuted(self.covariance, (0, 2, 1, 3))

    @cached_property
    def for_both(self) -> Array:
        """Maps m_j f_k to B_il, what couples f and m."""
        return _permuted(self.covariance, (0, 3, 1, 2))

    def select(self, rows: Rows | slice) -> Problems:
        """Some of them."""
        shared = self.covariance.ndim == 2
        return Problems(self.covariance if shared else self.covariance[rows], self.cross[:, rows], self.variance[rows])

    def weighted(self, factor: Array) -> Problems:
        """The same with readings times (P, c)."""
        return Problems(self.covariance, self.cross * factor, self.variance * factor * factor)

    @property
    def grid_points(self) -> int:
        """How fine a grid of directions the worst of them asks for."""
        values = np.linalg.eigvalsh(self.covariance).reshape(-1, 9)
        kind = values[:, 0] * FINE_GRID_CONDITION > values[:, -1]
        return GRID_POINTS if kind.all() else FINE_GRID_POINTS


@dataclass(frozen=True)
class Minima:
    """Local minima of P problems, one a column.

    Attributes:
        problem: (L,) which problem each belongs to, ascending.
        field: (3, L). scaled_axes: (3, L, c) m_k times the root of the weight.
        mean_square: (L, c) weighted mean square residuals.
        converged: (L,) whether the last step was short enough.
    """

    problem: Rows
    field: Array
    scaled_axes: Array
    mean_square: Array
    converged: Mask

    @property
    def cost(self) -> Array:
        """(L,)."""
        return np.asarray(self.mean_square.sum(axis=1))

    def best(self) -> Rows:
        """(P,) the row of each problem's lowest minimum.

        Raises:
            RefusedFit: there is none.
        """
        if not self.problem.size:
            raise RefusedFit(
                "no best fit is found: the readings, or their noise, differ by too many orders of magnitude"
            )
        order = np.lexsort((self.cost, self.problem))
        first = np.concatenate([[True], np.diff(self.problem[order]) > 0])
        return np.asarray(order[first])


def local_minima(problems: Problems) -> Minima:
    """Every local minimum that a descent from the grid's local minima leads to; some may be found twice."""
    points = problems.grid_points
    directions = half_sphere(points)[0]
    channels = problems.cross.shape[2]
    size = max(1, _BLOCK_NUMBERS // (points * 3 * channels))
    columns: list[Rows] = []
    starts: list[Rows] = []
    for begin in range(0, problems.count, size):
        value = _explained(problems.select(slice(begin, begin + size)), points)
        rows, which = _peaks(value, points)
        starts.append(rows)
        columns.append(which + begin)
    which = np.concatenate(columns)
    order = np.argsort(which, kind="stable")
    which, rows = which[order], np.concatenate(starts)[order]
    return descend(problems.select(which), directions[rows].T, which)


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


def _explained(problems: Problems, points: int) -> Array:
    """(g, P) what the best m_k explain of the weighted readings, for every direction of the grid."""
    directions, _, products = half_sphere(points)
    ridge = 1e-12 * problems.trace + 1e-300
    if problems.covariance.ndim == 2:
        factor = cholesky((products @ problems.for_axes.T).T, float(ridge))
        by_field = np.zeros((3, len(directions), 3, 3))  # row j of [f^T C] as a matrix on vec C
        for j in range(3):
            by_field[j, :, :, j] = directions
        solved = np.stack(forward(factor, by_field.reshape(3, -1, 9).transpose(0, 2, 1))).transpose(0, 2, 1)
        z = solved.reshape(-1, 9) @ problems.cross.reshape(9, -1)
        np.multiply(z, z, out=z)
        return np.asarray(z.reshape(3, len(directions), problems.count, -1).sum(axis=(0, 3)))
    normal = np.tensordot(problems.for_axes, products, axes=(2, 1))  # (P, 9, g)
    factor = cholesky(normal.transpose(1, 0, 2), ridge[:, None])
    right = np.tensordot(problems.cross.reshape(3, 3, problems.count, -1), directions, axes=(0, 1))  # (3, P, c, g)
    z = np.stack(forward(factor, right.transpose(0, 2, 1, 3)))
    return np.asarray((z * z).sum(axis=(0, 1)).T)


def _peaks(value: Array, points: int) -> tuple[Rows, Rows]:
    """Directions and problems of the local maxima of (g, P) values, the ``MOST_STARTS`` highest of each problem."""
    neighbours = half_sphere(points)[1]
    peak = np.ones(value.shape, dtype=bool)
    for column in neighbours.T:
        peak &= value >= value[column]
    for problem in np.flatnonzero(peak.sum(axis=0) > MOST_STARTS):
        rows = np.flatnonzero(peak[:, problem])
        peak[rows[np.argsort(-value[rows, problem])][MOST_STARTS:], problem] = False
    rows, columns = np.nonzero(peak)
    return rows, columns


def descend(problems: Problems, field: Array, label: Rows) -> Minima:
    """The local minimum next to a field direction, for every problem.

    Args:
        problems: one for every start.
        field: (3, P) where to start.
        label: (P,) what to note as ``Minima.problem``.
    """
    found = np.array(field)
    converged = np.zeros(problems.count, dtype=bool)
    active = np.arange(problems.count)
    part = problems
    damping = np.zeros(problems.count)
    now = _Point.at(part, found)
    for _ in range(_MOST_STEPS):
        step = now.step(part, damping[active])
        length = np.sqrt((step * step).sum(axis=0))
        moved = now.field + (step[:, None] * now.basis).sum(axis=0)
        moved /= np.sqrt((moved * moved).sum(axis=0))
        new = _Point.at(part, moved)
        # Near the minimum the cost is flat to its rounding, so a rise of that size is none.
        better = new.cost <= now.cost + 1e-14 * part.variance.sum(axis=1)
        found[:, active[better]] = moved[:, better]
        done = better & (length < _LAST_STEP)
        converged[active[done]] = True
        damping[active] = np.where(better, 0.1 * damping[active], np.maximum(10.0 * damping[active], 1e-3))
        given_up = damping[active] > 1e12
        stay = ~(done | given_up)
        if not stay.any():
            break
        if stay.all() and better.all():
            now = new
            continue
        active = active[stay]
        part = problems.select(active)
        now = _Point.at(part, found[:, active])
    last = new if len(active) == problems.count and better.all() else _Point.at(problems, found)
    return Minima(label, found, last.scaled_axes, last.mean_square(problems), converged)


@dataclass(frozen=True)
class _Point:
    """Field directions (3, P) with the axes (3, P, c) that fit best, and the Cholesky factors of their equations."""

    field: Array
    scaled_axes: Array
    factor: tuple[Array, ...]
    right: Array
    cost: Array

    @classmethod
    def at(cls, problems: Problems, field: Array) -> _Point:
        products = (field[:, None] * field[None]).reshape(9, -1)
        factor = cholesky(_times(problems.for_axes, products), 1e-15 * problems.trace + 1e-300)
        wide = tuple(entry[:, None] for entry in factor)
        right = np.einsum("ip,ijpc->jpc", field, problems.cross.reshape(3, 3, *problems.cross.shape[1:]))
        axes = np.stack(_backward(wide, forward(wide, right)))
        return cls(field, axes, factor, right, problems.variance.sum(axis=1) - (right * axes).sum(axis=(0, 2)))

    def mean_square(self, problems: Problems) -> Array:
        """(P, c) what is left of each channel."""
        return np.asarray(np.maximum(problems.variance - (self.right * self.scaled_axes).sum(axis=0), 0.0))

    @cached_property
    def basis(self) -> Array:
        """(2, 3, P) of the tangents at the fields."""
        return np.asarray(tangent_basis(self.field.T).transpose(1, 2, 0))

    def step(self, problems: Problems, damping: Array) -> Array:
        """(2, P) Newton's step of the projected cost in tangent coordinates, damped by (P,) of its curvature.

        With L(f, m) = sum over k of |f m_k^T|^2 in the metric of the covariance, less 2 f^T C_k m_k, and m at its
        minimum for f, the Hessian is L_ff - L_fm L_mm^-1 L_mf. The sphere's curvature adds nothing, as f . L_f = 0.
        """
        _, p, c = self.scaled_axes.shape
        f = np.repeat(self.field, c, axis=1)
        m = self.scaled_axes.reshape(3, p * c)
        covariance, for_both, for_field = problems.covariance, problems.for_both, problems.for_field
        if covariance.ndim == 3:
            covariance, for_both, for_field = (np.repeat(each, c, axis=0) for each in (covariance, for_both, for_field))
        error = _times(covariance, (f[:, None] * m[None]).reshape(9, -1)) - problems.cross.reshape(9, -1)
        error = error.reshape(3, 3, -1)
        mixed = error + _times(for_both, (m[:, None] * f[None]).reshape(9, -1)).reshape(3, 3, -1)
        basis = self.basis
        wide = np.repeat(basis, c, axis=2)
        gradient = np.einsum("aip,ijp,jp->ap", wide, error, m).reshape(2, p, c).sum(axis=2)
        by_field = _times(for_field, (m[:, None] * m[None]).reshape(9, -1)).reshape(3, 3, p, c).sum(axis=3)
        hessian = np.einsum("aip,ijp,bjp->abp", basis, by_field, basis)
        coupled = np.einsum("aip,ijp->jap", wide, mixed)  # (3, 2, P c)
        solved = np.stack(forward(tuple(np.repeat(entry, c) for entry in self.factor), coupled))
        hessian -= np.einsum("jap,jbp->abp", solved, solved).reshape(2, 2, p, c).sum(axis=3)
        return _descent(hessian, gradient, damping)


def _descent(hessian: Array, gradient: Array, damping: Array) -> Array:
    """(2, P) -|H|^-1 g, |H| with the absolute eigenvalues of H (2, 2, P), damped and cut to ``_LONGEST_STEP``."""
    a, b, d = hessian[0, 0], hessian[0, 1], hessian[1, 1]
    middle, half = 0.5 * (a + d), 0.5 * (a - d)
    radius = np.hypot(half, b)
    angle = 0.5 * np.arctan2(b, half)  # of the eigenvector of the larger eigenvalue
    cosine, sine = np.cos(angle), np.sin(angle)
    larger, smaller = np.abs(middle + radius), np.abs(middle - radius)
    floor = (1e-14 + damping) * np.maximum(np.maximum(larger, smaller), 1e-300)
    along = -(cosine * gradient[0] + sine * gradient[1]) / (larger + floor)
    across = -(-sine * gradient[0] + cosine * gradient[1]) / (smaller + floor)
    step = np.stack([cosine * along - sine * across, sine * along + cosine * across])
    length = np.sqrt((step * step).sum(axis=0))
    return np.asarray(step * np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300)))


def _times(matrix: Array, columns: Array) -> Array:
    """(9, P): one matrix (9, 9), or one each (P, 9, 9), times columns (9, P)."""
    if matrix.ndim == 2:
        return np.asarray(matrix @ columns)
    return np.asarray(np.matmul(matrix, columns.T[:, :, None])[:, :, 0].T)


def _permuted(covariance: Array, order: tuple[int, int, int, int]) -> Array:
    """Covariance of R_ij and R_kl (.., 9, 9) with its four indices in another order."""
    lead = covariance.shape[:-2]
    axes = (*range(len(lead)), *(len(lead) + index for index in order))
    return covariance.reshape(*lead, 3, 3, 3, 3).transpose(axes).reshape(*lead, 9, 9)


def _backward(factor: tuple[Array, ...], z: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    """L^T x = z."""
    l11, l21, l31, l22, l32, l33 = factor
    x3 = z[2] / l33
    x2 = (z[1] - l32 * x3) / l22
    return (z[0] - l21 * x2 - l31 * x3) / l11, x2, x3
