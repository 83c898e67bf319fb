"""What follows from the directions found: the angles between axes, and whether separate fits agree on one field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.known_angle.model import Method, SensorParameters, columns_of_channels
from rig.arrays import Array
from rig.directions import tangent_basis

_PAIRS = ((0, 1), (0, 2), (1, 2))
_LEFT, _RIGHT = np.array(_PAIRS).T
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # of a vector product's factors


def angles_between(parameters: SensorParameters, covariance: Array, method: Method) -> dict[str, tuple[float, float]]:
    """The angle between each pair of axes and its standard deviation [deg], as ``1-2``, ``1-3``, ``2-3``.

    The standard deviation is NaN where the axes are parallel.

    Args:
        parameters: the estimate.
        covariance: (p, p) in the coordinates of ``SensorParameters.jacobian``.
        method: of the fit.
    """
    first = [start + 2 for _, start, _ in columns_of_channels(method)]
    bases, axes = parameters.bases[0], parameters.axes
    left, right = axes[_LEFT], axes[_RIGHT]
    across = left[:, _NEXT] * right[:, _LAST] - left[:, _LAST] * right[:, _NEXT]
    sine, cosine = np.sqrt((across * across).sum(axis=1)), (left * right).sum(axis=1)
    gradient = np.zeros((3, len(covariance)))
    for row, (i, j) in enumerate(_PAIRS):
        gradient[row, first[i] : first[i] + 2] = bases[i] @ axes[j]
        gradient[row, first[j] : first[j] + 2] = bases[j] @ axes[i]
    spread = np.sqrt(((gradient @ covariance) * gradient).sum(axis=1))
    angle = np.degrees(np.arctan2(sine, cosine))
    std = np.degrees(np.where(sine > 1e-9, spread / np.maximum(sine, 1e-9), np.nan))
    return {f"{i + 1}-{j + 1}": (float(angle[row]), float(std[row])) for row, (i, j) in enumerate(_PAIRS)}


@dataclass(frozen=True, eq=False)
class CommonField:
    """One field direction from three separate fits, and whether they agree: the paper's check of model and data.

    Attributes:
        vector: (3,) unit vector, base frame. covariance: (3, 3) of it.
        chi_square: of the three against it, with ``degrees_of_freedom`` 4.
    """

    vector: Array
    covariance: Array
    chi_square: float
    degrees_of_freedom: int


def common_field(parameters: SensorParameters, covariance: Array) -> CommonField:
    """The direction that three separately fitted ones are best explained by, weighted by their precision.

    Args:
        parameters: of a separate fit.
        covariance: (18, 18) in the coordinates of ``SensorParameters.jacobian``.
    """
    bases = parameters.bases[1]
    precisions = [np.linalg.inv(covariance[columns, columns]) for _, _, columns in columns_of_channels("separate")]
    vector = parameters.fields.sum(axis=0)
    vector = np.asarray(vector / np.linalg.norm(vector))
    spread: Array = np.eye(2)
    basis, chi_square = tangent_basis(vector), 0.0
    for _ in range(4):  # Gauss-Newton on the sphere: quadratic, as the three lie close together
        basis = tangent_basis(vector)
        normal, right, chi_square = np.zeros((2, 2)), np.zeros(2), 0.0
        for own, field, precision in zip(bases, parameters.fields, precisions, strict=True):
            between = own @ basis.T
            error = own @ (field - vector)
            normal += between.T @ precision @ between
            right += between.T @ precision @ error
            chi_square += float(error @ precision @ error)
        spread = np.asarray(np.linalg.inv(normal))
        vector = vector + (spread @ right) @ basis
        vector = np.asarray(vector / np.linalg.norm(vector))
    return CommonField(vector, basis.T @ spread @ basis, chi_square, 4)
