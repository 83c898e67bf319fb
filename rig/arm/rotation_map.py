"""The pose of an arm's tool from the cosines and sines of its joints, without a chain of matrices a sample.

A chain of hinges is a product of exponentials: with z_j the axis of joint j at zero, resolved in the base frame,

    R_base_tool(q) = E_1(q_1) .. E_N(q_N) R(0),   E_j(q) = z z' + cos q (1 - z z') + sin q [z]x    (Rodrigues).

So vec R is multilinear in (1, cos q_j, sin q_j). Joints that do not move are constants, and for up to three that do, a
block of samples is one matrix product: at most 27 products of cosines and sines against their coefficients. Terms that
vanish identically are left out (for a joint at right angles to the next, z z' times z z' is zero). A turn about a line
through a point a is affine, p -> a + E_j (p - a): as matrices (4, 4) the same holds of the tool's position.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array
from rig.errors import RigError
from rig.threads import one_blas_thread

_ROWS = 4096  # samples a block: its products (13 rows on a sweep) and its result stay in the second-level cache
_GROUP = 3  # joints whose products are written out; more would be 3^4 rows
_ROUNDING = 4 * np.finfo(float).eps  # components and coefficients below this are zeros of the geometry


@dataclass(frozen=True, eq=False)
class RotationMap:
    """R_base_tool as a function of N joint values, which turn M hinges; mostly M = N, hinge j by joint value j.

    With points on the axes the position as well, of an arm all of whose joints turn.

    Attributes:
        axes: (M, 3) unit vectors, the hinges' axes with all of them at zero, base frame.
        R_zero: (3, 3) R_base_tool with all hinges at zero.
        coupling, offset: (M, N), (M,) [rad]: the hinges' angles are coupling q + offset, where a joint slides and turns
            nothing, or turns several hinges; None: they are q.
        anchors, p_zero: (M, 3), (3,) [m] a point on each hinge's axis, and the tool's position, with all hinges at
            zero, base frame; None: only rotations are asked for.
    """

    axes: Array
    R_zero: Array
    coupling: Array | None = None
    offset: Array | None = None
    anchors: Array | None = None
    p_zero: Array | None = None

    def __post_init__(self) -> None:
        # Axes and rotation come out of a chain of quaternions: taking the rounding off them makes the result four times
        # as accurate, and lets the terms that vanish do so.
        axes = _without_rounding(self.axes)
        object.__setattr__(self, "axes", axes / np.linalg.norm(axes, axis=-1, keepdims=True))
        object.__setattr__(self, "R_zero", _without_rounding(self.R_zero))
        for name in ("anchors", "p_zero"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, _without_rounding(given))

    def rotations(self, q: ArrayLike) -> Array:
        """vec R_base_tool, row by row: (n, 9) at joint angles (n, N) [rad]."""
        angles = self._checked(q)
        result = np.empty((len(angles), 9))
        with one_blas_thread():  # on several, products this small wait for each other
            for rows, block in _blocks(self.axes, self.R_zero, angles, _ROWS):
                result[rows] = block.T
        return result

    def poses(self, q: ArrayLike) -> tuple[Array, Array]:
        """R_base_tool (n, 3, 3) and the position (n, 3) [m], base frame, at joint angles (n, N) [rad].

        Raises:
            ValueError: the map is of rotations only.
        """
        if self.anchors is None or self.p_zero is None:
            raise ValueError("the map is of rotations only, expected one with points on the axes")
        angles = self._checked(q)
        rotation, position = np.empty((len(angles), 9)), np.empty((len(angles), 3))
        lines, last = np.hstack([self.axes, self.anchors]), np.eye(4)
        last[:3, :3], last[:3, 3] = self.R_zero, self.p_zero
        with one_blas_thread():
            for rows, block in _blocks(lines, last, angles, _ROWS):
                rotation[rows], position[rows] = block[:9].T, block[9:].T
        return rotation.reshape(-1, 3, 3), position

    def blocks(self, q: ArrayLike, rows: int = _ROWS) -> Iterator[tuple[slice, Array]]:
        """vec R_base_tool in blocks small enough to stay in the cache: the samples, and (9, m), one column a sample.

        Wrap the loop in ``rig.threads.one_blas_thread``. The array is overwritten by the next block.

        Args:
            q: (n, N) [rad].
            rows: samples a block.
        """
        return _blocks(self.axes, self.R_zero, self._checked(q), rows)

    def _checked(self, q: ArrayLike) -> Array:
        """The hinges' angles (n, M)."""
        angles = np.asarray(q, dtype=float)
        count = len(self.axes) if self.coupling is None else self.coupling.shape[1]
        if angles.ndim != 2 or angles.shape[1] != count:
            raise RigError(f"found joint angles of shape {angles.shape}, expected (n, {count})")
        if self.coupling is not None:
            angles = angles @ self.coupling.T
        return angles if self.offset is None else angles + self.offset


def _blocks(lines: Array, last: Array, angles: Array, rows: int) -> Iterator[tuple[slice, Array]]:
    """The samples and what the hinges make of the last matrix there, (9, m) or (12, m), in blocks; see ``folded``."""
    if not len(angles):
        return
    moving = moving_joints(angles)
    lines, last = folded(lines, last, angles[0], moving)
    size = min(rows, len(angles))
    starts = range(0, len(moving), _GROUP)
    groups = [
        _Group(lines[start : start + _GROUP], last if start == starts[-1] else np.eye(len(last)), size)
        for start in starts
    ]
    constant = np.repeat(_rows(last)[:, None], size, axis=1)
    for first in range(0, len(angles), size):
        span = slice(first, min(first + size, len(angles)))
        count = span.stop - first
        factors = [
            group.evaluate(angles[span], moving[start : start + _GROUP])
            for start, group in zip(starts, groups, strict=True)
        ]
        yield span, reduce(_product, factors) if factors else constant[:, :count]


