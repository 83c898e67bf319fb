"""The textbook ellipsoid fit: algebraic least squares under a constraint that only ellipsoids can meet.

Q. Li and J. G. Griffiths, "Least squares ellipsoid specific fitting", Geometric Modeling and Processing, 2004.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rig.arrays import Array

#: 4 J - I^2 of the quadric's leading coefficients as a quadratic form, k = 4; it is positive for ellipsoids only.
_CONSTRAINT: Final = np.zeros((6, 6))
_CONSTRAINT[:3, :3] = 1.0 - 2.0 * np.eye(3)
_CONSTRAINT[3:, 3:] = -4.0 * np.eye(3)
_INVERSE: Final = np.linalg.inv(_CONSTRAINT)


def fit(readings: Array) -> tuple[Array, Array]:
    """The ellipsoid of readings (n, 3): matrix (3, 3) and centre (3,) with |matrix @ (reading - centre)| = 1.

    Raises:
        numpy.linalg.LinAlgError: there is none.
    """
    x, y, z = readings.T
    design = np.stack([x * x, y * y, z * z, 2 * y * z, 2 * x * z, 2 * x * y, 2 * x, 2 * y, 2 * z, np.ones_like(x)])
    scatter = design @ design.T
    mixed = np.linalg.solve(scatter[6:, 6:], scatter[6:, :6])
    values, vectors = np.linalg.eig(_INVERSE @ (scatter[:6, :6] - scatter[:6, 6:] @ mixed))
    leading = vectors[:, np.argmax(values.real)].real
    rest = -mixed @ leading
    a, b, c, f, g, h = leading
    form = np.array([[a, h, g], [h, b, f], [g, f, c]])
    centre = -np.linalg.solve(form, rest[:3])
    level = -(rest[3] + rest[:3] @ centre)
    lengths, axes = np.linalg.eigh(form / level)
    if lengths[0] <= 0.0:
        raise np.linalg.LinAlgError("the quadric is no ellipsoid")
    return (axes * np.sqrt(lengths)) @ axes.T, centre
