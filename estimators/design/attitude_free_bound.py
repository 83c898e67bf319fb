"""What readings can tell of a sensor whose attitude nobody knows: the Cramer-Rao bound of the ellipsoid, Camps (6).

V = A h + b + noise with |h| known and its direction not, A symmetric. A reading then tells one number, its distance
from the ellipsoid, and the information is that of the model with every direction unknown: sum of g g^T / v, with g the
derivative of |A^-1 (V - b)| and v the variance that the noise gives it: that of
``estimators.coverage.attitude_free_information`` in the sensor's own parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimators.coverage.attitude_free_information import design_rows
from estimators.design.prediction import Prediction
from estimators.ellipsoid.likelihood import parameter_names
from estimators.ellipsoid.monomials import PAIRS, packed
from estimators.known_angle.identifiability import Told, is_open
from estimators.known_angle.refusal import UNCERTAINTY_LIMIT
from rig.arrays import Array


@dataclass(frozen=True, eq=False)
class FreeSensor:
    """A sensor as its readings alone show it.

    Attributes:
        gain: (3, 3) symmetric A [recorded unit per field unit]. offset: (3,) b [recorded unit].
        R_own_tool: (3, 3) from frame 6 to the frame in which the gain is symmetric.
        magnitude: |h| [field unit].
    """

    gain: Array
    offset: Array
    R_own_tool: Array
    magnitude: float

    @classmethod
    def of(cls, gain: ArrayLike, offset: ArrayLike, magnitude: float) -> FreeSensor:
        """From rows S_k P_k (3, 3): the polar decomposition A R takes out what the readings cannot tell."""
        left, sizes, right = np.linalg.svd(np.asarray(gain, dtype=float))
        return cls((left * sizes) @ left.T, np.asarray(offset, dtype=float), left @ right, magnitude)

    def information(self, directions: ArrayLike, noise: ArrayLike) -> Array:
        """(9, 9) of readings with the field along unit vectors (n, 3), frame 6, and noise (3,) [recorded unit].

        The parameters are taken in their natural sizes: the gain relative to its largest diagonal element, the offset
        to what the field adds to a reading along that axis.
        """
        u = np.asarray(directions, dtype=float) @ self.R_own_tool.T
        pull = u @ np.linalg.inv(self.gain)  # the derivative by V
        variance = np.square(pull * np.asarray(noise, dtype=float)).sum(axis=1)
        rows = design_rows(u, 9) * (self.magnitude / np.sqrt(variance))[:, None]
        change = self._change()
        return np.asarray(change.T @ (rows.T @ rows) @ change)

    def _change(self) -> Array:
        """(9, 9) what a step of each parameter is in those of ``design_rows``: dA makes E = -A^-1 dA, db the shift
        c = A^-1 db / |h|."""
        inverse = np.linalg.inv(self.gain)
        size = float(self.gain.diagonal().max())
        change = np.zeros((9, 9))
        for column, (i, j) in enumerate(PAIRS):
            step = np.zeros((3, 3))
            step[i, j] = step[j, i] = size
            E = -inverse @ step
            change[:6, column] = [E[a, b] + E[b, a] if a != b else E[a, a] for a, b in PAIRS]
        change[6:, 6:] = size * inverse
        return change

    def predict(self, information: ArrayLike, count: int, noise: ArrayLike) -> Prediction:
        """The bound that an ``information`` of ``count`` samples leaves."""
        matrix = np.asarray(information, dtype=float)
        told = Told.of(matrix)
        open_ = is_open(told.null)
        names = parameter_names(9)
        std = np.sqrt(told.covariance.diagonal())
        untold = {name: "left open by these directions" for name, is_open in zip(names, open_, strict=True) if is_open}
        problem = None
        if untold:
            problem = (
                f"these directions cannot determine {', '.join(untold)}; turn the sensor through more orientations"
            )
        elif (std > UNCERTAINTY_LIMIT).any():
            bad = ", ".join(name for name, value in zip(names, std, strict=True) if value > UNCERTAINTY_LIMIT)
            problem = f"these directions and this noise leave {bad} uncertain by more than a tenth of the gain"
        std[open_] = np.nan
        size = float(self.gain.diagonal().max())
        sizes = np.full(len(names), size)
        sizes[-3:] *= self.magnitude
        return Prediction(
            "ellipsoid",
            count,
            np.broadcast_to(np.asarray(noise, dtype=float), (3,)),
            names,
            np.concatenate([packed(self.gain), self.offset]),
            std * sizes,
            untold,
            told.condition,
            problem,
        )
