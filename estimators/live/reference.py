"""What a monitor holds readings against: a calibration, or the estimate so far, and how well it predicts them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from estimators.calibration import SensorCalibration
from estimators.coverage.attitude_free_information import AttitudeFreeInformation, design_rows
from estimators.ellipsoid.fit import EllipsoidFit
from estimators.goodness.residuals import by_magnitude, fitted_parameters, noise_of
from estimators.known_angle.fit import SensorFit
from estimators.known_angle.model import SensorParameters
from estimators.live.estimate import SensorEstimate
from rig.arrays import Array, Mask
from rig.recording import Recording
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm


#: A calibration from n samples of k values predicts new ones with the variance p / (k n) on average, and several times
#: that in directions it has hardly seen.
_SELDOM_SEEN = 4.0
#: The variance of the prediction is worked out for every so many samples: the field does not turn far in between.
_THINNED = 8


@dataclass(frozen=True, eq=False)
class ByRow:
    """Rows in the order of time; a class of its own adds further arrays.

    Attributes:
        t: (n,) time of each row [s].
    """

    t: Array

    def __len__(self) -> int:
        """How many rows."""
        return len(self.t)

    def pick(self, rows: slice | Mask) -> Self:
        """Some of them."""
        return replace(self, **{name: values[rows] for name, values in vars(self).items()})

    def then(self, *others: Self) -> Self:
        """These and the ones after them."""
        parts = (self, *others)
        return replace(self, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(self)})


@dataclass(frozen=True, eq=False)
class Residuals(ByRow):
    """Of some samples.

    Attributes:
        readings: (n, 3) [recorded unit].
        values: (n, k) in standard deviations of a reading, k = 3 channels, or 1, the field's magnitude.
        predicted: (n, k) the variance of the model's own error, in the same units.
        directions: (n, 3) unit vectors of the field in the sensor's frame.
        terms: (n, 10) [vec R, 1]; empty without attitude.
    """

    readings: Array
    values: Array
    predicted: Array
    directions: Array
    terms: Array


@dataclass(frozen=True, eq=False)
class Reference:
    """A model of a sensor's readings.

    Attributes:
        matrix, bias, magnitude: field = matrix @ (reading - bias), of this magnitude.
        noise: (3,) standard deviation of a reading [recorded unit].
        parameters: of the known-angle model; None without attitude.
        covariance: (p, p) of the parameters, in ``jacobian``'s units; None where only ``share`` is known.
        jacobian: (3, 10, p) of the known-angle model; None without attitude.
        share: the mean variance of the prediction, of a reading's.
    """

    matrix: Array
    bias: Array
    magnitude: float
    noise: Array
    parameters: SensorParameters | None
    covariance: Array | None
    jacobian: Array | None
    share: float

    @classmethod
    def of_calibration(cls, own: SensorCalibration, posed: bool) -> Self:
        """From a calibration; ``posed``: the attitude is recorded."""
        known = posed and bool(own.axes) and own.field_direction is not None
        number = len(own.parameters) / (3.0 if known else 1.0)
        return cls(
            own.matrix,
            own.bias,
            own.reference_magnitude,
            noise_of(own),
            fitted_parameters(own) if known else None,
            None,
            None,
            _SELDOM_SEEN * number / max(own.samples, 1),
        )

    @classmethod
    def of_estimate(cls, found: SensorEstimate) -> Self:
        """From what is known so far."""
        fit = found.fit
        if isinstance(fit, SensorFit):
            jacobian = fit.parameters.jacobian(fit.method)
            return cls(
                found.matrix, found.bias, found.magnitude, found.noise, fit.parameters, fit.covariance, jacobian, 0.0
            )
        information = AttitudeFreeInformation.of(found.directions, found.relative_noise, found.counts, fit.parameters)
        assert isinstance(fit, EllipsoidFit)
        return cls(found.matrix, found.bias, found.magnitude, found.noise, None, information.covariance, None, 0.0)

    def residuals(self, batch: Recording, sensor: str, arm: Arm | None) -> Residuals:
        """Of a batch; with its attitude where the reference has one."""
        readings = batch.readings(sensor)
        if self.parameters is None:
            return self._by_magnitude(batch.t, readings)
        terms = np.ones((10, len(batch)))
        with one_blas_thread():
            for rows, block in batch.rotation_blocks(arm):
                terms[:9, rows] = block
            values = readings - (self.parameters.coefficients.T @ terms).T
            field = np.kron(self.parameters.fields[0], np.eye(3)) @ terms[:9]
        predicted = np.full((len(batch), 3), self.share)
        if self.jacobian is not None and self.covariance is not None:
            rows = np.einsum("kip,in->nkp", self.jacobian, terms[:, ::_THINNED]) / self.noise[:, None]
            some = np.einsum("nkp,pq,nkq->nk", rows, self.covariance, rows, optimize=True)
            predicted = np.repeat(some, _THINNED, axis=0)[: len(batch)]
        return Residuals(batch.t, readings, values / self.noise, predicted, field.T, terms.T)

    def _by_magnitude(self, t: Array, readings: Array) -> Residuals:
        directions, variance, away = by_magnitude(readings - self.bias, self.matrix, self.noise, self.magnitude)
        variance = np.maximum(variance, 1e-300)
        values = away / np.sqrt(variance)
        predicted = np.full((len(t), 1), self.share)
        if self.covariance is not None:
            design = self.magnitude * design_rows(directions[::_THINNED], len(self.covariance))
            some = ((design @ self.covariance) * design).sum(axis=1) / variance[::_THINNED]
            predicted = np.repeat(some, _THINNED)[: len(t), None]
        return Residuals(t, readings, values[:, None], predicted, directions, np.empty((len(t), 0)))
