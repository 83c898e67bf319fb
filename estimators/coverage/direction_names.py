"""The directions from which a sensor has seen the field, in its own frame, and what they are called."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array
from rig.errors import RigError

#: The axes, the diagonals of their planes and the space diagonals: the 26 neighbours of a cube.
_NEIGHBOURS: Final = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)], dtype=float
)
_UNIT_NEIGHBOURS: Final = _NEIGHBOURS / np.sqrt(np.square(_NEIGHBOURS).sum(axis=1))[:, None]
_NAMES: Final = tuple(
    "".join(f"{'+' if step > 0 else '-'}{axis}" for step, axis in zip(row, "xyz", strict=True) if step)
    for row in _NEIGHBOURS.tolist()
)


def direction_name(direction: ArrayLike) -> str:
    """The nearest of the 26 directions of a cube's faces, edges and corners: ``+x``, ``-x+z``, ``+x+y-z``, say.

    Raises:
        RigError: not a direction.
    """
    vector = np.asarray(direction, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise RigError(f"direction: found {vector.tolist()}, expected three numbers, not all zero")
    return direction_names(vector[None])[0]


def direction_names(directions: Array) -> list[str]:
    """``direction_name`` of each of (n, 3) directions."""
    return [_NAMES[number] for number in np.argmax(directions @ _UNIT_NEIGHBOURS.T, axis=1).tolist()]
