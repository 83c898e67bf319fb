"""Residuals by the direction of the field: a model that misses something misses it from somewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.special import chdtrc, fdtrc

from estimators.coverage.cells import SphereCells
from estimators.coverage.direction_names import direction_name
from estimators.coverage.seen import cells_for
from estimators.goodness.residuals import Residuals
from rig.arrays import Array, Rows

_READINGS_A_CELL: Final = 4
_FEWEST_CELLS: Final = 6


@dataclass(frozen=True, eq=False)
class ByDirection:
    """The mean residual in each cell of the sphere.

    Attributes:
        cells: of equal area. counts: (N,) readings in each.
        mean: (N, k) mean residual [of the residuals], and score: (N, k) the same in its standard errors, by the scatter
            within cells; NaN in empty cells.
        chi_square: (N,) of each cell's k means against the scatter within cells; NaN in empty cells.
        value, degrees_of_freedom: of all cells together, against the scatter within them: F(degrees, within).
        p_value: of as much or more. worst_p_value: of the worst cell alone, for as many cells as there are.
    """

    cells: SphereCells
    counts: Rows
    mean: Array
    score: Array
    chi_square: Array
    value: float
    degrees_of_freedom: float
    p_value: float
    worst_p_value: float

    @property
    def worst(self) -> int:
        """The number of the cell that stands out most."""
        return int(np.nanargmax(self.chi_square))

    @property
    def worst_name(self) -> str:
        """Where that is."""
        return direction_name(self.cells.centres[self.worst])

    def to_json(self) -> dict[str, Any]:
        """A JSON object: the test, and the worst cell."""
        return {
            "cells": self.cells.count,
            "chi_square": self.value,
            "degrees_of_freedom": self.degrees_of_freedom,
            "p_value": self.p_value,
            "worst": {
                "direction": [float(value) for value in self.cells.centres[self.worst]],
                "name": self.worst_name,
                "readings": int(self.counts[self.worst]),
                "mean_residual": [float(value) for value in self.mean[self.worst]],
                "p_value": self.worst_p_value,
            },
        }


def by_direction(residuals: Residuals) -> ByDirection | None:
    """Hold the mean residuals of cells against the scatter within them (analysis of variance).

    The noise level thus cancels: only its distribution over directions is tested. What the fit has already taken out of
    the means is taken off the degrees of freedom: offsets whole, and what is linear (quadratic) in the direction as far
    as it varies between cells of width w and not within: 1 - w^2/6 (1 - w^2/2) of it.

    There are as many cells as the readings fill, one of ``estimators.coverage.seen.CELLS``.

    Returns:
        None where there are fewer than 24 readings.
    """
    n, k = residuals.values.shape
    number = cells_for(n, _READINGS_A_CELL)
    if n < _READINGS_A_CELL * min(number, _FEWEST_CELLS):
        return None
    partition = SphereCells.of(number)
    cell = partition.number(residuals.directions)
    counts = np.bincount(cell, minlength=number)
    z = residuals.standardised
    sums = np.stack([np.bincount(cell, column, number) for column in z.T], axis=1)
    filled = counts > 0
    occupied = int(filled.sum())
    between = np.full(number, np.nan)
    between[filled] = np.square(sums[filled]).sum(axis=1) / counts[filled]
    removed = _removed(residuals, partition)
    freedom = occupied * k - removed
    inner = (n - occupied) * k - (residuals.parameters - removed)
    if freedom < 1.0 or inner < 1.0:
        return None
    within = (float(np.square(z).sum()) - float(np.nansum(between))) / inner
    within = max(within, np.finfo(float).tiny)
    chi_square = between / within
    value = float(np.nansum(chi_square))
    mean, score = np.full((number, k), np.nan), np.full((number, k), np.nan)
    totals = np.stack([np.bincount(cell, column, number) for column in residuals.values.T], axis=1)
    mean[filled] = totals[filled] / counts[filled, None]
    score[filled] = sums[filled] / np.sqrt(within * counts[filled, None])
    return ByDirection(
        partition,
        counts,
        mean,
        score,
        chi_square,
        value,
        freedom,
        float(fdtrc(freedom, inner, value / freedom)),
        min(1.0, occupied * float(chdtrc(k, float(np.nanmax(chi_square))))),
    )


def _removed(residuals: Residuals, cells: SphereCells) -> float:
    """Degrees of freedom that the fit has taken from the cells' means."""
    square = 4.0 * np.pi / cells.count
    linear, quadratic = 1.0 - square / 6.0, max(0.0, 1.0 - square / 2.0)
    if len(residuals.names) == 3:
        return 3.0 * (1.0 + 3.0 * linear)  # each channel: offset, and sensitivity and axis, linear in the direction
    return 3.0 * linear + (residuals.parameters - 3.0) * quadratic  # the centre, and the quadratic form
