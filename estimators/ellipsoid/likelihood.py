"""From moments to the best ellipsoid and its covariance.

With the weights fixed, Q = z . c - 1 is linear in the coefficients c, so the weighted least squares are solved at
once. What noise adds to their equations is taken away (``monomials.noise_in_products``), so the estimate is
consistent; and as the weights are those of maximum likelihood, it reaches the Cramer-Rao bound of the model with
unknown directions (Chernov and Lesort, "Statistical efficiency of curve fitting algorithms", 2004), which for
coefficients is the noise variance times the inverse of sum w z z^T at the true points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np

from estimators._small import eigh, inverse
from estimators.ellipsoid.moments import Moments
from estimators.ellipsoid.monomials import FREE, PAIRS, curvature_in_products, noise_in_products
from estimators.ellipsoid.shape import Ellipsoid, Quadric
from rig.arrays import Array

#: Rounding of a sum of squares: residuals below some 6e-8 of the radius cannot be seen in the moments.
_ROUNDING: Final = 16.0 * np.finfo(float).eps
#: With so many readings a parameter the residuals tell their variance well enough.
_ENOUGH: Final = 10


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best ellipsoid given the weights.

    Attributes:
        ellipsoid: the best.
        step: length of the coefficients' change from those of the sphere that the weights were made for.
        variance: of the noise, in units of that which the weights were made with.
        chi_square: sum of w Q^2 at the optimum: squared residuals in the same units.
        exact: whether the residuals are rounding only.
        information: (p, p) of the coefficients for a variance of one, freed of noise.
        noise: (p, p) what noise had added to it.
        inverse: (p, p) of the information, which is positive definite.
        covariance: (p, p) of ``parameter_names`` for a reference magnitude of one.
    """

    ellipsoid: Ellipsoid
    step: float
    variance: float
    chi_square: float
    exact: bool
    information: Array
    noise: Array
    inverse: Array
    covariance: Array

    @cached_property
    def eigenvalues(self) -> Array:
        """(p,) ascending, of the information, scaled so that its diagonal with the noise is one."""
        return self._decomposed[0]

    @cached_property
    def weakest(self) -> Array:
        """(p,) the change of the coefficients that the readings tell worst."""
        return self._decomposed[1]

    @property
    def condition(self) -> float:
        """Largest over smallest eigenvalue; infinite where rounding made the smallest negative."""
        return float(self.eigenvalues[-1] / self.eigenvalues[0]) if self.eigenvalues[0] > 0.0 else np.inf

    @property
    def noise_share(self) -> float:
        """How much noise had added to the information along ``weakest``, relative to what is left."""
        left = float(self.weakest @ self.information @ self.weakest)
        return float(self.weakest @ self.noise @ self.weakest) / left if left > 0.0 else np.inf

    @cached_property
    def _decomposed(self) -> tuple[Array, Array]:
        scale = 1.0 / np.sqrt((self.information + self.noise).diagonal())
        values, vectors = eigh(scale[:, None] * self.information * scale)
        return values, scale * vectors[:, 0]


@lru_cache
def parameter_names(parameters: int) -> tuple[str, ...]:
    """``gain11``, ``gain22``, ``gain33``, for nine also ``gain12``, ``gain13``, ``gain23``, then ``offset1`` to 3."""
    pairs = PAIRS[: parameters - 3]
    return (*(f"gain{i + 1}{j + 1}" for i, j in pairs), "offset1", "offset2", "offset3")


def solve(moments: Moments, parameters: int, known: bool) -> Optimum | None:
    """The optimum of six or nine parameters.

    Args:
        moments: of more readings than parameters; as many will do if ``known``.
        parameters: 6 or 9.
        known: whether the noise that the weights were made with is the real one; otherwise its scale is found from the
            residuals.

    Returns:
        None where the readings determine no ellipsoid.
    """
    free = FREE[parameters]
    used = slice(0, free.stop)
    gram, right = moments.gram[free, free], moments.gram[free, 0]
    once, twice = noise_in_products(moments.noise, moments.first, moments.second)
    freedom = moments.rows / max(moments.rows - parameters, 1)
    floor = _ROUNDING * float(moments.gram[0, 0])
    balance = _Balance(np.array([moments.gram[used, used], once[used, used], twice[used, used]]), freedom, floor)
    # The residuals' own variance, not the one that is known: what chance adds to the sums is in both, and cancels.
    own = not known or moments.rows > _ENOUGH * parameters
    variance = balance.solve(_SPHERE[used])[0] if own else 1.0
    added = variance * once - variance**2 * twice
    noise = added[free, free]
    information = gram - noise
    inner = inverse(information)
    if inner is None:
        return None
    quadric = np.concatenate([_MINUS_ONE, inner.dot(right - added[free, 0] + variance * moments.drift[free])])
    if own:
        # The optimum's residuals are a little smaller: to first order in what that changes.
        less = balance.solve(quadric)[0] - variance
        quadric[1:] += less * inner.dot(once[free, used].dot(quadric) + moments.drift[free])
    own_variance, squares = balance.solve(quadric)
    variance = own_variance if own else variance
    found = Quadric.of(moments.frame, -1.0, quadric[1:])
    if found is None or not variance > 0.0:
        return None
    derivative = found.derivative(moments.frame, parameters).dot(inner)
    change = quadric - _SPHERE[used]
    curved = curvature_in_products(moments.gram, moments.first, float(moments.noise[:3].sum()) / 3.0)
    meat = information + variance * curved[free, free]
    return Optimum(
        found.ellipsoid,
        math.sqrt(np.vdot(change, change)),
        variance,
        squares,
        squares <= balance.floor,
        information,
        noise,
        inner,
        (1.0 if known else variance) * derivative.dot(meat).dot(derivative.T),
    )


@dataclass(frozen=True, eq=False)
class _Balance:
    """The residuals' squares against what noise makes of them.

    Attributes:
        sums: (3, p + 1, p + 1) of w z z^T, and what noise of variance v adds to it by v and by -v^2.
        freedom: readings over degrees of freedom.
        floor: of the squares, by rounding.
    """

    sums: Array
    freedom: float
    floor: float

    def solve(self, quadric: Array) -> tuple[float, float]:
        """The noise variance v at which noise makes the sum of w Q^2 what it is, for the degrees of freedom; that sum.

        Args:
            quadric: (p + 1,) coefficients.
        """
        squares, once, twice = self.sums.dot(quadric).dot(quadric).tolist()
        more = max(squares, self.floor) * self.freedom
        return 2.0 * more / (once + math.sqrt(max(once * once - 4.0 * twice * more, 0.0))), max(squares, 0.0)


_MINUS_ONE: Final = np.array([-1.0])
_SPHERE: Final = np.array([-1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
