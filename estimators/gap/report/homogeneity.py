"""Whether what an effect does beside something outside the catalogue is one strength, or an image of that.

A cause has the same strength at every time and pose. Something that no effect describes is taken up by effects that do
part of the same, here more and there less. Both are fitted to how the strength varies from cell to cell along time and
along each of the arm's coordinates, as a random effect (DerSimonian and Laird, Controlled Clinical Trials 7, 1986) with
a memory: a Gaussian process, to which a cause adds its common strength and an image nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.ndimage import uniform_filter1d
from scipy.special import gammaln

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.terms import Term
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.prior import LENGTHS
from estimators.gap.hypotheses.stochastic import EVERY, FittedNoise, Left
from estimators.gap.search.explanation import Explanation
from rig.arrays import Array

#: Cells along a variable, as many as the shortest memory tells apart; samples in each at least, of noise squares.
_CELLS: Final = 64
_SAMPLES: Final = 4
_SQUARES: Final = 16
#: Cells whose products with a discrepancy are made at once: of a long recording all would be large.
_AT_ONCE: Final = 8
#: What moves the mean is alike in so many neighbouring readings.
_NEIGHBOURS: Final = 16
#: Scatter of the strength over the strength itself.
SCATTER: Final = np.geomspace(0.01, 10.0, 31)
#: A coordinate that varies less, in its own unit, is no variable.
_STILL: Final = 1e-3
_LEAST: Final = 1e-9


def log_bayes_factor(explanation: Explanation, index: int, beside: Weighed | None = None) -> float:
    """Log of how much likelier one effect of a set is a cause than an image: the largest that a prior of its strength
    gives; an image may vary along any one of the variables.

    Args:
        index: its number in the set. beside: a discrepancy that is there; what it could do as well tells nothing.
    """
    data, along = explanation.data, explanation.own_columns[index]
    channels = len(data.columns)
    information = np.sum(along.reshape(channels, -1) ** 2, axis=0)
    score = np.sum((along * explanation.linear.left).reshape(channels, -1), axis=0)
    cells = min(_CELLS, data.count // _SAMPLES)
    if cells < 2 or not information.sum() > 0.0:
        return 0.0
    if beside is None:
        return _against_any([of_cells(*_in_cells(information, score, each, cells)) for each in _variables(data)])
    shrunk = beside.term.shrunk[0][int(np.argmax(beside.gains))]
    left = shrunk * beside.term.along(explanation.linear.left[:, None])[:, 0]
    found = []
    for variable in _variables(data):
        strength, known = _in_cells(information, score, variable, cells)
        taken = _taken(beside.term, along, _cells(variable, cells), cells)
        moment = known * (strength - 1.0) - taken.T @ left
        found.append(of_strengths(np.diag(known) - taken.T @ (shrunk[:, None] * taken), moment))
    return _against_any(found)


def log_bayes_factor_of_noise(fitted: FittedNoise, lefts: Sequence[Left]) -> float:
    """The same of a noise effect, whose strength is its variance.

    Args:
        lefts: what is left of each recording under the floor, whitened by the floor alone.
    """
    if fitted.part != EVERY:
        return sum(_of_noise(each.added, each.in_time, lefts[each.part]) for each in fitted.every)
    ends = np.cumsum([left.data.count for left in lefts])[:-1]
    each_added = np.split(fitted.added[: sum(left.data.count for left in lefts)], ends)
    return sum(_of_noise(added, fitted.in_time, left) for added, left in zip(each_added, lefts, strict=True))


def log_bayes_factor_of_readings(affected: NDArray[np.bool_], data: WhitenedData) -> float:
    """The same of single readings that are off: those of a cause may be anywhere, an image's are where the unknown is.

    Counts in cells are multinomial with equal shares, or with shares that have a symmetric Dirichlet distribution.

    Args:
        affected: (n,) of a recording; of a long one that ``data`` has means of, of every sample.
    """
    at = np.flatnonzero(affected) * data.count // max(len(affected), 1)
    cells = min(_CELLS, data.count // _SAMPLES)
    if cells < 2 or not len(at):
        return 0.0
    spread = SCATTER[:, None] / cells
    images = []
    for variable in _variables(data):
        found = np.bincount(_cells(variable, cells)[at], minlength=cells)
        shares = gammaln(spread + found).sum(axis=1) - cells * gammaln(spread[:, 0])
        shares += gammaln(cells * spread[:, 0]) - gammaln(cells * spread[:, 0] + len(at))
        images.append(-len(at) * np.log(cells) - float(np.logaddexp.reduce(shares) - np.log(len(spread))))
    return _against_any(images)


def _of_noise(variance: Array, in_time: bool, left: Left) -> float:
    data = left.data
    columns = [column for column in data.columns if np.any(variance[:, column] > 0.0)]
    if not columns:
        return 0.0
    own = np.stack([data.channel(left.explained.residual, column) for column in columns])
    added = variance[:, columns].T
    share = added / (1.0 + added)
    information = 0.5 * np.sum(share**2, axis=0)
    cells = min(_CELLS, int(information.sum() / (0.5 * share.max() ** 2) / _SQUARES))
    if cells < 2:
        return 0.0
    if in_time:
        slow = uniform_filter1d(own, _NEIGHBOURS, axis=1)
        square = (own - slow) ** 2 / (1.0 - 1.0 / _NEIGHBOURS)
        score = 0.5 * np.sum(share * (square / (1.0 + added) - 1.0), axis=0)
    else:  # of its spectrum, in time
        fitting = idct(dct(own, norm="ortho") * np.sqrt(share / (1.0 + added)), norm="ortho")
        score = 0.5 * np.sum(fitting**2 - share.mean(axis=1)[:, None], axis=0)
        information = np.full(data.count, information.mean())
    return _against_any([of_cells(*_in_cells(information, score, each, cells)) for each in _variables(data)])


def _against_any(images: Sequence[float]) -> float:
    """Log Bayes factor against images of which any one may be, from those against each."""
    return float(np.log(len(images)) - np.logaddexp.reduce([-each for each in images]))


def _variables(data: WhitenedData) -> Iterator[Array]:
    """(n,) each: time, and what the pose is described by."""
    base = data.base
    yield np.arange(data.count, dtype=float)
    if (q := base.q_encoder) is not None:
        velocity = base.joint_velocity
        for joint in np.flatnonzero(np.ptp(q, axis=0) > _STILL):
            angle = np.mod(q[:, joint], 2.0 * np.pi)
            yield angle
            if np.ptp(direction := np.sign(velocity[:, joint])) > 0.0:
                yield angle + 2.0 * np.pi * direction
    else:
        pose = base.R_base_tool.reshape(len(base.R_base_tool), 9)
        coordinates = np.column_stack([pose, base.position]) if base.position.size else pose
        yield from coordinates[:, np.ptp(coordinates, axis=0) > _STILL].T
    if (warm := base.temperature) is not None and np.ptp(warm) > 0.0:
        yield warm


def _in_cells(information: Array, score: Array, variable: Array, cells: int) -> tuple[Array, Array]:
    """(cells,) strength in each, over the fitted one, and the information there."""
    cell = _cells(variable, cells)
    known = np.maximum(np.bincount(cell, information, cells), _LEAST * information.sum())
    return 1.0 + np.bincount(cell, score, cells) / known, known


def _taken(term: Term, along: Array, cell: NDArray[np.intp], cells: int) -> Array:
    """(r, cells) products of a discrepancy with what an effect (c n,) does in each cell."""
    found = []
    for some in np.array_split(np.arange(cells), max(cells // _AT_ONCE, 1)):
        there = cell[:, None] == some
        found.append(term.along((along.reshape(-1, len(cell), 1) * there).reshape(-1, len(some))))
    return np.hstack(found)


def _cells(variable: Array, cells: int) -> NDArray[np.intp]:
    """(n,) the cell of each sample, of so many with as many samples each."""
    cell = np.empty(len(variable), dtype=np.intp)
    cell[np.argsort(variable, kind="stable")] = np.arange(len(variable)) * cells // len(variable)
    return cell


def of_cells(strength: Array, information: Array) -> float:
    """Log of the evidence of a common strength beside a process over that of the process alone.

    Args:
        strength: (cells,) in each, over the fitted one; along a variable. information: (cells,) 1 / variance of each.
    """
    return of_strengths(np.diag(information), information * (strength - 1.0))


def of_strengths(gram: Array, moment: Array) -> float:
    """The same of strengths whose errors depend on each other.

    Args:
        gram: (cells, cells) information. moment: (cells,) the score at the fitted strength.
    """
    cells = len(gram)
    place = (np.arange(cells) + 0.5) / cells
    own, vectors = np.linalg.eigh(gram)
    kept = own > _LEAST * own[-1]
    root = np.sqrt(own[kept])[:, None] * vectors[:, kept].T
    whole = root.sum(axis=1)
    strength = whole + (vectors[:, kept].T @ moment) / np.sqrt(own[kept])
    cause, image = [], []
    for length in LENGTHS:
        apart = np.sqrt(3.0) * np.abs(place[:, None] - place) / length
        values, turned = np.linalg.eigh(root @ ((1.0 + apart) * np.exp(-apart)) @ root.T)  # Matern 3/2
        seen, common = turned.T @ strength, turned.T @ whole
        variance = 1.0 + SCATTER[:, None] ** 2 * np.maximum(values, 0.0)
        alone = -0.5 * np.sum(np.log(variance) + seen**2 / variance, axis=1)
        size, both = np.sum(common**2 / variance, axis=1), np.sum(seen * common / variance, axis=1)
        image.append(alone)
        cause.append(alone - 0.5 * np.log1p(size) + 0.5 * both**2 / (1.0 + size))
    return float(np.logaddexp.reduce(np.ravel(cause)) - np.logaddexp.reduce(np.ravel(image)))
