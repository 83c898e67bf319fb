"""The rotation R_base_tool of an arm from the cosines and sines of its joints, without a chain of matrices a sample.

A chain of hinges is a product of exponentials: with z_j the axis of joint j at zero, resolved in the base frame,

    R_base_tool(q) = E_1(q_1) .. E_N(q_N) R(0),   E_j(q) = z z' + cos q (1 - z z') + sin q [z]x    (Rodrigues).

So vec R is multilinear in (1, cos q_j, sin q_j). Joints that do not move are constants, and for up to three that do, a
block of samples is one matrix product: at most 27 products of cosines and sines against their coefficients. Terms that
vanish identically are left out (for a joint at right angles to the next, z z' times z z' is zero).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.errors import RigError
from rig.threads import one_blas_thread

Array = NDArray[np.float64]

_ROWS = 4096  # samples a block: its products (13 rows on a sweep) and its result stay in the second-level cache
_GROUP = 3  # joints whose products are written out; more would be 3^4 rows
_ROUNDING = 4 * np.finfo(float).eps  # components and coefficients below this are zeros of the geometry


@dataclass(frozen=True, eq=False)
class RotationMap:
    """R_base_tool as a function of N joint values, which turn M hinges; mostly M = N, hinge j by joint value j.

    Attributes:
        axes: (M, 3) unit vectors, the hinges' axes with all of them at zero, base frame.
        R_zero: (3, 3) R_base_tool with all hinges at zero.
        coupling, offset: (M, N), (M,) [rad]: the hinges' angles are coupling q + offset, where a joint slides and turns
            nothing, or turns several hinges; None: they are q.
    """

    axes: Array
    R_zero: Array
    coupling: Array | None = None
    offset: Array | None = None

    def __post_init__(self) -> None:
        # Axes and rotation come out of a chain of quaternions: taking the rounding off them makes the result four times
        # as accurate, and lets the terms that vanish do so.
        axes = _without_rounding(self.axes)
        object.__setattr__(self, "axes", axes / np.linalg.norm(axes, axis=-1, keepdims=True))
        object.__setattr__(self, "R_zero", _without_rounding(self.R_zero))

    def rotations(self, q: ArrayLike, out: Array | None = None) -> Array:
        """vec R_base_tool, row by row: (n, 9) at joint angles (n, N) [rad].

        Args:
            q: (n, N) [rad].
            out: (n, 9), written to and returned if given.
        """
        angles = self._checked(q)
        result = np.empty((len(angles), 9)) if out is None else out
        if result.shape != (len(angles), 9):
            raise ValueError(f"out has shape {result.shape}, expected {(len(angles), 9)}")
        with one_blas_thread():  # on several, products this small wait for each other
            for rows, block in self._blocks(angles, _ROWS):
                result[rows] = block.T
        return result

    def blocks(self, q: ArrayLike, rows: int = _ROWS) -> Iterator[tuple[slice, Array]]:
        """vec R_base_tool in blocks small enough to stay in the cache: the samples, and (9, m), one column a sample.

        Wrap the loop in ``rig.threads.one_blas_thread``. The array is overwritten by the next block.

        Args:
            q: (n, N) [rad].
            rows: samples a block.
        """
        return self._blocks(self._checked(q), rows)

    def _blocks(self, angles: Array, rows: int) -> Iterator[tuple[slice, Array]]:
        if not len(angles):
            return
        moving = moving_joints(angles)
        axes, R_zero = self.folded(angles[0], moving)
        size = min(rows, len(angles))
        starts = range(0, len(moving), _GROUP)
        groups = [
            _Group(axes[start : start + _GROUP], R_zero if start == starts[-1] else np.eye(3), size) for start in starts
        ]
        constant = np.repeat(R_zero.reshape(9, 1), size, axis=1)
        for first in range(0, len(angles), size):
            span = slice(first, min(first + size, len(angles)))
            count = span.stop - first
            factors = [
                group.evaluate(angles[span], moving[start : start + _GROUP])
                for start, group in zip(starts, groups, strict=True)
            ]
            yield span, reduce(_product, factors) if factors else constant[:, :count]

    def folded(self, q: Array, moving: Sequence[int]) -> tuple[Array, Array]:
        """The map of the moving hinges alone, the others held at ``q`` (M,) [rad]: axes (m, 3) and R at zero (3, 3)."""
        carried = np.eye(3)
        axes = []
        for joint, axis in enumerate(self.axes):
            if joint in moving:
                axes.append(carried @ axis)
            else:
                constant, cosine, sine = _rodrigues(axis)
                carried = carried @ (constant + np.cos(q[joint]) * cosine + np.sin(q[joint]) * sine)
        return np.reshape(axes, (-1, 3)), carried @ self.R_zero

    def _checked(self, q: ArrayLike) -> Array:
        """The hinges' angles (n, M)."""
        angles = np.asarray(q, dtype=float)
        count = len(self.axes) if self.coupling is None else self.coupling.shape[1]
        if angles.ndim != 2 or angles.shape[1] != count:
            raise RigError(f"found joint angles of shape {angles.shape}, expected (n, {count})")
        if self.coupling is not None:
            angles = angles @ self.coupling.T
        return angles if self.offset is None else angles + self.offset


