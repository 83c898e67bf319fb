"""How much of the sphere of directions has been seen, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from estimators.coverage.cells import SphereCells
from estimators.coverage.direction_names import direction_name, direction_names
from rig.arrays import Array, Rows
from rig.errors import RigError

#: Numbers of cells to choose from, 59 to 16 degrees wide. No cell lies across the equator, so that a hemisphere is half
#: of them.
CELLS: Final = (12, 32, 64, 106, 162)
#: Cells are at least this many times as wide as nine of ten directions are from their nearest one: directions drawn
#: evenly from the sphere then leave a tenth of the cells empty, and poses that come in pairs do not count as dense.
_SPACINGS: Final = 1.65
_MOST_OF_THEM: Final = 0.9
#: In which the largest hole is looked for: cells of 4.1 degrees.
_FINE_CELLS: Final = 2500
#: Of more directions than twice this, every k-th is taken for the hole.
_MOST_POINTS: Final = 5_000


@dataclass(frozen=True, eq=False)
class Coverage:
    """Which directions were seen.

    Attributes:
        cells: of equal area. counts: (N,) directions in each.
        hole_deg: angle from ``hole`` to the nearest direction that was seen [deg], to about 2 degrees: half the
            diameter of the largest empty circle. hole: (3,) unit vector to its middle. Unlike the share they do not
            depend on the size of cells.
    """

    cells: SphereCells
    counts: Rows
    hole_deg: float
    hole: Array

    @property
    def share(self) -> float:
        """The share of the sphere that was seen: of cells with a direction in them."""
        return float((self.counts > 0).mean())

    @property
    def missing(self) -> Array:
        """(m, 3) unit vectors to the middles of the empty cells."""
        return np.asarray(self.cells.centres[self.counts == 0])

    @property
    def missing_names(self) -> tuple[str, ...]:
        """The empty cells by the 26 directions of a cube, those with the most cells first."""
        names = direction_names(self.missing)
        found = sorted(set(names), key=lambda name: (-names.count(name), len(name), name))
        return tuple(found)

    def __str__(self) -> str:
        """One line."""
        text = f"{100.0 * self.share:.0f} % of {self.cells.count} equal cells seen"
        hole = f"the largest hole is {2.0 * self.hole_deg:.0f} deg wide, about {direction_name(self.hole)}"
        if not self.missing_names:
            return f"{text}; {hole}"
        shown = self.missing_names[:6]
        more = f" and {len(self.missing_names) - len(shown)} more" if len(self.missing_names) > len(shown) else ""
        return f"{text}; missing about {', '.join(shown)}{more}; {hole}"

    def to_json(self) -> dict[str, Any]:
        """What a calibration's quality holds of it."""
        return {
            "share": self.share,
            "cells": self.cells.count,
            "hole_deg": self.hole_deg,
            "hole": [float(value) for value in self.hole],
            "missing": [[round(float(value), 4) for value in vector] for vector in self.missing],
            "missing_names": list(self.missing_names),
        }


def cells_for(count: int, each: int) -> int:
    """The most of ``CELLS`` that ``count`` directions fill with ``each`` in each on average; the fewest if none."""
    return max((number for number in CELLS if number * each <= count), default=CELLS[0])


def _by_spacing(vectors: Array, fine: SphereCells) -> int:
    """The most of ``CELLS`` that are wide enough for the spacing of vectors (n, 3), one in each of the fine cells."""
    _, rows = np.unique(fine.number(vectors), return_index=True)
    if len(rows) < 2:
        return CELLS[0]
    apart, _ = cKDTree(vectors[rows]).query(vectors[rows], k=2)
    width = np.degrees(_SPACINGS * 2.0 * np.arcsin(0.5 * float(np.quantile(apart[:, 1], _MOST_OF_THEM))))
    return max((number for number in CELLS if SphereCells.of(number).width_deg >= width), default=CELLS[0])


def coverage(directions: ArrayLike, cells: int | None = None) -> Coverage:
    """Count directions in cells of equal area.

    Args:
        directions: (n, 3) unit vectors of the field in the sensor's frame; zero vectors are left out.
        cells: how many; None: one of ``CELLS``, by how close together the directions are.

    Raises:
        RigError: not (n, 3), not finite, none but zero vectors, or fewer than two cells.
    """
    vectors = np.asarray(directions, dtype=float)
    if vectors.ndim != 2 or vectors.shape[1] != 3 or not np.isfinite(vectors.sum()):
        raise RigError(f"directions: found an array of shape {vectors.shape}, expected (n, 3) finite numbers")
    lengths = np.einsum("ij,ij->i", vectors, vectors)
    if not (lengths > 0.0).all():
        vectors = vectors[lengths > 0.0]
    if not len(vectors):
        raise RigError("directions: found none, expected one or more")
    fine = SphereCells.of(_FINE_CELLS)
    some = vectors[:: max(1, len(vectors) // _MOST_POINTS)]
    tree = cKDTree(some)
    distance, _ = tree.query(fine.centres)
    number = cells or _by_spacing(some, fine)
    coarse = SphereCells.of(number)
    counts = np.bincount(coarse.number(vectors), minlength=number)
    deepest = int(np.argmax(distance))
    angle = 2.0 * np.degrees(np.arcsin(min(1.0, 0.5 * float(distance[deepest]))))
    return Coverage(coarse, counts, float(angle), fine.centres[deepest])