def folded(lines: Array, last: Array, q: Array, moving: Sequence[int]) -> tuple[Array, Array]:
    """The moving hinges alone, the others held at ``q`` (M,) [rad].

    Args:
        lines: (M, 3) axes; or (M, 6) axes and a point on each.
        last: (3, 3) R at zero; or (4, 4) with the position.
    """
    carried = np.eye(len(last))
    found = []
    for joint, line in enumerate(lines):
        if joint in moving:
            moved = carried[:3, :3] @ line.reshape(-1, 3).T
            moved[:, 1:] += carried[:3, 3:]
            found.append(moved.T.ravel())
        else:
            constant, cosine, sine = _rodrigues(line)
            carried = carried @ (constant + np.cos(q[joint]) * cosine + np.sin(q[joint]) * sine)
    return np.reshape(found, (-1, lines.shape[1])), carried @ last


def moving_joints(q: Array) -> list[int]:
    """The columns of joint angles (n, N) that are not exactly constant."""
    probes = q[:: max(1, len(q) // 64)]
    at_rest = (probes == q[:1]).all(axis=0)
    return [joint for joint in range(q.shape[1]) if not (at_rest[joint] and (q[:, joint] == q[0, joint]).all())]


def _without_rounding(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=float)
    return np.where(np.abs(array) < _ROUNDING, 0.0, array)


def _rodrigues(line: Array) -> tuple[Array, Array, Array]:
    """The coefficients of 1, cos q, sin q in a turn by q about a unit vector, (3, 3); about a line, (4, 4).

    Args:
        line: (3,) the unit vector; or (6,) with a point of the line.
    """
    x, y, z = axis = line[:3]
    along = np.outer(axis, axis)
    terms = along, np.eye(3) - along, np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if len(line) == 3:
        return terms
    affine = np.zeros((3, 4, 4))
    affine[:, :3, :3] = terms
    affine[:, :3, 3] = -np.matmul(terms, line[3:])
    affine[0, :3, 3] += line[3:]
    affine[0, 3, 3] = 1.0
    return affine[0], affine[1], affine[2]


def _rows(matrix: Array) -> Array:
    """A rotation (3, 3) row by row (9,); of a pose (4, 4) the position after it (12,)."""
    return np.concatenate([matrix[:3, :3].ravel(), matrix[:3, 3:].ravel()])


def _product(left: Array, right: Array) -> Array:
    """Products of rotations (9, m) or poses (12, m), sample by sample."""
    a, b = left[:9].reshape(3, 3, -1), right.reshape(-1, 3, right.shape[1])
    if len(right) > 9:  # the position as one more column
        b = np.concatenate([b[:3], b[3, :, None]], axis=1)
    total = a[:, 0, None] * b[None, 0]
    total += a[:, 1, None] * b[None, 1]
    total += a[:, 2, None] * b[None, 2]
    if len(right) == 9:
        return total.reshape(9, -1)
    total[:, 3] += left[9:]
    return np.concatenate([total[:, :3].reshape(9, -1), total[:, 3]])


@dataclass(frozen=True)
class _Terms:
    """How up to three moving joints turn: E_1(q_1) E_2(q_2) E_3(q_3) R as monomials with coefficients.

    A monomial is a tuple with 0, 1 or 2 for each joint: its factor 1, cosine or sine. Rows of a workspace hold the
    monomials with a coefficient first, so that they are one matrix, then those that only serve to build others.

    Attributes:
        coefficients: (9, k) of the monomials with one; of poses (12, k).
        rows: of the workspace. cosine, sine: the joints' own rows.
        products: target row and the two that make it, shorter monomials first.
    """

    coefficients: Array
    rows: int
    cosine: tuple[int, ...]
    sine: tuple[int, ...]
    products: tuple[tuple[int, int, int], ...]


@lru_cache(maxsize=256)
def _terms(lines: tuple[float, ...], R_last: tuple[float, ...]) -> _Terms:
    """Of unit vectors (m, 3) and a rotation (3, 3), or of lines (m, 6) and a pose (4, 4), both row by row."""
    size = 3 if len(R_last) == 9 else 4
    terms = [_rodrigues(line) for line in np.reshape(lines, (-1, 3 * size - 6))]
    joints = range(len(terms))
    last = np.reshape(R_last, (size, size))
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
    matrix = np.stack([_rows(coefficients[monomial]) for monomial in kept], axis=1)
    return _Terms(matrix, len(row), cosine, sine, tuple(products))


class _Group:
    """Up to three moving joints as one matrix product a block, with the workspace for it."""

    def __init__(self, lines: Array, last: Array, size: int) -> None:
        self._terms = _terms(tuple(lines.ravel().tolist()), tuple(last.ravel().tolist()))
        self._work = np.ones((self._terms.rows, size))  # the monomial 1 is never written to
        self._half = np.empty((len(lines), size))
        self._scale = np.empty((len(lines), size))
        self._out = np.empty((len(self._terms.coefficients), size))

    def evaluate(self, q: Array, columns: Sequence[int]) -> Array:
        """(9, m) or (12, m) from the columns of joint angles (m, N) [rad]."""
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