def moving_joints(q: Array) -> list[int]:
    """The columns of joint angles (n, N) that are not exactly constant."""
    probes = q[:: max(1, len(q) // 64)]
    at_rest = (probes == q[:1]).all(axis=0)
    return [joint for joint in range(q.shape[1]) if not (at_rest[joint] and (q[:, joint] == q[0, joint]).all())]


def _without_rounding(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=float)
    return np.where(np.abs(array) < _ROUNDING, 0.0, array)


def _rodrigues(axis: Array) -> tuple[Array, Array, Array]:
    """The coefficients (3, 3) of 1, cos q, sin q in a rotation by q about a unit vector."""
    x, y, z = axis
    along = np.outer(axis, axis)
    return along, np.eye(3) - along, np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _product(left: Array, right: Array) -> Array:
    """Products of rotations (9, m), sample by sample."""
    a, b = left.reshape(3, 3, -1), right.reshape(3, 3, -1)
    total = a[:, 0, None] * b[None, 0]
    total += a[:, 1, None] * b[None, 1]
    total += a[:, 2, None] * b[None, 2]
    return total.reshape(9, -1)


@dataclass(frozen=True)
class _Terms:
    """How up to three moving joints turn: E_1(q_1) E_2(q_2) E_3(q_3) R as monomials with coefficients.

    A monomial is a tuple with 0, 1 or 2 for each joint: its factor 1, cosine or sine. Rows of a workspace hold the
    monomials with a coefficient first, so that they are one matrix, then those that only serve to build others.

    Attributes:
        coefficients: (9, k) of the monomials with one.
        rows: of the workspace. cosine, sine: the joints' own rows.
        products: target row and the two that make it, shorter monomials first.
    """

    coefficients: Array
    rows: int
    cosine: tuple[int, ...]
    sine: tuple[int, ...]
    products: tuple[tuple[int, int, int], ...]


@lru_cache(maxsize=256)
def _terms(axes: tuple[float, ...], R_last: tuple[float, ...]) -> _Terms:
    """Of unit vectors (m, 3) and a rotation (3, 3), both row by row."""
    terms = [_rodrigues(axis) for axis in np.reshape(axes, (-1, 3))]
    joints = range(len(terms))
    last = np.reshape(R_last, (3, 3))
    coefficients = {
        monomial: reduce(np.matmul, [term[factor] for term, factor in zip(terms, monomial, strict=True)]) @ last
        for monomial in product(range(3), repeat=len(terms))
    }
    kept = [monomial for monomial, matrix in coefficients.items() if np.abs(matrix).max() > _ROUNDING]
    row = {monomial: index for index, monomial in enumerate(kept)}

    def row_of(joint: int, factor: int) -> int:
        single = tuple(factor if index == joint else 0 for index in joints)
        return row.setdefault(single, len(row))

    cosine, sine = (tuple(row_of(joint, factor) for joint in joints) for factor in (1, 2))
    products: list[tuple[int, int, int]] = []

    def plan(monomial: tuple[int, ...]) -> int:
        factors = np.flatnonzero(monomial)
        target = row.setdefault(monomial, len(row))
        if len(factors) > 1 and all(target != done[0] for done in products):
            final = int(factors[-1])
            rest = tuple(0 if index == final else factor for index, factor in enumerate(monomial))
            products.append((target, plan(rest), row_of(final, monomial[final])))
        return target

    for monomial in kept:
        plan(monomial)
    matrix = np.stack([coefficients[monomial].ravel() for monomial in kept], axis=1)
    return _Terms(matrix, len(row), cosine, sine, tuple(products))


class _Group:
    """Up to three moving joints as one matrix product a block, with the workspace for it."""

    def __init__(self, axes: Array, R_last: Array, size: int) -> None:
        self._terms = _terms(tuple(axes.ravel().tolist()), tuple(R_last.ravel().tolist()))
        self._work = np.ones((self._terms.rows, size))  # the monomial 1 is never written to
        self._half = np.empty((len(axes), size))
        self._scale = np.empty((len(axes), size))
        self._out = np.empty((9, size))

    def evaluate(self, q: Array, columns: Sequence[int]) -> Array:
        """(9, m) from the columns of joint angles (m, N) [rad]."""
        count, terms = len(q), self._terms
        tangent, scale, work = self._half[:, :count], self._scale[:, :count], self._work[:, :count]
        for index, column in enumerate(columns):
            np.multiply(q[:, column], 0.5, out=tangent[index])
        # The half-angle tangent gives both: cos = 2/(1 + t^2) - 1, sin = t 2/(1 + t^2), within 4e-16 at any angle.
        # NumPy has a vector tangent, ten times as fast as its double-precision sine and cosine.
        np.tan(tangent, out=tangent)
        np.multiply(tangent, tangent, out=scale)
        scale += 1.0
        np.divide(2.0, scale, out=scale)
        for index in range(len(columns)):
            np.subtract(scale[index], 1.0, out=work[terms.cosine[index]])
            np.multiply(tangent[index], scale[index], out=work[terms.sine[index]])
        for target, left, right in terms.products:
            np.multiply(work[left], work[right], out=work[target])
        return np.matmul(terms.coefficients, work[: terms.coefficients.shape[1]], out=self._out[:, :count])
