"""Equal-area cells of the sphere as polygons on a map."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from matplotlib.collections import PolyCollection

from estimators.coverage import SphereCells
from rig.arrays import Array
from scenarios.colours import GREY

_STEP: Final = np.radians(4.0)  # of a polygon's edge, which is curved on the map


def outlines(cells: SphereCells, numbers: Iterable[int]) -> tuple[list[Array], list[int]]:
    """Cells as polygons in azimuth, from -pi to pi, and z; one that lies across +-pi is two.

    Args:
        cells: the partition.
        numbers: of the cells wanted.

    Returns:
        Polygons (m, 2) of azimuth [rad] and z, and the number of the cell of each.
    """
    polygons: list[Array] = []
    owners: list[int] = []
    for number in numbers:
        low, high, begin, end = cells.limits(int(number))
        for first, last in _wrapped(begin, end):
            along = np.linspace(first, last, max(2, int(np.ceil((last - first) / _STEP)) + 1))
            up = np.sin(np.linspace(np.arcsin(low), np.arcsin(high), max(2, int(np.ceil((high - low) / _STEP)) + 1)))
            polygons.append(
                np.concatenate(
                    [
                        np.stack([along, np.full_like(along, low)], axis=1),
                        np.stack([np.full_like(up, last), up], axis=1),
                        np.stack([along[::-1], np.full_like(along, high)], axis=1),
                        np.stack([np.full_like(up, first), up[::-1]], axis=1),
                    ]
                )
            )
            owners.append(int(number))
    return polygons, owners


def on_map(polygons: Iterable[Array]) -> list[Array]:
    """From azimuth and z to azimuth and elevation [rad]."""
    return [np.stack([shape[:, 0], np.arcsin(np.clip(shape[:, 1], -1.0, 1.0))], axis=1) for shape in polygons]


def unseen(shapes: list[Array]) -> PolyCollection:
    """The shading of cells that nothing was seen in."""
    return PolyCollection(shapes, facecolor=GREY, edgecolor="white", linewidth=0.4, alpha=0.35, zorder=0.5)


def _wrapped(begin: float, end: float) -> list[tuple[float, float]]:
    """An interval of azimuth within 0 to 2 pi as one or two within -pi to pi."""
    if end <= np.pi + 1e-12:
        return [(begin, min(end, np.pi))]
    if begin >= np.pi - 1e-12:
        return [(begin - 2.0 * np.pi, end - 2.0 * np.pi)]
    return [(begin, np.pi), (-np.pi, end - 2.0 * np.pi)]
