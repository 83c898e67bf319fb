"""The best solutions of many centred problems: separate, Renk (14), (20), and simultaneous, Renk (15), (21)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimators.batch.global_minima import RANK_TOLERANCE, Minima, Problems, descend, local_minima
from estimators.batch.parameters import ManyParameters
from estimators.known_angle.model import PARAMETERS_OF, Method, Weighting, columns_of_channels
from estimators.known_angle.refusal import AMBIGUOUS_CHI_SQUARE, SAME_SIGMAS
from rig.arrays import Array, Mask, Rows
from rig.directions import tangent_basis

#: Relative change of the weights that ends their iteration: it moves the estimate by a millionth of its standard
#: deviation.
_SETTLED: Final = 1e-6
_MOST_WEIGHTS: Final = 50
#: Fields whose product is within this of one are the same minimum.
_SAME: Final = 1e-10


@dataclass(frozen=True, eq=False)
class Centred:
    """The centred problems of m data sets, and what was taken out of them.

    Attributes:
        problems: of unweighted readings, c = 3.
        count: (m,) n.
        mean_rotation: (9,) or (m, 9). mean: (m, 3) of the readings.
        variance: (m, 3) of the readings. rounding: (m, 3) root mean square residual that rounding alone leaves.
        floor: (m, 3) mean square of the readings that no linear function of vec R explains.
        rank: (m,) the number of dimensions that the orientations span.
    """

    problems: Problems
    count: Array
    mean_rotation: Array
    mean: Array
    rounding: Array
    floor: Array
    rank: Rows

    @classmethod
    def of(cls, gram: Array, cross: Array, square: Array, count: Array) -> Centred:
        """From statistics gram (10, 10) or (m, 10, 10), cross (m, 10, 3), square (m, 3), count (m,)."""
        n = count[:, None].astype(float)
        each = n[0] if gram.ndim == 2 else n[:, :, None]
        moments = gram / each
        mean_rotation = moments[..., :9, 9]
        mean = cross[:, 9] / n
        covariance = moments[..., :9, :9] - mean_rotation[..., :, None] * mean_rotation[..., None, :]
        centred = cross[:, :9] / n[:, :, None] - mean_rotation[..., :, None] * mean[:, None, :]
        mean_square = square / n
        variance = np.maximum(mean_square - mean * mean, 0.0)
        values, vectors = np.linalg.eigh(covariance)
        kept = values > RANK_TOLERANCE * np.maximum(values[..., -1:], 1.0)
        inverse_root = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
        target = (vectors * inverse_root[..., None, :]).swapaxes(-1, -2) @ centred
        return cls(
            Problems(covariance, np.ascontiguousarray(centred.transpose(1, 0, 2)), variance),
            count,
            mean_rotation,
            mean,
            np.sqrt(8.0 * np.finfo(float).eps * mean_square),
            np.maximum(variance - np.square(target).sum(axis=1), 0.0),
            np.broadcast_to(kept.sum(axis=-1), count.shape),
        )

    @property
    def variance(self) -> Array:
        """(m, 3) of the readings."""
        return self.problems.variance


@dataclass(frozen=True, eq=False)
class Rivals:
    """Other local minima than the best.

    Attributes:
        channel: whose, in separate fits; None: of all.
        row: (L,) of which data set. field: (L, 3).
        excess: (L, c) how much larger their mean square residuals are.
    """

    channel: int | None
    row: Rows
    field: Array
    excess: Array

    def alike(self, fields: Array, covariance: Array, noise: Array, count: Array, method: Method) -> tuple[Rows, Array]:
        """Those that the data cannot choose against, in a direction that the covariance does not cover.

        Args:
            fields: (m, 3, 3) of the best. covariance: (m, p, p) in the coordinates of ``SensorParameters.jacobian``.
            noise: (m, 3) standard deviation of a reading [recorded unit]. count: (m,) n.
            method: whose coordinates.

        Returns:
            Which of the L, and how much larger their chi-square is.
        """
        k = self.channel or 0
        own_noise = noise[self.row] if self.channel is None else noise[self.row, k : k + 1]
        chi_square = count[self.row] * (self.excess / own_noise**2).sum(axis=1)
        close = np.flatnonzero(chi_square < AMBIGUOUS_CHI_SQUARE)
        row, other = self.row[close], self.field[close]
        best = fields[row, k]
        side = np.where((best * other).sum(axis=1) > 0.0, 1.0, -1.0)
        error = side[:, None] * np.einsum("mai,mi->ma", tangent_basis(best), other)
        columns = [of_field for _, _, of_field in columns_of_channels(method)][k]
        block = covariance[row, columns, columns]
        distance = (error * np.linalg.solve(block, error[:, :, None])[:, :, 0]).sum(axis=1)
        found = close[distance > SAME_SIGMAS**2]
        return found, chi_square[found]


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best solutions of m data sets.

    Attributes:
        fields: (m, 3, 3), base frame. scaled_axes: (m, 3, 3) m_k, frame 6 [recorded unit].
        mean_square: (m, 3) mean square residuals. noise: (m, 3) that the weights rest on.
        converged: (m,). rivals: the other minima.
    """

    fields: Array
    scaled_axes: Array
    mean_square: Array
    noise: Array
    converged: Mask
    rivals: tuple[Rivals, ...]


