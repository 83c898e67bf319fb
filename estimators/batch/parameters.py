"""The parameters of many sensors, and what poses and noise tell of each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from estimators.known_angle.identifiability import NULL_EIGENVALUE, unit_scale
from estimators.known_angle.model import PARAMETERS_OF, Method, SensorParameters, columns_of_channels
from rig.arrays import Array, Mask, Rows


@dataclass(frozen=True, eq=False)
class ManyParameters(SensorParameters):
    """m points of the parameter space of one sensor, of one reference magnitude; arrays begin with the axis (m,)."""

    @classmethod
    def stacked(cls, points: Iterable[SensorParameters]) -> Self:
        """Points of the same reference magnitude."""
        rows = list(points)
        return cls(
            rows[0].reference_magnitude,
            np.stack([row.sensitivity for row in rows]),
            np.stack([row.offset for row in rows]),
            np.stack([row.axes for row in rows]),
            np.stack([row.fields for row in rows]),
        )

    def __len__(self) -> int:
        """m."""
        return len(self.sensitivity)

    def __getitem__(self, index: int) -> SensorParameters:
        """One of them."""
        return SensorParameters(
            self.reference_magnitude, self.sensitivity[index], self.offset[index], self.axes[index], self.fields[index]
        )

    def __iter__(self) -> Iterator[SensorParameters]:
        """One after the other."""
        return (self[index] for index in range(len(self)))

    def errors(self, truth: SensorParameters, method: Method) -> Array:
        """(m, p) truth minus these, in the coordinates of ``SensorParameters.jacobian`` at these.

        Args:
            truth: of all, or (m,) one for each.
            method: which coordinates.
        """
        result = np.empty((len(self), PARAMETERS_OF[method]))
        axis_bases, field_bases = self.bases
        for k, start, of_field in columns_of_channels(method):
            result[:, start] = truth.sensitivity[..., k] / self.sensitivity[:, k] - 1.0
            result[:, start + 1] = (truth.offset[..., k] - self.offset[:, k]) / self.length[:, k]
            result[:, start + 2 : start + 4] = (axis_bases[:, k] * truth.axes[..., k, None, :]).sum(axis=-1)
            result[:, of_field] = (field_bases[:, k] * truth.fields[..., k, None, :]).sum(axis=-1)
        return result

    def information(self, gram: Array) -> Array:
        """(m, 3, 6, 6) each channel's information times its noise variance, in its own S, delta, axis and field.

        Args:
            gram: (10, 10) or (m, 10, 10) of [vec R, 1].
        """
        jacobian = np.ascontiguousarray(self.by_channel.swapaxes(-1, -2))
        flat = jacobian.reshape(-1, 18, 10)  # one product for all channels, and for all data sets of the same poses
        half = (flat.reshape(-1, 10) @ gram if gram.ndim == 2 else flat @ gram).reshape(jacobian.shape)
        return np.asarray(half @ jacobian.swapaxes(-1, -2))


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What the readings tell of m sensors.

    Attributes:
        covariance: (m, p, p) in the coordinates of ``SensorParameters.jacobian``.
        leverage: (m, 3) parameters that each channel's readings have paid for.
        determined: (m,) whether the poses determine all parameters.
    """

    covariance: Array
    leverage: Array
    determined: Mask

    @classmethod
    def of(cls, per_channel: Array, noise: ArrayLike, method: Method) -> Self:
        """From channels' information (m, 3, 6, 6) for noise of one, and their noise (m, 3) [recorded unit]."""
        own = per_channel / np.square(np.asarray(noise, dtype=float))[:, :, None, None]
        matrix = _together(own, method)
        scale = unit_scale(matrix)
        scaled = scale[:, :, None] * matrix * scale[:, None, :]
        inverse, determined = _inverse(scaled)
        covariance = scale[:, :, None] * inverse * scale[:, None, :]
        shares = [
            (covariance[:, place[:, None], place] * own[:, k]).sum(axis=(1, 2))
            for k, place in enumerate(places(method))
        ]
        return cls(covariance, np.stack(shares, axis=1), determined)

    def sandwich(self, per_channel: Array, noise: Array, method: Method) -> Array:
        """(m, p, p) covariance of estimates with noise (m, 3), where ``self`` assumed noise of one for all channels."""
        middle = _together(per_channel * np.square(noise)[:, :, None, None], method)
        return np.asarray(self.covariance @ middle @ self.covariance)


def places(method: Method) -> list[Rows]:
    """For each channel, the columns of its S, delta, axis and field."""
    return [np.r_[start : start + 4, of_field] for _, start, of_field in columns_of_channels(method)]


def _together(own: Array, method: Method) -> Array:
    """(m, p, p) the sum of the channels' (m, 3, 6, 6)."""
    p = PARAMETERS_OF[method]
    matrix = np.zeros((len(own), p, p))
    for k, place in enumerate(places(method)):
        matrix[:, place[:, None], place] += own[:, k]
    return matrix


def _inverse(scaled: Array) -> tuple[Array, Mask]:
    """Inverses of information matrices (m, p, p) of unit diagonal, without their null directions; and which have none.

    The trace of an inverse bounds its largest eigenvalue, so most need no eigenvalues to be computed.
    """
    p = scaled.shape[1]
    try:
        inverse = np.asarray(np.linalg.inv(scaled))
    except np.linalg.LinAlgError:
        inverse = np.full_like(scaled, np.nan)
    trace = np.einsum("mii->m", inverse)
    regular = (trace >= p) & (trace < 0.1 / NULL_EIGENVALUE)
    determined = regular.copy()
    for row in np.flatnonzero(~regular):
        values, vectors = np.linalg.eigh(scaled[row])
        told = values > NULL_EIGENVALUE
        inverse[row] = (vectors[:, told] / values[told]) @ vectors[:, told].T
        determined[row] = told.all()
    return inverse, determined
