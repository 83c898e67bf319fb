"""Factorisations of matrices of three to some thirty rows.

SciPy's bindings of LAPACK: NumPy's own functions, which serve stacks of matrices, take several times as long as the
factorisation of one so small.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from scipy.linalg import lapack

from rig.arrays import Array

_lapack: Any = lapack
_UNIT: Final = [np.eye(size, order="F") for size in range(11)]


def eigh(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues, ascending, and eigenvectors as columns, of a symmetric matrix; NaN where there are none."""
    values, vectors, failed = _lapack.dsyev(matrix)
    return (values, vectors) if failed == 0 else (np.full_like(values, np.nan), vectors)


def inverse(matrix: Array) -> Array | None:
    """Of a symmetric, positive definite matrix; None where it is not definite."""
    return solve(matrix, _UNIT[len(matrix)])


def solve(matrix: Array, right: Array) -> Array | None:
    """Of a symmetric, positive definite system; None where it is not definite."""
    _, solution, failed = _lapack.dposv(matrix, right)
    return np.asarray(solution) if failed == 0 else None
