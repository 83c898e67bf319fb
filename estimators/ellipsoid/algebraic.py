"""A first ellipsoid from products of monomials alone, without a start."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from estimators._small import eigh, solve
from estimators.ellipsoid.monomials import FREE, TERMS, multiply_out
from estimators.ellipsoid.shape import Ellipsoid, Quadric
from rig.arrays import Array

_UNIT: Final = np.eye(3)
#: The inverse of Li and Griffiths' constraint 4 J - I^2 > 0, in monomials x^2, y^2, z^2, xy, xz, yz.
_LI_GRIFFITHS: Final = np.array(
    [
        [0.0, 0.5, 0.5, 0.0, 0.0, 0.0],
        [0.5, 0.0, 0.5, 0.0, 0.0, 0.0],
        [0.5, 0.5, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
    ]
)


def first_ellipsoid(readings: Array, parameters: int, counts: Array | None = None) -> Ellipsoid | None:
    """An ellipsoid near the best one, by a direct solution; None if the readings lie on none.

    The plain algebraic fit with a constant of one about the mean of the readings, which lies inside; where noise makes
    that another quadric, the constrained one.

    Args:
        readings: (n, 3) [recorded unit].
        parameters: 6 or 9.
        counts: (n,) how many samples each reading is the mean of.
    """
    n = len(readings)
    rows = np.empty((TERMS, n))
    rows[0] = 1.0
    away = rows[1:4]
    away[:] = readings.T
    middle = np.add.reduce(away, axis=1) / n if counts is None else away @ counts / counts.sum()
    away -= middle[:, None]
    spread = math.sqrt(np.vdot(away, away) / n)
    if not spread > 0.0:
        return None
    frame = Ellipsoid(middle, _UNIT / spread, _UNIT * spread)
    away /= spread
    multiply_out(rows[1:])
    gram = rows @ rows.T if counts is None else (rows * counts) @ rows.T
    used = slice(0, FREE[parameters].stop)
    gram = gram[used, used]
    plain = solve(gram[1:, 1:], gram[1:, 0])
    found = None if plain is None else Quadric.of(frame, -1.0, plain)
    if found is None and parameters == 9:
        coefficients = constrained(gram)
        found = Quadric.of(frame, float(coefficients[0]), coefficients[1:])
    return None if found is None else found.ellipsoid


def adjusted(gram: Array, noise: Array) -> Array:
    """The coefficients c with (gram - s noise) c = 0 for the smallest s > 0: the noise variance is found with them.

    To second order in the noise the adjusted least squares of Markovsky et al. with unknown variance, which is
    "HyperLS" of Kanatani and Rangarajan, "Hyper least squares fitting of circles and ellipses" (2011).

    Args:
        gram: (p, p) summed products. noise: (p, p) what noise of unit variance adds to them.
    """
    values, vectors = eigh(gram)
    # Without noise the smallest eigenvalue is rounding, of either sign.
    root = vectors / np.sqrt(np.maximum(values, 1e-15 * values[-1]))
    inner = eigh(root.T @ noise @ root)[1][:, -1]
    return np.asarray(root @ inner)


def constrained(gram: Array) -> Array:
    """The ellipsoid-specific fit of Li and Griffiths, "Least squares ellipsoid specific fitting" (2004).

    Always an ellipsoid, but biased by noise; a start where the plain fit is another quadric.
    """
    quadratic, rest = slice(4, 10), slice(0, 4)
    back = np.linalg.lstsq(gram[rest, rest], gram[rest, quadratic], rcond=None)[0]
    reduced = gram[quadratic, quadratic] - gram[quadratic, rest] @ back
    values, vectors = np.linalg.eig(_LI_GRIFFITHS @ reduced)
    leading = np.real(vectors[:, np.argmax(np.real(values))])
    return np.concatenate([-back @ leading, leading])
