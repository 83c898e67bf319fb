"""Orthonormal bases of columns, and projecting these out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from rig.arrays import Array

#: Least eigenvalue of columns' Gram matrix, their lengths one, above which Cholesky's factor orthogonalises them.
_WELL: Final = 1e-8
#: And above which once leaves them orthogonal to 1e-13.
_BEST: Final = 1e-2


@dataclass(frozen=True, eq=False)
class Basis:
    """Orthonormal columns that are zero outside some rows.

    Attributes:
        blocks: rows, and columns (rows, k) that are zero outside them. length: of a column.
    """

    blocks: tuple[tuple[slice, Array], ...]
    length: int

    @property
    def rank(self) -> int:
        """How many columns."""
        return sum(block.shape[1] for _, block in self.blocks)

    def along(self, values: Array, first: int = 0) -> Array:
        """(rank,) or (rank, m) products with values (rows,) or (rows, m), that of rows from ``first`` on."""
        found, last = [], first + len(values)
        for rows, block in self.blocks:
            start, stop = max(rows.start, first), min(rows.stop, last)
            if start < stop:
                found.append(block[start - rows.start : stop - rows.start].T @ values[start - first : stop - first])
            else:
                found.append(np.zeros((block.shape[1], *values.shape[1:])))
        return np.concatenate(found) if found else np.zeros((0, *values.shape[1:]))

    def without(self, values: Array) -> Array:
        """Values (length,) or (length, m) with the columns projected out; each column contiguous."""
        left = values.T.copy()
        for rows, block in self.blocks:
            left[..., rows] -= (block.T @ values[rows]).T @ block.T
        return left.T

    def dense(self, rows: slice | NDArray[np.intp] = slice(None)) -> Array:
        """(rows, rank) of all columns."""
        found = np.zeros((self.rank, self.length))
        first = 0
        for own, block in self.blocks:
            found[first : first + block.shape[1], own] = block.T
            first += block.shape[1]
        return found.T[rows]

    def extended(self, columns: Array) -> Basis:
        """With columns (length, m) besides."""
        more = orthonormal(self.without(columns))
        return Basis((*self.blocks, (slice(0, self.length), more)), self.length)

    def of(self, rows: NDArray[np.intp]) -> Basis:
        """In some of the rows: for columns that are zero outside them, and residuals."""
        return Basis(((slice(0, len(rows)), self.dense(rows)),), len(rows))


@dataclass(frozen=True)
class Columns:
    """Whitened columns that are zero outside some channels.

    Attributes:
        values: (rows, m), each column contiguous.
        first: where these rows begin in the whole vector.
    """

    values: Array
    first: int

    @property
    def rows(self) -> slice:
        """Where they are in the whole vector."""
        return slice(self.first, self.first + len(self.values))

    def full(self, size: int) -> Array:
        """(size, m) the whole vectors, each column contiguous."""
        found = np.zeros((self.values.shape[1], size)).T
        found[self.rows] = self.values
        return found


def orthonormal(columns: Array, tolerance: float = 1e-7, scaled: bool = False) -> Array:
    """An orthonormal basis (rows, rank) of columns (rows, m), scaled alike before their rank is judged.

    Args:
        scaled: whether they are.
    """
    if not scaled:
        length = np.linalg.norm(columns, axis=0)
        columns = columns[:, length > 0] / length[length > 0]
    if columns.shape[1] == 0:
        return columns
    gram = columns.T @ columns
    least = np.linalg.eigvalsh(gram)[0]
    if least > _WELL:  # Cholesky QR, twice: Yamamoto et al., ETNA 44 (2015)
        columns = (np.linalg.inv(np.linalg.cholesky(gram)) @ columns.T).T
        if least > _BEST:
            return columns
        return (np.linalg.inv(np.linalg.cholesky(columns.T @ columns)) @ columns.T).T
    q, r, _ = qr(columns, mode="economic", pivoting=True, check_finite=False)
    rank = int(np.sum(np.abs(np.diag(r)) > tolerance))
    return np.asfortranarray(q[:, :rank])


def project(basis: Array | Basis, values: Array) -> Array:
    """Values (rows,) or (rows, m) with an orthonormal basis (rows, rank) projected out; each column contiguous."""
    if isinstance(basis, Basis):
        return basis.without(values)
    if values.ndim == 1:
        return values - basis @ (basis.T @ values)
    return (values.T - (basis.T @ values).T @ basis.T).T


def side_by_side(*columns: Array) -> Array:
    """(rows, m) of arrays (rows,) or (rows, k), each column contiguous."""
    return np.vstack([each.T for each in columns]).T
