"""The paper's own estimator: Levenberg-Marquardt from the data sheet's values; Camps (2)-(7).

It minimises the sum of e^2, e = |A^-1 (V - b)|^2 - H^2, without weights, so noise biases it and its variance exceeds
the bound; its covariance here is that of this estimator. Two slips of the paper are mended: in (5) the offsets'
derivatives are -2 alpha'^2 (V - beta), and the step goes against the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from estimators.ellipsoid.monomials import packed, products, symmetric
from rig.arrays import Array
from rig.errors import RefusedFit, RigError

_EVALUATIONS: Final = 1000


@dataclass(frozen=True, eq=False)
class Start:
    """Where the search starts: what a data sheet says.

    Attributes:
        gain: [recorded unit / field unit] one for all axes, three, or a symmetric (3, 3) matrix.
        offset: [recorded unit] one for all axes, or three.
    """

    gain: ArrayLike
    offset: ArrayLike = 0.0

    def matrices(self, name: str) -> tuple[Array, Array]:
        """Gain (3, 3) and offset (3,).

        Raises:
            RigError: another shape, or a gain that is not positive definite.
        """
        gain, offset = np.asarray(self.gain, dtype=float), np.asarray(self.offset, dtype=float)
        if gain.shape not in ((), (3,), (3, 3)) or offset.shape not in ((), (3,)):
            raise RigError(
                f"{name}: start: found gain of shape {gain.shape} and offset of {offset.shape}, expected one number,"
                " three, or for the gain 3 by 3"
            )
        matrix = gain if gain.ndim == 2 else np.diag(np.broadcast_to(gain, 3))
        if not (np.isfinite(matrix).all() and (np.linalg.eigvalsh(0.5 * (matrix + matrix.T)) > 0.0).all()):
            raise RigError(f"{name}: start: found gain {gain.tolist()}, expected positive numbers")
        return 0.5 * (matrix + matrix.T), np.array(np.broadcast_to(offset, 3))


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the search ends.

    Attributes:
        gain: (3, 3) [recorded unit / field unit]. offset: (3,) [recorded unit].
        covariance: (p, p) of ``likelihood.parameter_names``, for noise of ``variances``.
        variances: (3,) of the noise, given or equal and from the residuals [recorded unit squared].
        chi_square: sum of squared first-order distances over their variances.
    """

    gain: Array
    offset: Array
    covariance: Array
    variances: Array
    chi_square: float


def levenberg_marquardt(
    readings: Array, start: Start, reference_magnitude: float, parameters: int, noise: Array | None, name: str
) -> Minimum:
    """Minimise the sum of e^2.

    Args:
        readings: (n, 3) [recorded unit].
        start: the data sheet's values.
        reference_magnitude: H [field unit].
        parameters: 6, Camps (1), or 9, Camps (6).
        noise: (3,) standard deviation of a reading [recorded unit], or None.
        name: for messages.

    Raises:
        RigError: a start of another shape, or far beyond the readings.
        RefusedFit: the search does not converge, or not to an ellipsoid.
    """
    pairs = parameters - 3
    first_gain, first_offset = start.matrices(name)
    square = reference_magnitude**2

    def inverse_gain(values: Array) -> Array:
        entries = np.zeros(6)
        entries[:pairs] = values[:pairs]
        return symmetric(entries)

    def residuals(values: Array) -> Array:
        field = (readings - values[pairs:]) @ inverse_gain(values)
        return np.asarray((field * field).sum(axis=1) - square)

    def jacobian(values: Array) -> Array:
        inner, away = inverse_gain(values), readings - values[pairs:]
        field = away @ inner
        return np.column_stack([2.0 * products(field, away)[:, :pairs], -2.0 * field @ inner])

    begin = np.concatenate([packed(np.asarray(np.linalg.inv(first_gain)))[:pairs], first_offset])
    with np.errstate(over="ignore", invalid="ignore"):
        if not np.isfinite(residuals(begin)).all():
            raise RigError(
                f"{name}: start: found gain {np.diag(first_gain).tolist()} and offset {first_offset.tolist()}, expected"
                " some nearer to the sensor's: from these the readings are beyond all numbers"
            )
    found = least_squares(residuals, begin, jacobian, method="lm", x_scale="jac", max_nfev=_EVALUATIONS)
    inner, offset = inverse_gain(found.x), found.x[pairs:]
    if (np.linalg.eigvalsh(inner) < 0.0).all():
        inner = -inner  # e is even in the inverse gain
    if not found.success or not (np.linalg.eigvalsh(inner) > 0.0).all():
        raise RefusedFit(
            f"{name}: Levenberg-Marquardt from gain {np.diag(first_gain).tolist()} and offset {first_offset.tolist()}"
            f" ended after {found.nfev} evaluations without an ellipsoid: expected a start nearer to it, or none"
        )
    slope = 2.0 * ((readings - offset) @ inner @ inner)
    known = np.ones(3) if noise is None else np.square(noise)
    expected = np.square(slope) @ known
    chi_square = float((np.square(found.fun) / expected).sum())
    scale = 1.0 if noise is not None else chi_square / (len(readings) - parameters)
    J = jacobian(np.concatenate([packed(inner)[:pairs], offset]))
    normal = np.linalg.inv(J.T @ J)
    of_search = scale * normal @ (J.T * expected) @ J @ normal
    gain = np.asarray(np.linalg.inv(inner))
    turn = np.zeros((parameters, parameters))  # d gain = -gain (d inverse gain) gain
    for column in range(pairs):
        turn[:pairs, column] = -packed(gain @ symmetric(np.eye(6)[column]) @ gain)[:pairs]
    turn[pairs:, pairs:] = np.eye(3)
    return Minimum(gain, offset, turn @ of_search @ turn.T, scale * known, chi_square / scale)
