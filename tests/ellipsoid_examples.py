"""What the tests of the attitude-free calibration share: a sensor, directions, and the bound, worked out anew."""

from __future__ import annotations

import numpy as np
from directions import unit_vectors

from rig.arrays import Array

GAIN = np.array([[1.40, 0.03, -0.02], [0.03, 1.30, 0.05], [-0.02, 0.05, 1.50]])
OFFSET = np.array([0.1, 0.2, 0.3])
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: The 3DM's accelerometers: 13.4 mV at 1.40 V per g.
NOISE = 0.0134


def gain_of(parameters: int) -> Array:
    return GAIN if parameters == 9 else np.diag(GAIN.diagonal())


def truth(parameters: int) -> Array:
    gain = gain_of(parameters)
    return np.array([*(gain[entry] for entry in ENTRIES[: parameters - 3]), *OFFSET])


def hemisphere(rng: np.random.Generator, count: int) -> Array:
    directions = unit_vectors(rng, count)
    directions[:, 2] = np.abs(directions[:, 2])
    return directions


def cap(rng: np.random.Generator, count: int, half_angle_deg: float) -> Array:
    cosine = rng.uniform(np.cos(np.radians(half_angle_deg)), 1.0, count)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    sine = np.sqrt(1.0 - cosine**2)
    return np.column_stack([sine * np.cos(angle), sine * np.sin(angle), cosine])


def linearised(directions: Array, gain: Array, noise: Array) -> tuple[Array, Array, Array]:
    """What a reading tells where every direction is unknown: |A^-1 (V - b)|, to first order.

    Returns:
        (n, p) its derivatives by gain entries and offsets, -u . A^-1 (dA u + db); (n, 3) those by the reading, A^-1 u;
        (n,) its variance, sum (A^-1 u)_k^2 sigma_k^2.
    """
    inverse = np.linalg.inv(gain)
    normal = directions @ inverse
    diagonal = bool((gain == np.diag(gain.diagonal())).all())
    columns = [
        -(normal[:, i] * directions[:, j] + (normal[:, j] * directions[:, i] if i != j else 0.0))
        for i, j in ENTRIES[: 3 if diagonal else 6]
    ]
    jacobian = np.column_stack([*columns, -normal])
    return jacobian, normal, np.square(normal) @ np.square(np.broadcast_to(noise, 3))


def bound(directions: Array, gain: Array, noise: Array) -> Array:
    """The Cramer-Rao bound of gain entries and offsets."""
    jacobian, _, variance = linearised(directions, gain, noise)
    return np.asarray(np.linalg.inv(jacobian.T @ (jacobian / variance[:, None])))


def li_griffiths(readings: Array) -> Array:
    """The centre by the ellipsoid-specific algebraic fit that is in wide use (Li and Griffiths, 2004)."""
    x, y, z = readings.T
    rows = np.array([x * x, y * y, z * z, 2 * y * z, 2 * x * z, 2 * x * y, 2 * x, 2 * y, 2 * z, np.ones_like(x)])
    gram = rows @ rows.T
    constraint = np.zeros((6, 6))
    constraint[:3, :3] = 1.0 - 2.0 * np.eye(3)
    constraint[3:, 3:] = -4.0 * np.eye(3)
    rest = np.linalg.solve(gram[6:, 6:], gram[6:, :6])
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, gram[:6, :6] - gram[:6, 6:] @ rest))
    a, b, c, f, g, h = np.real(vectors[:, np.argmax(np.real(values))])
    linear = -(rest @ np.array([a, b, c, f, g, h]))[:3]
    return np.asarray(-np.linalg.solve(np.array([[a, h, g], [h, b, f], [g, f, c]]), linear))