def simultaneous(data: Centred, given: Array | None, weighting: Weighting) -> Optimum:
    """One field for all three channels.

    Args:
        data: the data sets.
        given: (m, 3) noise; None: from the residuals.
        weighting: as of ``fit_sensor``.
    """
    if given is not None:
        sigma = given
    else:
        left = (data.count - data.rank - 1)[:, None]
        linear = np.maximum(np.sqrt(data.floor * data.count[:, None] / np.maximum(left, 1)), data.rounding)
        sigma = np.where(left > data.rank[:, None], linear, np.sqrt(data.variance))
    root = np.ones_like(sigma) if weighting == "equal" else 1.0 / np.maximum(sigma, 1e-300)
    minima = local_minima(data.problems.weighted(root))
    best = minima.best()
    field, axes = minima.field[:, best], minima.scaled_axes[:, best] / root
    mean_square, converged = minima.mean_square[best] / root**2, minima.converged[best].copy()
    first_root = root
    if given is None and weighting == "likelihood":
        freedom = (data.count - PARAMETERS_OF["simultaneous"] / 3.0)[:, None]
        moving = np.arange(len(root))
        root = root.copy()
        for _ in range(_MOST_WEIGHTS):
            n = data.count[moving, None]
            updated = 1.0 / np.maximum(mean_square[moving] * n / freedom[moving], data.rounding[moving] ** 2)
            change = np.abs(np.log(updated / root[moving] ** 2)).max(axis=1)
            root[moving] = np.sqrt(updated)
            moving = moving[change >= _SETTLED]
            if not moving.size:
                break
            part = data.problems.select(moving).weighted(root[moving])
            again = descend(part, field[:, moving], moving)
            field[:, moving], axes[:, moving] = again.field, again.scaled_axes / root[moving]
            mean_square[moving], converged[moving] = again.mean_square / root[moving] ** 2, again.converged
    rivals = _rivals(minima, minima.mean_square / first_root[minima.problem] ** 2, field, mean_square)
    return Optimum(
        np.repeat(field.T[:, None], 3, axis=1), axes.transpose(1, 2, 0), mean_square, 1.0 / root, converged, (rivals,)
    )


def separate(data: Centred) -> Optimum:
    """Each channel by itself: of data set i those are problems 3 i to 3 i + 2."""
    problems, m = data.problems, len(data.mean)
    covariance = problems.covariance
    minima = local_minima(
        Problems(
            covariance if covariance.ndim == 2 else np.repeat(covariance, 3, axis=0),
            problems.cross.reshape(9, 3 * m, 1),
            problems.variance.reshape(3 * m, 1),
        )
    )
    best = minima.best()
    every = _rivals(minima, minima.mean_square, minima.field[:, best], minima.mean_square[best])
    row, channel = np.divmod(every.row, 3)
    return Optimum(
        minima.field[:, best].T.reshape(m, 3, 3),
        minima.scaled_axes[:, best, 0].T.reshape(m, 3, 3),
        minima.mean_square[best].reshape(m, 3),
        np.ones((m, 3)),
        np.all(minima.converged[best].reshape(m, 3), axis=1),
        tuple(Rivals(k, row[channel == k], every.field[channel == k], every.excess[channel == k]) for k in range(3)),
    )


def _rivals(minima: Minima, mean_square: Array, field: Array, best: Array) -> Rivals:
    """Those of the minima that are not the best: field (3, m), mean square residuals (m, c)."""
    row = minima.problem
    other = np.abs((minima.field * field[:, row]).sum(axis=0)) < 1.0 - _SAME
    return Rivals(None, row[other], minima.field[:, other].T, (mean_square - best[row])[other])


def parameters_of(optimum: Optimum, data: Centred, magnitude: float, points: Array) -> ManyParameters:
    """The parameters of (m,) optima, with the sign that puts each field on the side of ``points`` (m, 3), or of its
    largest component where it lies on neither."""
    fields = optimum.fields
    along = np.einsum("mki,mi->mk", fields, points) / np.linalg.norm(points, axis=1)[:, None]
    largest = np.take_along_axis(fields, np.abs(fields).argmax(axis=2)[:, :, None], axis=2)[:, :, 0]
    sign = np.where(np.where(np.abs(along) < 1e-9, largest, along) >= 0.0, 1.0, -1.0)[:, :, None]
    length = np.maximum(np.sqrt(np.square(optimum.scaled_axes).sum(axis=2)), 1e-300)
    rotation = np.broadcast_to(data.mean_rotation, (len(fields), 9)).reshape(-1, 3, 3)
    offset = data.mean - np.einsum("mki,mij,mkj->mk", fields, rotation, optimum.scaled_axes)
    return ManyParameters(
        magnitude, length / magnitude, offset, sign * optimum.scaled_axes / length[:, :, None], sign * fields
    )
