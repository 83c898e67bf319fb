"""From tangent coordinates to what a calibration reports: angles, unit vectors and their covariance.

A direction can be told wherever the poses tell it; its two angles cannot near the pole of the angles, the z axis, where
the azimuth (gamma, psi) loses its meaning and the elevation (beta, phi) its normal distribution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from estimators.known_angle.model import (
    Method,
    SensorParameters,
    columns_by_name,
    columns_of_channels,
    parameter_names,
)
from rig.arrays import Array
from rig.directions import angles_from_direction, elevation_azimuth_basis

#: Standard deviation of an angle beyond which its linear interval does not hold [deg].
ANGLE_LIMIT_DEG: Final = 2.0
#: 95 % of a two-dimensional normal error lie within this many standard deviations of its centre (Rayleigh),
RAYLEIGH_95: Final = float(np.sqrt(-2.0 * np.log(0.05)))
#: and 95 % of a one-dimensional one within this many.
NORMAL_95: Final = 1.959963984540054


@dataclass(frozen=True, eq=False)
class Reported:
    """The parameters as they are reported.

    Attributes:
        names: in the order of ``values``.
        values: (p,) S, delta [recorded unit], angles [deg].
        covariance: (p, p) of them; NaN in the rows and columns of what cannot be told.
        untold: name -> why it cannot be told.
        vector_names, vector_values, vector_covariance: the same with the three components of each unit vector in place
            of its two angles: (v,), (v, v), of rank p. Whatever is reported at all can be told in this form.
        warnings: what the numbers alone do not say.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    untold: dict[str, str]
    vector_names: tuple[str, ...]
    vector_values: Array
    vector_covariance: Array
    warnings: tuple[str, ...]


def report(parameters: SensorParameters, covariance: Array, method: Method) -> Reported:
    """Propagate the covariance (p, p) of ``SensorParameters.jacobian``'s coordinates, to first order.

    Where the pole lies within the 95 % region of a direction, the error of the elevation is one of length (Rayleigh),
    not normal; its standard deviation is then widened so that 1.96 of them hold 95 %.
    """
    names = parameter_names(method)
    values = np.empty(len(names))
    to_angles = np.zeros((len(names), len(names)))
    untold: dict[str, str] = {}
    warnings: list[str] = []
    for k, start, _ in columns_of_channels(method):
        values[start : start + 2] = parameters.sensitivity[k], parameters.offset[k]
        to_angles[start, start], to_angles[start + 1, start + 1] = parameters.scales[k]
    directions, rows = _directions(method)
    vectors = np.concatenate([parameters.axes, parameters.fields])[rows]
    bases = np.concatenate(parameters.bases)[rows]
    elevation, azimuth = angles_from_direction(vectors)
    cos_e = np.hypot(vectors[:, 0], vectors[:, 1])
    # Unit tangents along growing elevation and azimuth, in each basis (d, 2).
    along, across = np.einsum("dai,dei->eda", bases, elevation_azimuth_basis(vectors))
    blocks = np.stack([covariance[columns, columns] for columns in directions.values()])
    one, other, mixed = blocks[:, 0, 0], blocks[:, 1, 1], blocks[:, 0, 1]
    largest = np.sqrt(0.5 * (one + other) + np.hypot(0.5 * (one - other), mixed))  # eigenvalue of each block
    elevation_std = np.sqrt(np.einsum("da,dab,db->d", along, blocks, along))
    across_std = np.sqrt(np.einsum("da,dab,db->d", across, blocks, across))
    near_pole = cos_e < RAYLEIGH_95 * largest
    widened = np.where(near_pole, RAYLEIGH_95 / NORMAL_95 * largest, elevation_std)
    with np.errstate(divide="ignore", invalid="ignore"):
        stds = np.degrees(np.stack([widened, across_std / cos_e], axis=1))
        factor = np.where(elevation_std > 0.0, widened / elevation_std, 1.0)
        turns = np.degrees(np.stack([factor[:, None] * along, across / cos_e[:, None]], axis=1))
    distance = np.degrees(np.arcsin(np.minimum(cos_e, 1.0)))
    for i, (name, columns) in enumerate(directions.items()):
        values[columns] = elevation[i], azimuth[i]
        pole = "the tool's z axis" if name.startswith("axis") else "the base z axis"
        lies = f"{_label(name)} lies {distance[i]:.2g} deg from {pole}"
        if near_pole[i]:
            angle = names[columns.start].removesuffix("_deg")
            warnings.append(
                f"{angle}: {lies}, within its uncertainty: the standard deviation of {angle} is widened to hold 95 %;"
                " use the vector"
            )
        for row, turn, std in zip(range(columns.start, columns.stop), turns[i], stds[i].tolist(), strict=True):
            if std <= ANGLE_LIMIT_DEG:
                to_angles[row, columns] = turn
            else:
                amount = f"{std:.2g} deg" if std < 180.0 else "over 180 deg"
                untold[names[row]] = (
                    f"{lies}: standard deviation {amount}, and a linear interval does not hold beyond"
                    f" {ANGLE_LIMIT_DEG:g} deg; use the vector"
                )
    reported = to_angles @ covariance @ to_angles.T
    lost = [names.index(name) for name in untold]
    reported[lost] = np.nan
    reported[:, lost] = np.nan
    of_vectors = dict(zip(directions, zip(vectors, bases, strict=True), strict=True))
    vector_names = _vector_names(method)
    vector_values, to_vectors = np.empty(len(vector_names)), np.zeros((len(vector_names), len(names)))
    first = 0
    for name, columns in columns_by_name(method).items():
        vector, basis = of_vectors.get(name, (values[columns], to_angles[columns, columns]))
        place = slice(first, first + len(vector))
        vector_values[place], to_vectors[place, columns] = vector, basis.T
        first = place.stop
    return Reported(
        names,
        values,
        reported,
        untold,
        vector_names,
        vector_values,
        to_vectors @ covariance @ to_vectors.T,
        tuple(warnings),
    )


@cache
def _directions(method: Method) -> tuple[Mapping[str, slice], list[int]]:
    """The columns of all unit vectors, in the order of the parameters; and their rows in axes, then fields."""
    found = {name: own for name, own in columns_by_name(method).items() if name.startswith(("axis", "field"))}
    rows = [int(name[-1]) - 1 if name.startswith("axis") else 2 + int(name[5:] or 1) for name in found]
    return found, rows


@cache
def _vector_names(method: Method) -> tuple[str, ...]:
    """The parameters with unit vectors in place of angles."""
    vectors = _directions(method)[0]
    return tuple(
        full
        for name in columns_by_name(method)
        for full in ([f"{name}_{component}" for component in "xyz"] if name in vectors else [name])
    )


def _label(name: str) -> str:
    """``axis 1``, ``the field``, or of separate fits ``the field of axis 1``."""
    if name.startswith("axis"):
        return f"axis {name[4:]}"
    return f"the field of axis {name[5:]}" if name[5:] else "the field"
