"""The fits of many data sets of one sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from estimators.batch.optimum import Centred, parameters_of, separate, simultaneous
from estimators.batch.parameters import ManyParameters, Uncertainty
from estimators.known_angle.model import (
    PARAMETERS_AT_ONCE,
    Method,
    SensorParameters,
    Weighting,
    check_options,
    sizes_by_name,
)
from estimators.known_angle.refusal import UNCERTAINTY_LIMIT
from rig.arrays import Array, Mask
from rig.errors import RigError
from rig.threads import one_blas_thread

#: Data sets fitted at a time: their matrices stay below some 50 MB.
_BLOCK: Final = 2000


@dataclass(frozen=True, eq=False)
class ManyFits:
    """The optima of m data sets of one sensor, each as of ``SensorFit``.

    Attributes:
        method: of all.
        parameters: the m estimates.
        residual_square: (m, 3) sums of squared residuals [recorded unit squared].
        noise: (m, 3) standard deviation of a reading, given or estimated [recorded unit].
        covariance: (m, p, p) in the coordinates of ``SensorParameters.jacobian``, at the estimates.
        converged: (m,) whether the search has ended in a minimum to its last digits.
        told: (m,) False where ``fit_sensor`` would refuse: the poses cannot determine the parameters, leave them
            uncertain, or another minimum fits alike.
    """

    method: Method
    parameters: ManyParameters
    residual_square: Array
    noise: Array
    covariance: Array
    converged: Mask
    told: Mask

    def __len__(self) -> int:
        """m."""
        return len(self.parameters)

    @property
    def std(self) -> Array:
        """(m, p) standard deviations in tangent coordinates."""
        return np.asarray(np.sqrt(np.einsum("mii->mi", self.covariance)))

    def errors(self, truth: SensorParameters) -> Array:
        """(m, p) truth, one of all or (m,) of each, minus estimate, in the coordinates of the covariance."""
        return self.parameters.errors(truth, self.method)


def fit_many(
    gram: ArrayLike,
    cross: ArrayLike,
    square: ArrayLike,
    count: int | ArrayLike,
    noise: ArrayLike | None = None,
    method: Method = "simultaneous",
    *,
    reference_magnitude: float = 1.0,
    weighting: Weighting = "likelihood",
    field_points: ArrayLike = (0.0, 0.0, -1.0),
) -> ManyFits:
    """Calibrate one sensor from each of m data sets, as ``fit_sensor`` does from one.

    Args:
        gram: (10, 10) of all, or (m, 10, 10): of [vec R, 1], as of ``Statistics``.
        cross: (m, 10, 3) [recorded unit].
        square: (m, 3) sums of V_k^2, or (m, 3, 3) [recorded unit squared].
        count: n of all, or (m,).
        noise: (3,) of all, or (m, 3): standard deviation of a reading [recorded unit]; None: from the residuals.
        method, reference_magnitude, weighting: as of ``fit_sensor``.
        field_points: (3,) of all, or (m, 3).

    Raises:
        RigError: an option is unknown, arrays that do not fit together, or fewer samples than parameters.
    """
    check_options(method, weighting)
    poses, sums, squares = (np.asarray(values, dtype=float) for values in (gram, cross, square))
    m = len(sums)
    if squares.ndim == 3:
        squares = np.einsum("mkk->mk", squares)
    shapes = (poses.shape[-2:], sums.shape, squares.shape)
    if shapes != ((10, 10), (m, 10, 3), (m, 3)) or poses.shape[:-2] not in ((), (m,)):
        raise RigError(
            f"data sets: found gram {poses.shape}, cross {sums.shape}, square {squares.shape}, expected (10, 10) or"
            " (m, 10, 10), (m, 10, 3) and (m, 3)"
        )
    counts = np.broadcast_to(np.asarray(count), (m,))
    if poses.ndim == 2 and np.ptp(counts) > 0:
        raise RigError("data sets: found one gram for different numbers of samples, expected one gram each")
    needed = PARAMETERS_AT_ONCE[method]
    if m and counts.min() < needed:
        raise RigError(f"data sets: found one of {counts.min()} samples, expected at least {needed}")
    sigma = None if noise is None else np.broadcast_to(np.asarray(noise, dtype=float), (m, 3))
    points = np.broadcast_to(np.asarray(field_points, dtype=float), (m, 3))
    table = _Table(poses, sums, squares, counts, sigma, points)
    blocks = [slice(start, start + _BLOCK) for start in range(0, m, _BLOCK)]
    with one_blas_thread():
        parts = [_fit(table.select(rows), method, weighting, reference_magnitude) for rows in blocks]

    def joined(rows: Sequence[ManyFits | ManyParameters], *names: str) -> dict[str, Any]:
        return {name: np.concatenate([getattr(row, name) for row in rows]) for name in names}

    parameters = joined([part.parameters for part in parts], "sensitivity", "offset", "axes", "fields")
    return ManyFits(
        method,
        ManyParameters(reference_magnitude, **parameters),
        **joined(parts, "residual_square", "noise", "covariance", "converged", "told"),
    )


@dataclass(frozen=True, eq=False)
class _Table:
    """The data sets, checked: gram (10, 10) or (m, 10, 10), the rest with m rows."""

    gram: Array
    cross: Array
    square: Array
    count: Array
    noise: Array | None
    points: Array

    def select(self, rows: slice) -> _Table:
        return _Table(
            self.gram if self.gram.ndim == 2 else self.gram[rows],
            self.cross[rows],
            self.square[rows],
            self.count[rows],
            None if self.noise is None else self.noise[rows],
            self.points[rows],
        )


def _fit(table: _Table, method: Method, weighting: Weighting, magnitude: float) -> ManyFits:
    data = Centred.of(table.gram, table.cross, table.square, table.count)
    given = None if table.noise is None else np.maximum(table.noise, data.rounding)
    optimum = simultaneous(data, given, weighting) if method == "simultaneous" else separate(data)
    parameters = parameters_of(optimum, data, magnitude, table.points)
    residual = optimum.mean_square * table.count[:, None]
    per_channel = parameters.information(table.gram)
    assumed = np.ones_like(residual) if weighting == "equal" else optimum.noise if given is None else given
    uncertainty = Uncertainty.of(per_channel, assumed, method)
    noise = given
    if noise is None:
        freedom = np.maximum(table.count[:, None] - uncertainty.leverage, 1.0)
        noise = np.maximum(np.sqrt(residual / freedom), data.rounding)
        if weighting == "likelihood":
            uncertainty = Uncertainty.of(per_channel, noise, method)
    covariance = uncertainty.covariance
    if weighting == "equal":
        covariance = uncertainty.sandwich(per_channel, noise, method)
    channels = 3 if method == "simultaneous" else 1
    told = uncertainty.determined & (np.sqrt(data.variance) > 2.0 * data.rounding).all(axis=1)
    told &= channels * (data.rank + 1) >= PARAMETERS_AT_ONCE[method] + channels
    for size in sizes_by_name(np.einsum("mii->mi", covariance), method).values():
        told &= size <= UNCERTAINTY_LIMIT
    for rivals in optimum.rivals:
        alike, _ = rivals.alike(parameters.fields, covariance, noise, table.count, method)
        told[rivals.row[alike]] = False
    return ManyFits(method, parameters, residual, noise, covariance, optimum.converged, told)
