"""The ten monomials of degree two and less in three variables, and what noise does to the mean of their products.

A quadric is linear in them, so its algebraic fit needs the data only through the 10 x 10 matrix of their products.
Noise e ~ N(0, N) turns the mean of a polynomial f into exp(D) f with D = tr(N Hess)/2 (half a Laplacian), so exp(-D) f,
which ends after two terms for degree four, is unbiased: the adjusted least squares of Markovsky, Kukush and Van Huffel,
"Consistent least squares fitting of ellipsoids" (Numerische Mathematik 98, 2004).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array

#: 1, y1, y2, y3, y1^2, y2^2, y3^2, y1 y2, y1 y3, y2 y3.
EXPONENTS: Final = (
    (0, 0, 0),
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (2, 0, 0),
    (0, 2, 0),
    (0, 0, 2),
    (1, 1, 0),
    (1, 0, 1),
    (0, 1, 1),
)
TERMS: Final = len(EXPONENTS)
#: The entries of a symmetric (3, 3) matrix in the order of the quadratic monomials.
PAIRS: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: The monomials beside the constant that a model has: axis-parallel quadrics have no mixed products.
FREE: Final[dict[int, slice]] = {6: slice(1, 7), 9: slice(1, 10)}

#: Their places in the nine.
FLAT: Final = np.array([3 * i + j for i, j in PAIRS])
_WHERE: Final = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
_DOUBLE: Final = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def packed(matrices: Array) -> Array:
    """(..., 6) entries of symmetric (..., 3, 3) matrices, in the order of PAIRS."""
    return np.asarray(matrices.reshape(*matrices.shape[:-2], 9)[..., FLAT])


def symmetric(entries: Array) -> Array:
    """(3, 3) from (6,), the reverse of ``packed``."""
    return np.asarray(entries[_WHERE])


def products(one: Array, other: Array) -> Array:
    """(n, 6) of vectors (n, 3): derivatives of one^T E other by the entries of a symmetric E, in the order of PAIRS."""
    return np.column_stack([one[:, i] * other[:, j] + (0.0 if i == j else one[:, j] * other[:, i]) for i, j in PAIRS])


def quadratic_form(matrix: Array) -> Array:
    """(6,) coefficients of y^T matrix y in the quadratic monomials."""
    return np.asarray(matrix.take(FLAT) * _DOUBLE)


def multiply_out(rows: Array) -> None:
    """The quadratic monomials, rows 3 to 8, of y, rows 0 to 2."""
    y = rows[:3]
    np.multiply(y, y, out=rows[3:6])
    np.multiply(y[0], y[1:], out=rows[6:8])
    np.multiply(y[1], y[2], out=rows[8])


def table(readings: Array, whitening: Array, center: Array) -> Array:
    """(10, n) all monomials of y = whitening (V - center), for readings V (n, 3)."""
    rows = np.empty((TERMS, len(readings)))
    rows[0] = 1.0
    np.matmul(whitening, readings.T, out=rows[1:4])
    rows[1:4] -= (whitening @ center)[:, None]
    multiply_out(rows[1:])
    return rows


def noise_in_products(noise: Array, first: Array, second: float) -> tuple[Array, Array]:
    """What noise adds to the summed products of monomials.

    Args:
        noise: (6,) covariance N of the noise of y for a count of one, as ``packed``.
        first: (10,) sum of weight / count times the monomials, over the noisy samples.
        second: sum of weight / count^2.

    Returns:
        (10, 10) L and (10, 10) H: with noise of covariance v N, the sum of weight (1 - exp(-D)) z z^T is v L - v^2 H;
        exact if the weights do not depend on the noise.
    """
    tensor = noise.dot(_HALF_LAPLACIAN).reshape(TERMS * TERMS, TERMS)
    twice = tensor[:, 4:].dot(0.5 * second * noise)  # D of a quadratic monomial is its entry of N
    return tensor.dot(first).reshape(TERMS, TERMS), twice.reshape(TERMS, TERMS)


def curvature_in_products(gram: Array, first: Array, radius: float) -> Array:
    """The second-order share of the covariance of the sum of w z Q, whose first-order share is the information.

    Hermite polynomials of a Gaussian are uncorrelated, so exp(-D) f and exp(-D) g have the covariance of the sum of
    (1/m!) (m-th derivative of f) . (m-th derivative of g). With f = z_j Q, Q = |y|^2 - 1 and noise of variance v in
    every direction the term m = 2 is 2 v^2 tr(P_j P_k), P_j = z_j 1 + (grad z_j) y^T + y (grad z_j)^T; by Euler's
    theorem (grad z_j) . y is z_j times its degree.

    Args:
        gram: (10, 10) sum of w z z^T. first: (10,) sum of (w / count) z.
        radius: v, the mean variance of the noise of y for a count of one.

    Returns:
        (10, 10), to be multiplied by the square of the variance that N is in units of.
    """
    dots = _DOTS.dot(first).reshape(TERMS, TERMS)
    return np.asarray(gram * (0.5 * radius * first[0] / gram[0, 0] * _DEGREES) + radius * dots)


def _half_laplacian() -> Array:
    """(6, 1000): entry (a, (i, j, k)) is the coefficient of N_a z_k in D (z_i z_j)."""
    index = {exponents: k for k, exponents in enumerate(EXPONENTS)}
    tensor = np.zeros((len(PAIRS), TERMS, TERMS, TERMS))
    for i, left in enumerate(EXPONENTS):
        for j, right in enumerate(EXPONENTS):
            product = tuple(a + b for a, b in zip(left, right, strict=True))
            for pair, (a, b) in enumerate(PAIRS):
                factor = 0.5 * product[a] * (product[a] - 1) if a == b else float(product[a] * product[b])
                if factor:
                    rest = list(product)
                    rest[a] -= 1
                    rest[b] -= 1
                    tensor[pair, i, j, index[(rest[0], rest[1], rest[2])]] = factor
    return tensor.reshape(len(PAIRS), -1)


def _gradients() -> Array:
    """(100, 10): entry ((i, j), k) is the coefficient of z_k in (grad z_i) . (grad z_j), which is D (z_i z_j) for N = 1
    less (z_i D z_j + z_j D z_i); D of a square is one."""
    tensor = _HALF_LAPLACIAN[:3].sum(axis=0).reshape(TERMS, TERMS, TERMS).copy()
    for i in range(TERMS):
        for j, exponents in enumerate(EXPONENTS):
            if max(exponents) == 2:
                tensor[i, j, i] -= 1.0
                tensor[j, i, i] -= 1.0
    return np.asarray(tensor.reshape(TERMS * TERMS, TERMS))


_HALF_LAPLACIAN: Final = _half_laplacian()
_DOTS: Final = _gradients()
_DEGREE: Final = np.array([float(sum(exponents)) for exponents in EXPONENTS])
_DEGREES: Final = 3.0 + 2.0 * np.add.outer(_DEGREE, _DEGREE) + 2.0 * np.multiply.outer(_DEGREE, _DEGREE)
