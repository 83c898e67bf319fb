"""What a study measures errors in: coordinates that are regular for every direction.

The errors of a unit vector are its two displacements on the sphere [deg], along growing elevation (beta, phi) and along
growing azimuth (gamma, psi): at Renk's beta1 = -89 deg an azimuth itself is off by 57 times as much, and with gravity
along -z it has no meaning at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from estimators.batch import ManyFits, ManyParameters
from estimators.known_angle.identifiability import Information, bound
from estimators.known_angle.model import PARAMETERS_OF, Method, SensorParameters, columns_of_channels
from rig.arrays import Array
from rig.directions import elevation_azimuth_basis, tangent_basis

#: A unit vector's natural size: a radian, in degrees.
RADIAN_DEG: Final = float(np.degrees(1.0))


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The p coordinates of one sensor's errors about a known truth, in the order of ``SensorParameters.jacobian``.

    Attributes:
        truth: of the sensor. method: whose parameters.
    """

    truth: SensorParameters
    method: Method

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(p,) ``sensitivity1``, ``offset1``, ``axis1_beta_deg``, ``axis1_gamma_deg``, .., ``field_phi_deg``,
        ``field_psi_deg``; of separate fits ``field1_phi_deg`` and so on."""
        return coordinate_names(self.method)

    @cached_property
    def values(self) -> Array:
        """(p,) the truth: S, delta [recorded unit], and the angles of the unit vectors [deg]."""
        return self.truth.values(self.method)

    @cached_property
    def sizes(self) -> Array:
        """(p,) what an error is small or large against: the value of S and delta, a radian of a unit vector."""
        return np.where(["_deg" in name for name in self.names], RADIAN_DEG, np.abs(self.values))

    @cached_property
    def _tangents(self) -> tuple[Array, Array]:
        """(3, 2, 3) unit vectors along growing elevation and azimuth, of the axes and of the fields."""
        return elevation_azimuth_basis(self.truth.axes), elevation_azimuth_basis(self.truth.fields)

    @cached_property
    def from_tangent(self) -> Array:
        """(p, p) from the coordinates of ``SensorParameters.jacobian`` at the truth to these."""
        units = np.full(len(self.names), RADIAN_DEG)
        for k, start, _ in columns_of_channels(self.method):
            units[start : start + 2] = self.truth.scales[k]
        return units[:, None] * self.truth.along_angles(self.method)

    def bound(self, gram: ArrayLike, noise: ArrayLike) -> Array:
        """The Cramer-Rao bound (p, p); NaN where the poses tell nothing.

        Args:
            gram: (10, 10) of [vec R, 1].
            noise: (3,) standard deviation of a reading [recorded unit].
        """
        covariance = bound(np.asarray(gram, dtype=float), self.truth, noise, self.method)
        lost = np.isnan(covariance.diagonal())
        covariance[np.isnan(covariance)] = 0.0
        result = self.from_tangent @ covariance @ self.from_tangent.T
        touched = (np.abs(self.from_tangent[:, lost]) > 0.0).any(axis=1)
        result[touched] = np.nan
        result[:, touched] = np.nan
        return result

    def bias(self, gram: ArrayLike, noise: ArrayLike) -> Array:
        """(p,) what the curvature of the model lets expect, to second order in the noise; arguments as of ``bound``."""
        return self.from_tangent @ second_order_bias(gram, self.truth, noise, self.method)

    def errors(self, estimates: ManyParameters) -> Array:
        """(m, p) estimate minus truth."""
        result = np.empty((len(estimates), len(self.names)))
        axes, fields = self._tangents
        for k, start, of_field in columns_of_channels(self.method):
            result[:, start] = estimates.sensitivity[:, k] - self.truth.sensitivity[k]
            result[:, start + 1] = estimates.offset[:, k] - self.truth.offset[k]
            result[:, start + 2 : start + 4] = RADIAN_DEG * (estimates.axes[:, k] - self.truth.axes[k]) @ axes[k].T
            result[:, of_field] = RADIAN_DEG * (estimates.fields[:, k] - self.truth.fields[k]) @ fields[k].T
        return result

    def standard_deviations(self, fits: ManyFits) -> Array:
        """(m, p) as the fits themselves state them, from their covariance at the estimates."""
        result = np.empty((len(fits), len(self.names)))
        estimates = fits.parameters
        variance = np.einsum("mii->mi", fits.covariance)
        axis_bases, field_bases = tangent_basis(estimates.axes), tangent_basis(estimates.fields)
        axes, fields = self._tangents
        for k, start, of_field in columns_of_channels(self.method):
            result[:, start] = estimates.sensitivity[:, k] * np.sqrt(variance[:, start])
            result[:, start + 1] = estimates.length[:, k] * np.sqrt(variance[:, start + 1])
            of_axis = slice(start + 2, start + 4)
            for columns, own, basis in ((of_axis, axes[k], axis_bases[:, k]), (of_field, fields[k], field_bases[:, k])):
                to_own = own @ basis.swapaxes(1, 2)
                spread = np.einsum("mai,mij,maj->ma", to_own, fits.covariance[:, columns, columns], to_own)
                result[:, columns] = RADIAN_DEG * np.sqrt(np.maximum(spread, 0.0))
        return result


def coordinate_names(method: Method) -> tuple[str, ...]:
    """The names of the coordinates of a method's parameters."""
    names = [""] * PARAMETERS_OF[method]
    for k, start, of_field in columns_of_channels(method):
        n = k + 1
        names[start : start + 4] = f"sensitivity{n}", f"offset{n}", f"axis{n}_beta_deg", f"axis{n}_gamma_deg"
        own = str(n) if method == "separate" else ""
        names[of_field] = f"field{own}_phi_deg", f"field{own}_psi_deg"
    return tuple(names)


