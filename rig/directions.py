"""Directions and their two angles: sensor axes by (beta, gamma), fields by (phi, psi); Renk (6), (12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import Array


def direction_from_angles(elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> Array:
    """Unit vectors R_k(azimuth) R_j(elevation) i = (cos a cos e, sin a cos e, -sin e); Renk (6), (12).

    Args:
        elevation_deg: (...) [deg] beta of an axis or phi of a field; +90 points along -z.
        azimuth_deg: (...) [deg] gamma of an axis or psi of a field.

    Returns:
        (..., 3) unit vectors, in frame 6 for axes and in the base frame for fields.
    """
    elevation, azimuth = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack(
        np.broadcast_arrays(
            np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), -np.sin(elevation)
        ),
        axis=-1,
    )


def angles_from_direction(direction: ArrayLike) -> tuple[Array, Array]:
    """The angles of ``direction_from_angles``: elevation in [-90, 90], azimuth in [0, 360) [deg].

    Args:
        direction: (..., 3) vectors of any length above zero.
    """
    vectors = np.asarray(direction, dtype=float)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    elevation = np.degrees(np.arctan2(-z, np.hypot(x, y)))
    azimuth = np.degrees(np.arctan2(y, x)) % 360.0
    return elevation, np.where(azimuth >= 360.0, 0.0, azimuth)  # a tiny negative angle rounds up to 360


def difference_of(name: str, value: float, other: float) -> float:
    """A parameter's value less another one, of angles, "beta1_deg", by the shorter way round: in [-180, 180) [deg]."""
    difference = value - other
    return (difference + 180.0) % 360.0 - 180.0 if name.endswith("_deg") else difference


def elevation_azimuth_basis(direction: ArrayLike) -> Array:
    """Unit vectors (.., 2, 3) along growing elevation and growing azimuth at unit vectors (.., 3).

    At the pole itself the azimuth is the one that ``angles_from_direction`` gives.
    """
    elevation, azimuth = (np.radians(angle) for angle in angles_from_direction(direction))
    zero = np.zeros_like(azimuth)
    along = [-np.sin(elevation) * np.cos(azimuth), -np.sin(elevation) * np.sin(azimuth), -np.cos(elevation)]
    across = [-np.sin(azimuth), np.cos(azimuth), zero]
    return np.stack([np.stack(along, axis=-1), np.stack(across, axis=-1)], axis=-2)


def spiral(count: int, share: float) -> Array:
    """Unit vectors (count, 3) spread evenly from +z down, a Fibonacci lattice.

    Args:
        share: 1 for half a sphere, 2 for all of it.
    """
    index = np.arange(count) + 0.5
    z = 1.0 - share * index / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)


def tangent_basis(direction: ArrayLike) -> Array:
    """Two unit vectors (..., 2, 3) that span the plane at right angles to unit vectors (..., 3).

    The branch-free construction of Duff et al., "Building an orthonormal basis, revisited" (2017): no direction is
    singular, unlike the derivative with respect to the two angles.
    """
    vectors = np.asarray(direction, dtype=float)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    basis = np.empty((*vectors.shape[:-1], 2, 3))
    basis[..., 0, 0], basis[..., 0, 1], basis[..., 0, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    basis[..., 1, 0], basis[..., 1, 1], basis[..., 1, 2] = b, sign + y * y * a, -y
    return basis
