"""Orthonormal bases of columns, and projecting these out."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

Array = NDArray[np.float64]

#: Least eigenvalue of columns' Gram matrix, their lengths one, above which Cholesky's factor orthogonalises them.
_WELL: Final = 1e-8
#: And above which once leaves them orthogonal to 1e-13.
_BEST: Final = 1e-2


def orthonormal(columns: Array, tolerance: float = 1e-7) -> Array:
    """An orthonormal basis (rows, rank) of columns (rows, m), scaled alike before their rank is judged."""
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


def project(basis: Array, values: Array) -> Array:
    """Values (rows,) or (rows, m) with an orthonormal basis (rows, rank) projected out; each column contiguous."""
    if values.ndim == 1:
        return values - basis @ (basis.T @ values)
    return (values.T - (basis.T @ values).T @ basis.T).T


def side_by_side(*columns: Array) -> Array:
    """(rows, m) of arrays (rows,) or (rows, k), each column contiguous."""
    return np.vstack([each.T for each in columns]).T
