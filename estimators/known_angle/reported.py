"""From tangent coordinates to what a calibration reports: angles, unit vectors and their covariance.

A direction can be told wherever the poses tell it; its two angles cannot near the pole of the angles, the z axis, where
the azimuth (gamma, psi) loses its meaning and the elevation (beta, phi) its normal distribution.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from estimators.known_angle.model import Method, SensorParameters, columns_of_channels, parameter_names
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


@dataclass(frozen=True)
class _Direction:
    """What to call a unit vector, its angles and the pole of these; and where its tangent coordinates stand."""

    name: str
    elevation: str
    azimuth: str
    label: str
    pole: str
    first: int


def report(parameters: SensorParameters, covariance: Array, method: Method) -> Reported:
    """Propagate the covariance (p, p) of ``SensorParameters.jacobian``'s coordinates, to first order.

    Where the pole lies within the 95 % region of a direction, the error of the elevation is one of length (Rayleigh),
    not normal; its standard deviation is then widened so that 1.96 of them hold 95 %.
    """
    names = parameter_names(method)
    p = len(names)
    values = np.empty(p)
    to_angles = np.zeros((p, p))
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
    blocks = np.stack([covariance[d.first : d.first + 2, d.first : d.first + 2] for d in directions])
    one, other, mixed = blocks[:, 0, 0], blocks[:, 1, 1], blocks[:, 0, 1]
    largest = np.sqrt(0.5 * (one + other) + np.hypot(0.5 * (one - other), mixed))  # eigenvalue of each block
    elevation_std = np.sqrt(np.einsum("da,dab,db->d", along, blocks, along))
    across_std = np.sqrt(np.einsum("da,dab,db->d", across, blocks, across))
    near_pole = cos_e < RAYLEIGH_95 * largest
    widened = np.where(near_pole, RAYLEIGH_95 / NORMAL_95 * largest, elevation_std)
    with np.errstate(divide="ignore", invalid="ignore"):
        azimuth_std = np.degrees(across_std / cos_e)
        factor = np.where(elevation_std > 0.0, widened / elevation_std, 1.0)
    distance = np.degrees(np.arcsin(np.minimum(cos_e, 1.0)))
    for i, direction in enumerate(directions):
        first, second = direction.first, direction.first + 1
        columns = slice(first, second + 1)
        values[first], values[second] = elevation[i], azimuth[i]
        if near_pole[i]:
            name = direction.elevation.removesuffix("_deg")
            warnings.append(
                f"{name}: {direction.label} lies {distance[i]:.2g} deg from {direction.pole}, within its uncertainty:"
                f" the standard deviation of {name} is widened to hold 95 %; use the vector"
            )
        if np.degrees(widened[i]) <= ANGLE_LIMIT_DEG:
            to_angles[first, columns] = np.degrees(factor[i] * along[i])
        else:
            untold[direction.elevation] = _reason(direction, distance[i], float(np.degrees(widened[i])))
        if azimuth_std[i] <= ANGLE_LIMIT_DEG:
            to_angles[second, columns] = np.degrees(across[i] / cos_e[i])
        else:
            untold[direction.azimuth] = _reason(direction, distance[i], float(azimuth_std[i]))
    reported = to_angles @ covariance @ to_angles.T
    lost = [names.index(name) for name in untold]
    reported[lost] = np.nan
    reported[:, lost] = np.nan
    vector_values, to_vectors = _vectors(parameters, method, vectors, bases)
    return Reported(
        names,
        values,
        reported,
        untold,
        _vector_names(method),
        vector_values,
        to_vectors @ covariance @ to_vectors.T,
        tuple(warnings),
    )


@cache
def _directions(method: Method) -> tuple[tuple[_Direction, ...], list[int]]:
    """All unit vectors, in the order of the parameters: what they are called; and their rows in axes, then fields."""
    found: list[_Direction] = []
    rows: list[int] = []
    for k, start, of_field in columns_of_channels(method):
        n = k + 1
        found.append(
            _Direction(f"axis{n}", f"beta{n}_deg", f"gamma{n}_deg", f"axis {n}", "the tool's z axis", start + 2)
        )
        rows.append(k)
        if method == "separate" or k == 2:
            own = str(n) if method == "separate" else ""
            label = f"the field of axis {n}" if own else "the field"
            first = of_field.start
            found.append(_Direction(f"field{own}", f"phi{own}_deg", f"psi{own}_deg", label, "the base z axis", first))
            rows.append(3 + k)
    return tuple(found), rows


@cache
def _vector_names(method: Method) -> tuple[str, ...]:
    """The parameters with unit vectors in place of angles."""
    names: list[str] = []
    for direction in _directions(method)[0]:
        if direction.name.startswith("axis"):
            names += [f"sensitivity{direction.name[4:]}", f"offset{direction.name[4:]}"]
        names += [f"{direction.name}_{component}" for component in "xyz"]
    return tuple(names)


def _vectors(parameters: SensorParameters, method: Method, vectors: Array, bases: Array) -> tuple[Array, Array]:
    """Values (v,) and derivatives (v, p) of ``_vector_names``."""
    size = len(_vector_names(method))
    values, derivative = np.empty(size), np.zeros((size, len(parameter_names(method))))
    row = 0
    numbers = iter(range(3))
    for direction, vector, basis in zip(_directions(method)[0], vectors, bases, strict=True):
        first = direction.first
        if direction.name.startswith("axis"):
            k = next(numbers)
            values[row], values[row + 1] = parameters.sensitivity[k], parameters.offset[k]
            derivative[row, first - 2], derivative[row + 1, first - 1] = parameters.scales[k]
            row += 2
        values[row : row + 3] = vector
        derivative[row : row + 3, first : first + 2] = basis.T
        row += 3
    return values, derivative


def _reason(direction: _Direction, distance_deg: float, std_deg: float) -> str:
    amount = f"{std_deg:.2g} deg" if std_deg < 180.0 else "over 180 deg"
    return (
        f"{direction.label} lies {distance_deg:.2g} deg from {direction.pole}: standard deviation {amount}, and a"
        f" linear interval does not hold beyond {ANGLE_LIMIT_DEG:g} deg; use the vector"
    )
