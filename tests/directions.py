"""Directions that tests draw, or step through."""

from __future__ import annotations

from itertools import product

import numpy as np

from rig.arrays import Array

#: The 26 directions to the faces, edges and corners of a cube.
CUBE = np.array([row for row in product((-1.0, 0.0, 1.0), repeat=3) if any(row)])
CUBE /= np.linalg.norm(CUBE, axis=1)[:, None]


def unit_vectors(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) directions, evenly distributed."""
    vectors = rng.standard_normal((count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def spread(count: int, seed: int) -> Array:
    """The same from a seed."""
    return unit_vectors(np.random.default_rng(seed), count)
