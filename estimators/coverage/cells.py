"""The sphere cut into cells of equal area.

Two polar caps and bands between them, each cut evenly in azimuth; a band's number of cells follows its area, and its
limits in z are then such that all cells have exactly the same area, which on a sphere is the same step in z times
azimuth (Archimedes). The numbers are those of the recursive zonal partition of P. Leopardi, "A partition of the unit
sphere into regions of equal area and small diameter", Electronic Transactions on Numerical Analysis 25 (2006): cells
are about as wide as high, so that there are no slivers at the poles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array, Rows
from rig.errors import RigError


@dataclass(frozen=True, eq=False)
class SphereCells:
    """Equal cells, numbered from the +z pole down, and by azimuth within a band.

    Attributes:
        count: N.
        z: (b + 1,) limits of the bands, from 1 down to -1.
        around: (b,) cells of each band; they begin at azimuth zero.
        first: (b,) number of each band's first cell.
    """

    count: int
    z: Array
    around: Rows
    first: Rows

    @classmethod
    @lru_cache(maxsize=16)
    def of(cls, count: int) -> Self:
        """A partition into ``count`` cells.

        Raises:
            RigError: fewer than two.
        """
        if count < 2:
            raise RigError(f"cells: found {count}, expected 2 or more")
        if count == 2:
            around = np.array([1, 1])
        else:
            side = np.sqrt(4.0 * np.pi / count)
            cap = np.arccos(1.0 - 2.0 / count)
            bands = max(1, round((np.pi - 2.0 * cap) / side))
            limits = np.linspace(cap, np.pi - cap, bands + 1)
            wanted = 0.5 * count * -np.diff(np.cos(limits))
            around = np.diff(np.rint(np.cumsum(np.concatenate([[0.0], wanted])))).astype(np.intp)
            around = np.concatenate([[1], around, [1]])
        ends = np.cumsum(around)
        z = np.concatenate([[1.0], 1.0 - 2.0 * ends / count])
        return cls(count, z, around, ends - around)

    @property
    def width_deg(self) -> float:
        """The side of a square as large as a cell [deg]."""
        return float(np.degrees(np.sqrt(4.0 * np.pi / self.count)))

    def number(self, directions: ArrayLike) -> Rows:
        """The cell (n,) that each direction lies in.

        Args:
            directions: (n, 3) unit vectors.
        """
        x, y, z = np.asarray(directions, dtype=float).T
        band = np.searchsorted(-self.z[1:-1], -z, side="right")
        around = self.around[band]
        azimuth = np.arctan2(y, x)
        azimuth *= 0.5 / np.pi
        azimuth += azimuth < 0.0  # [0, 1]: one itself by rounding
        return np.asarray(self.first[band] + np.minimum((azimuth * around).astype(np.intp), around - 1))

    @property
    def centres(self) -> Array:
        """(N, 3) unit vectors to the middle of each cell; those of the caps are the poles."""
        z = 0.5 * (self.z[1:] + self.z[:-1])
        if len(self.around) > 2:
            z[0], z[-1] = 1.0, -1.0
        band = np.repeat(np.arange(len(self.around)), self.around)
        azimuth = 2.0 * np.pi * (np.arange(self.count) - self.first[band] + 0.5) / self.around[band]
        radius = np.sqrt(1.0 - np.square(z[band]))
        return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z[band]], axis=1)

    def limits(self, cell: int) -> tuple[float, float, float, float]:
        """Lowest and highest z, and first and last azimuth [rad, from 0 to 2 pi], of a cell."""
        band = int(np.searchsorted(self.first, cell, side="right")) - 1
        step = 2.0 * np.pi / float(self.around[band])
        place = cell - int(self.first[band])
        return float(self.z[band + 1]), float(self.z[band]), step * place, step * (place + 1)
