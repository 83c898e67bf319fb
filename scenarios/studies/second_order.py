"""The bias that a nonlinear least-squares estimate has at a finite number of samples.

M. J. Box, "Bias in nonlinear estimation", J. R. Statist. Soc. B 33 (1971), 171-201: to second order in the noise the
estimate is off by -1/2 of the least-squares fit to the curvature of the model, weighted by the covariance. It falls as
1/n and grows with the square of the noise, so beside a standard deviation that falls as 1/sqrt(n) it vanishes: it is
no inconsistency.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import Method, SensorParameters, columns_of_channels
from rig.arrays import Array


def second_order_bias(gram: ArrayLike, truth: SensorParameters, noise: ArrayLike, method: Method) -> Array:
    """(p,) expected estimate minus truth, in the coordinates of ``SensorParameters.jacobian``.

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
