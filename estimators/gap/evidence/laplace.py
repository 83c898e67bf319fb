"""The log evidence of an explanation: how well it predicts the recording, its parameters averaged over their prior.

Laplace's approximation about the refit, in whitened coordinates with the calibration's tangent projected out, which is
the restricted likelihood (Harville, Biometrika 61, 1974). Strengths are normal about zero with a scale of their own for
each effect, averaged over a grid; of an effect with one strength an axis, all act or one alone; of one along cosines
over the recording they are those of a process with any of a discrepancy's memories. Shapes are normal among the values
that are searched; where none are, about what was fitted, one typical size wide.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import project, side_by_side
from estimators.gap.evidence.refine import Refit
from estimators.gap.hypotheses.courses import matern
from estimators.gap.hypotheses.prior import LENGTHS, ONE_AXIS, scales
from estimators.gap.hypotheses.shapes import shape_prior
from rig.arrays import Array

#: Squared signal-to-noise of a typical size below which an effect does nothing on this recording.
_UNFELT: Final = 1e-9
#: So many combinations of scales are averaged in full; beyond that one effect's scale at a time.
_FULL: Final = 64
#: By what the prior precision of strengths grows where another one of their effect acts alone.
_ALONE: Final = 1e6
#: Squared pivots of Cholesky's factor below which eigenvalues are looked at; a corner above any square of a moment.
_WEAK: Final = 1e-8
_HUGE: Final = 1e250

#: The scale of an effect's strengths, (p,) factors of their prior precisions, and its log prior.
_Way = tuple[float, Array, float]


@dataclass(frozen=True)
class Linear:
    """A set of fitted effects, linearised where it was fitted; parameters in typical sizes, effect after effect.

    Attributes:
        left: (m,) whitened residual that is left, the calibration projected out.
        tangent: (m, p) derivatives, the calibration projected out.
        point: (p,) fitted values. strength: (p,) True for strengths.
        width: (p,) prior standard deviation of shapes.
        owner: (p,) the number of the effect.
        searched: logarithm of how many fixed shapes were as likely, less those that fit as well.
        by_axis: (p,) True for strengths of which one may act alone.
        away: (p,) prior mean of shapes less the fitted value; None: nothing.
        orders: (p,) of strengths along cosines over the recording, how many half waves each has; zero of others.
    """

    left: Array
    tangent: Array
    point: Array
    strength: NDArray[np.bool_]
    width: Array
    owner: NDArray[np.intp]
    searched: float = 0.0
    by_axis: NDArray[np.bool_] | None = None
    away: Array | None = None
    orders: NDArray[np.intp] | None = None

    @cached_property
    def gram(self) -> Array:
        """(p, p)."""
        return np.asarray(self.tangent.T @ self.tangent)

    @property
    def columns(self) -> Array:
        """(m, p + 1) the residual, then the tangent."""
        return side_by_side(self.left, self.tangent)

    @cached_property
    def products(self) -> Array:
        """(p + 1, p + 1) of these with each other."""
        moment = self.tangent.T @ self.left
        return np.block([[self.left @ self.left, moment], [moment[:, None], self.gram]])

    @property
    def felt(self) -> bool:
        """Whether every effect changes the readings where it was fitted; one that acts by being there has no say."""
        length = np.diag(self.gram)
        count = int(self.owner.max()) + 1 if len(self.owner) else 0
        return all(length[self.owner == index].sum() > _UNFELT for index in range(count))

    @cached_property
    def _grids(self) -> list[tuple[Array, Array]]:
        """The scales of each effect's strengths, and their log probabilities."""
        length = np.diag(self.gram)
        count = int(self.owner.max()) + 1 if len(self.owner) else 0
        found = []
        for index in range(count):
            own = self.strength & (self.owner == index)
            if own.any():
                found.append(scales(float(np.sqrt(length[own].sum())), float(np.abs(self.point[own]).max())))
            else:
                found.append((np.ones(1), np.zeros(1)))
        return found

    def precision(self, chosen: Sequence[float] | Array) -> Array:
        """(p,) prior precisions with a scale for each effect."""
        each = np.asarray(chosen)[self.owner] if len(self.owner) else np.zeros(0)
        return np.where(self.strength, 1.0 / each**2, 1.0 / self.width**2)

    @cached_property
    def pull(self) -> Array:
        """(p,) prior mean less the fitted value."""
        return np.where(self.strength, -self.point, 0.0 if self.away is None else self.away)

    def posterior(
        self, precision: Array, gram: Array | None = None, moment: Array | None = None
    ) -> tuple[Array, Array]:
        """Mean (p,) of the parameters less their fitted values, and covariance (p, p), in typical sizes."""
        gram = self.gram if gram is None else gram
        moment = self.tangent.T @ self.left if moment is None else moment
        covariance = np.linalg.pinv(gram + np.diag(precision), hermitian=True)
        return np.asarray(covariance @ (moment + precision * self.pull)), np.asarray(covariance)

    @cached_property
    def ahead(self) -> float:
        """The log likelihood and prior that moving the parameters to where they are likeliest gains, to first order."""
        precision = self.likeliest
        step = self.posterior(precision)[0]
        return float(0.5 * step @ (self.tangent.T @ self.left + precision * self.pull))

    def beside(self, column: Array, expected: float, width: float) -> Linear:
        """The same beside a column (m,), the calibration projected out, of a size that is expected to be so much."""
        number = 0 if not len(self.owner) else int(self.owner.max()) + 1
        away = np.zeros(len(self.point)) if self.away is None else self.away
        by_axis = np.zeros(len(self.point), dtype=bool) if self.by_axis is None else self.by_axis
        orders = np.zeros(len(self.point), dtype=np.intp) if self.orders is None else self.orders
        return replace(
            self,
            tangent=np.column_stack([self.tangent, column]),
            point=np.append(self.point, 0.0),
            strength=np.append(self.strength, False).astype(bool),
            width=np.append(self.width, width),
            owner=np.append(self.owner, number).astype(np.intp),
            by_axis=np.append(by_axis, False).astype(bool),
            away=np.append(away, expected),
            orders=np.append(orders, 0),
        )

    def log_evidence(self, square: Array | float, gram: Array, moment: Array, precision: Array) -> Array:
        """(...,) without the determinant of S, the inverse covariance.

        Args:
            square, gram, moment: (...,), (..., p, p), (..., p) left' S left, T' S T and T' S left.
            precision: (p,) or (..., p) of the prior.
        """
        if not len(self.point):
            return np.asarray(-0.5 * np.asarray(square))
        diagonal = np.einsum("...ii->...i", gram) + precision
        scale = 1.0 / np.sqrt(np.maximum(diagonal, 0.5 * precision))
        own = precision[..., :, None] * np.eye(len(self.point))
        posterior = (gram + own) * scale[..., :, None] * scale[..., None, :]
        least = 0.5 * np.min(precision * scale**2, axis=-1)  # the prior alone is as much: less is rounding
        fit, log_det = _solved(posterior, (moment + precision * self.pull) * scale, np.maximum(least, 1e-13))
        log_det -= 2.0 * np.log(scale).sum(axis=-1)
        fit -= precision @ self.pull**2
        return np.asarray(-0.5 * square + 0.5 * fit + 0.5 * np.log(precision).sum(axis=-1) - 0.5 * log_det)

    def beyond(self, taken: Array) -> Array:
        """(...,) what its log evidence, at its likeliest scales, is more where so much (..., p + 1, p + 1) is taken of
        its products."""

        def at(products: Array) -> Array:
            return self.log_evidence(products[..., 0, 0], products[..., 1:, 1:], products[..., 1:, 0], self.likeliest)

        return np.asarray(at(self.products - taken) - at(self.products))

    @cached_property
    def _ways(self) -> list[list[_Way]]:
        """What the strengths of each effect may be like before the data."""
        found = []
        for index, (grid, weights) in enumerate(self._grids):
            scaled = list(zip(grid.tolist(), weights.tolist(), strict=True))
            alike = self._alike(self.owner == index)
            found.append([(c, factors, float(np.log(share)) + own) for factors, share in alike for c, own in scaled])
        return found

    def _alike(self, own: NDArray[np.bool_]) -> list[tuple[Array, float]]:
        """Factors (p,) of the prior precisions of an effect's strengths, each with its probability."""
        every = np.ones(len(self.point))
        axes = [] if self.by_axis is None else np.flatnonzero(self.by_axis & own).tolist()
        found = [(every, 1.0 - ONE_AXIS if axes else 1.0)]
        for axis in axes:
            others = self.strength & own
            others[axis] = False
            found.append((np.where(others, _ALONE, every), ONE_AXIS / len(axes)))
        if self.orders is None or not np.any(cosines := own & (self.orders > 0)):
            return found
        falls = []
        for length in LENGTHS:
            size = matern(length, int(self.orders.max()) + 1)[self.orders[cosines]]
            factors = every.copy()
            factors[cosines] = np.mean(size**2) / size**2  # of the same mean square
            falls.append(factors)
        return [(own * factors, share / len(falls)) for own, share in found for factors in falls]

    def _precision_of(self, chosen: Sequence[_Way]) -> Array:
        precision = self.precision([scale for scale, *_ in chosen])
        for _, factors, _ in chosen:
            precision = precision * factors
        return precision

    @cached_property
    def averaged(self) -> tuple[float, Array]:
        """The log evidence under the floor, averaged over the ways of its strengths; the (p,) prior precisions of the
        likeliest, as they are where all axes act: that one acts alone is one way among others."""
        square, moment = float(self.left @ self.left), self.tangent.T @ self.left
        if not self._ways:
            return -0.5 * square, np.zeros(0)

        def likeliest(chosen: Sequence[_Way]) -> Array:
            return self._precision_of([(scale, np.where(own < _ALONE, own, 1.0), 0.0) for scale, own, _ in chosen])

        def at(every: Sequence[Sequence[_Way]]) -> Array:
            precision = np.stack([self._precision_of(chosen) for chosen in every])
            known = self.log_evidence(square, self.gram, moment, precision)
            return np.asarray(known + [sum(weight for *_, weight in chosen) for chosen in every])

        if np.prod([len(ways) for ways in self._ways]) <= _FULL:
            combinations = list(itertools.product(*self._ways))
            values = at(combinations)
            best = combinations[int(np.argmax(values))]
            return float(np.logaddexp.reduce(values)) - self.searched, likeliest(best)
        chosen = [ways[len(grid) // 2] for ways, (grid, _) in zip(self._ways, self._grids, strict=True)]

        def along(index: int) -> Array:
            return at([[*chosen[:index], way, *chosen[index + 1 :]] for way in self._ways[index]])

        for _ in range(2):
            for index, ways in enumerate(self._ways):
                chosen[index] = ways[int(np.argmax(along(index)))]
        top = float(at([chosen])[0])
        total = top + sum(float(np.logaddexp.reduce(along(index))) - top for index in range(len(chosen)))
        return total - self.searched, likeliest(chosen)

    @property
    def likeliest(self) -> Array:
        """(p,) prior precisions where the strengths are as is likeliest."""
        return self.averaged[1]


def _solved(matrix: Array, moment: Array, least: Array) -> tuple[Array, Array]:
    """moment' matrix^-1 moment (...,) and log det (...,) of positive matrices (..., p, p) with ones on the diagonal.

    Args:
        moment: (..., p). least: (...,) eigenvalues below this are rounding.
    """
    size = matrix.shape[-1]
    bordered = np.empty((*np.broadcast_shapes(matrix.shape[:-2], moment.shape[:-1]), size + 1, size + 1))
    bordered[..., :size, :size], bordered[..., size, :size], bordered[..., size, size] = matrix, moment, _HUGE
    try:
        root = np.linalg.cholesky(bordered)  # its last row is what solves for the moment
    except np.linalg.LinAlgError:
        root = np.zeros(bordered.shape)
    pivots = np.einsum("...ii->...i", root)[..., :size] ** 2
    log_det = np.asarray(np.log(np.maximum(pivots, 1e-300)).sum(axis=-1))
    fit = np.asarray(np.sum(root[..., size, :size] ** 2, axis=-1))
    weak = np.asarray(pivots.min(axis=-1) < _WEAK)
    if weak.any():
        values, vectors = np.linalg.eigh(bordered[..., :size, :size][weak])
        values = np.maximum(values, np.broadcast_to(least, weak.shape)[weak][..., None])
        z = np.einsum("...ji,...j->...i", vectors, bordered[..., size, :size][weak])
        fit[weak], log_det[weak] = np.sum(z**2 / values, axis=-1), np.log(values).sum(axis=-1)
    return fit, log_det


def linearised(refitted: Refit, searched: float = 0.0) -> Linear:
    """Fitted effects, linearised where they were fitted.

    Args:
        searched: see ``Linear``.
    """
    fits, data = refitted.fits, refitted.data
    if not fits:
        none = np.zeros(0)
        return Linear(data.whitened, np.zeros((data.size, 0)), none, none > 0, none, np.zeros(0, dtype=np.intp))
    left, tangent = (project(data.absorbed, each) for each in (refitted.left, refitted.columns))
    point = np.concatenate([fit.values / fit.scale for fit in fits])
    strength = np.concatenate([np.full(item.size, item.strength) for fit in fits for item in fit.free])
    shapes = [shape_prior(fit.effect, item, data) for fit in fits for item in fit.free]
    away, width = (np.concatenate(each) for each in zip(*shapes, strict=True))
    owner = np.concatenate([np.full(len(fit.values), index, dtype=np.intp) for index, fit in enumerate(fits)])
    by_axis = np.concatenate([np.full(item.size, item.by_axis) for fit in fits for item in fit.free])
    orders = [
        np.arange(1, item.size + 1) if item.of_cosines else np.zeros(item.size) for fit in fits for item in fit.free
    ]
    return Linear(
        left,
        tangent,
        point,
        strength.astype(bool),
        width,
        owner,
        searched,
        by_axis=by_axis.astype(bool),
        away=away,
        orders=np.concatenate(orders).astype(np.intp),
    )