def second_order_bias(gram: ArrayLike, truth: SensorParameters, noise: ArrayLike, method: Method) -> Array:
    """(p,) expected estimate minus truth, in the coordinates of ``SensorParameters.jacobian``.

    M. J. Box, "Bias in nonlinear estimation", J. R. Statist. Soc. B 33 (1971), 171-201: to second order in the noise
    the estimate is off by -1/2 of the least-squares fit to the curvature of the model, weighted by the covariance. It
    falls as 1/n and grows with the square of the noise, so beside a standard deviation that falls as 1/sqrt(n) it
    vanishes: it is no inconsistency.

    With theta(u) linear in the readings, curvature h_k = sum over ab of d2 theta_k / du_a du_b C_ab and the covariance
    C, it is -1/2 C sum over k of J_k^T gram h_k / sigma_k^2.

    Args:
        gram: (10, 10) of [vec R, 1].
        truth: the parameters.
        noise: (3,) standard deviation of a reading, as which channels are weighted [recorded unit].
        method: of the fit.
    """
    poses = np.asarray(gram, dtype=float)
    sigma = np.broadcast_to(np.asarray(noise, dtype=float), 3)
    covariance = Information.of(poses, truth, sigma, method).covariance
    jacobian = truth.jacobian(method)
    right = np.zeros(len(covariance))
    for k, curvature in enumerate(_curvatures(truth, covariance, method)):
        right += jacobian[k].T @ poses @ curvature / sigma[k] ** 2
    return np.asarray(-0.5 * covariance @ right)


def _curvatures(truth: SensorParameters, covariance: Array, method: Method) -> list[Array]:
    """h_k (10,) of each channel: theta_k = [L (1 + s) f(v) P(u)^T, delta + L d] with unit vectors P(u), f(v), whose
    second derivatives are minus themselves."""
    axis_bases, field_bases = truth.bases
    length = truth.reference_magnitude * truth.sensitivity
    found = []
    for k, start, of_field in columns_of_channels(method):
        f, axis, of_axis = truth.fields[k], truth.axes[k], slice(start + 2, start + 4)
        with_axis = covariance[start, of_axis] @ axis_bases[k]
        with_field = covariance[start, of_field] @ field_bases[k]
        mixed = field_bases[k].T @ covariance[of_field, of_axis] @ axis_bases[k]
        shrinking = np.trace(covariance[of_axis, of_axis]) + np.trace(covariance[of_field, of_field])
        matrix = 2.0 * (np.outer(f, with_axis) + np.outer(with_field, axis) + mixed) - shrinking * np.outer(f, axis)
        found.append(length[k] * np.append(matrix.ravel(), 0.0))
    return found
