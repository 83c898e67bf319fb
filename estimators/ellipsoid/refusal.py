"""When readings cannot tell the parameters, and what is missing then."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np

from estimators._small import eigh
from estimators.ellipsoid.likelihood import Optimum
from estimators.ellipsoid.monomials import FREE, symmetric, table
from estimators.ellipsoid.used_rows import spread_rows
from rig.arrays import Array
from rig.directions import spiral

#: Noise may make up at most half of what the weakest direction of the information seems to tell.
NOISE_SHARE_LIMIT: Final = 1.0
#: Eigenvalues of the scaled information below this are rounding.
NULL_EIGENVALUE: Final = 1e-11
#: Variance of the directions along the axis along which they vary least: 1/3 over the whole sphere, 1/12 over a
#: hemisphere; this is a cap of 41 deg about the axis, or a band of 7 deg on either side of a great circle. An ellipsoid
#: fitted to less is decided by what the model leaves out, however small its residual.
SPREAD_LIMIT: Final = 0.005
#: Standard deviation of a gain over the mean gain, or of an offset over the reading that the field makes: beyond it the
#: linear covariance does not hold, and a data sheet knows as much.
UNCERTAINTY_LIMIT: Final = 0.1

#: Readings nearer to one another than this, over the distance from their mean, may be of one orientation.
_GROUP: Final = 0.15
#: Readings whose thickness is below this, over their width, lie about a plane.
_FLAT: Final = 0.1
_SAMPLE: Final = 1000
_DIRECTIONS: Final = 500


@dataclass(frozen=True, eq=False)
class Spread:
    """The directions of the field that the readings show, seen from the fitted centre, in the sensor's own frame.

    Attributes:
        sums: (10,) of the monomials of the unit vectors, in the order of ``monomials.EXPONENTS``.
    """

    sums: Array

    @classmethod
    def of_field(cls, field: Array) -> Self:
        """Of fields (n, 3) [any unit]."""
        directions = field / np.linalg.norm(field, axis=1)[:, None]
        return cls(table(directions, np.eye(3), np.zeros(3)).sum(axis=1))

    @cached_property
    def mean(self) -> Array:
        """(3,) of the unit vectors."""
        return np.asarray(self.sums[1:4] / self.sums[0])

    @cached_property
    def covariance(self) -> Array:
        """(3, 3) of the unit vectors."""
        return symmetric(self.sums[4:] / self.sums[0]) - np.outer(self.mean, self.mean)

    @cached_property
    def variances(self) -> Array:
        """(3,) along the axes along which the directions vary least, .., most."""
        return eigh(self.covariance)[0]

    @cached_property
    def least_along(self) -> Array:
        """(3,) the unit vector along which they vary least."""
        return eigh(self.covariance)[1][:, 0]


def problem_of(optimum: Optimum, spread: Spread, readings: Array) -> str | None:
    """Why the readings cannot tell the parameters, in words and with what is missing; None where they can.

    Args:
        optimum: the fit.
        spread: of the directions.
        readings: (n, 3) that were fitted [recorded unit].
    """
    parameters = len(optimum.inverse)
    mean_gain = sum(optimum.ellipsoid.gain.diagonal().tolist()) / 3.0
    most = (UNCERTAINTY_LIMIT * mean_gain) ** 2
    certain = all(variance <= most for variance in optimum.covariance.diagonal().tolist())
    told = optimum.eigenvalues[0] > NULL_EIGENVALUE and optimum.noise_share < NOISE_SHARE_LIMIT
    if told and certain and spread.variances[0] >= SPREAD_LIMIT:
        return None
    if (found := structure(readings, parameters)) is not None:
        return found
    wanted = f"show the sensor more directions, such as the field along {_vector(missing(optimum))} of its own frame"
    if not told:
        return f"a family of ellipsoids fits these readings alike: {wanted}"
    if spread.variances[0] < SPREAD_LIMIT:
        return (
            f"seen from the fitted centre the directions hardly vary along {_vector(spread.least_along)}: variance"
            f" {spread.variances[0]:.2g}, expected {SPREAD_LIMIT:g} or more (1/3 is the whole sphere): {wanted}"
        )
    relative = math.sqrt(optimum.covariance.diagonal().max()) / mean_gain
    return (
        f"these readings and their noise leave a gain or an offset uncertain by {100 * relative:.2g} % of the gain,"
        f" expected {100 * UNCERTAINTY_LIMIT:g} % or less: {wanted}"
    )


def without_ellipsoid(readings: Array, parameters: int) -> str:
    """The same where there is no ellipsoid.

    Args:
        readings: (n, 3) [recorded unit].
        parameters: 6 or 9.
    """
    found = structure(readings, parameters)
    return found or (
        "the readings lie on no ellipsoid, or on too small a part of one to tell which: expected most of them to be of"
        " a field of one magnitude, in directions over more than half of the sphere"
    )


def structure(readings: Array, parameters: int) -> str | None:
    """What the readings alone show to be missing: (n, 3) [recorded unit]; None if that is not obvious."""
    pick = spread_rows(len(readings), _SAMPLE)
    sample = readings if pick is None else readings[pick]
    centred = sample - sample.mean(axis=0)
    width, middle, thickness = np.linalg.svd(centred / np.sqrt(len(sample)), compute_uv=False)
    if not width > 1e-12 * float(np.abs(sample).max()):
        return "all readings are equal: turn the sensor"
    groups = _groups(centred, _GROUP * float(np.sqrt(width**2 + middle**2 + thickness**2)), parameters)
    if groups < parameters:
        return (
            f"the readings are of {groups} distinct direction{'s' if groups > 1 else ''}, expected at least"
            f" {parameters} for {parameters} parameters, well spread: a residual of zero is not accuracy; show the"
            " sensor the field along +x, -x, +y, -y, +z and -z and between neighbours"
        )
    still = np.flatnonzero(centred.std(axis=0) <= 1e-9 * width)
    if still.size:
        return f"channel {still[0] + 1} reads the same in every orientation, expected it to see the field turn"
    if thickness < _FLAT * width:
        normal = np.linalg.svd(centred, full_matrices=False)[2][2]
        return (
            f"the readings lie about a plane at right angles to {_vector(normal)}: thickness"
            f" {100 * thickness / width:.2g} % of the width: turn the sensor about an axis in that plane as well"
        )
    return None


def missing(optimum: Optimum) -> Array:
    """(3,) the unit vector, in the sensor's own frame, that would tell most of what the readings tell worst."""
    directions = spiral(_DIRECTIONS, 2.0)
    shown = np.abs(optimum.weakest @ table(directions, np.eye(3), np.zeros(3))[FREE[len(optimum.weakest)]])
    return np.asarray(directions[int(np.argmax(shown))])


def _groups(points: Array, radius: float, enough: int) -> int:
    """The number of groups of points (n, 3) further apart than ``radius``, counted up to ``enough``."""
    left = points
    found = 0
    while len(left) and found < enough:
        left = left[np.linalg.norm(left - left[0], axis=1) > radius]
        found += 1
    return found


def _vector(direction: Array) -> str:
    return "(" + ", ".join(f"{value + 0.0:.2f}" for value in direction) + ")"
