"""Refitting a set of mean effects for real: all their parameters together, through the whole pipeline."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import Basis, project, side_by_side
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.candidates import Candidate, Shape
from estimators.gap.hypotheses.scan import KEPT, ScoreTest
from estimators.gap.hypotheses.score import ABSORBED, Explained
from estimators.gap.hypotheses.shapes import among, searched
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import Effect
from rig.effects.parameters import Parameter, Value
from rig.environment import MAGNITUDES

#: Strengths are held near zero by a prior of so many typical sizes, inverted: what the calibration absorbs stays there.
_HELD = 1e-2
#: Damping of the first step; the least and the largest.
_DAMPED, _LEAST, _LARGEST = 1e-3, 1e-8, 1e4
#: Squared signal-to-noise of a typical size below which a parameter is not moved: a phase of what has no amplitude.
_UNFELT = 1e-9
#: Chi-square that a step must promise, and the share of the promise that must come for the derivatives to stay.
_FLAT, _STRAIGHT = 0.02, 0.8
#: Chi-square gained since the derivatives were taken, up to which they are still those of the point.
_NEAR = 0.25
#: Values of a phase that are tried before it is fitted.
_PHASES = np.arange(8) * np.pi / 4.0


@dataclass(frozen=True)
class Fitted:
    """A mean effect with its fitted parameters.

    Attributes:
        candidate: effect and place.
        values: (p,) the free parameters, strengths first.
        kept: shapes that are not fitted, and strengths without influence on this recording.
    """

    candidate: Candidate
    values: Array
    kept: Shape

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The fitted parameters: strengths, then shapes."""
        items = [item for item in self.candidate.effect.parameters() if item.name not in self.kept]
        return tuple(sorted(items, key=lambda item: not item.strength))

    @property
    def scale(self) -> Array:
        """(p,) typical sizes."""
        return np.concatenate([np.full(item.size, item.typical) for item in self.free])

    @property
    def step(self) -> Array:
        """(p,) changes over which derivatives are taken."""
        return np.concatenate([np.full(item.size, item.step) for item in self.free])

    @cached_property
    def effect(self) -> Effect:
        """The effect itself; values beyond their bounds are moved to them."""
        numbers = iter(self.values)
        given: dict[str, object] = {"where": self.candidate.where, **self.candidate.names, **self.kept}
        for item in self.free:
            taken = [float(np.clip(number, item.lower, item.upper)) for number in itertools.islice(numbers, item.size)]
            given[item.name] = taken[0] if item.size == 1 else tuple(taken)
        return self.candidate.effect.from_mapping(given)

    def touched(self, data: WhitenedData) -> NDArray[np.bool_]:
        """(6,) the channels whose readings it changes, near the fitted values."""
        moved = replace(self, values=self.values + self.step).effect
        return np.asarray((data.change([moved]) != 0.0).any(axis=0))

    @property
    def moved(self) -> list[Effect]:
        """With each of the values a little larger."""
        return [replace(self, values=self.values + row).effect for row in np.diag(self.step)]

    def tangent(self, data: WhitenedData) -> Array:
        """(c count, p) whitened derivatives at the fitted values, each scaled to a typical size."""
        return tangents([self], data)[0]


def started(tested: ScoreTest, data: WhitenedData, explained: Explained) -> Fitted:
    """The fit's start: the tested's shape, the best of a few phases, and strengths by linear least squares."""
    effect = tested.candidate.effect
    kept = {name: value for name, value in tested.shape.items() if name in KEPT}
    best: tuple[float, Fitted] | None = None
    for spanned in _tries(tested):
        shape: dict[str, Value] = {**tested.shape, **spanned}
        columns = data.whiten_changes(tested.candidate.derivatives(data, shape))
        score = explained.score(columns)
        if best is not None and score.statistic <= best[0]:
            continue
        values, idle = _split(tested.candidate, score.strengths, np.asarray(columns.values.any(axis=0)))
        shapes = [item for item in effect.parameters() if not item.strength and item.name not in kept]
        values += [np.atleast_1d(np.asarray(shape[item.name], dtype=float)) for item in shapes]
        best = (score.statistic, Fitted(tested.candidate, np.concatenate(values), {**kept, **idle}))
    assert best is not None
    return best[1]


def _split(candidate: Candidate, strengths: Array, felt: NDArray[np.bool_]) -> tuple[list[Array], dict[str, Value]]:
    """The strengths that the recording feels, and the neutral values of those it does not."""
    values: list[Array] = []
    idle: dict[str, Value] = {}
    first = 0
    for item in candidate.strengths:
        part = slice(first, first + item.size)
        first += item.size
        if felt[part].any():
            values.append(strengths[part])
        else:
            idle[item.name] = item.neutral if item.size == 1 else (item.neutral,) * item.size
    return values, idle


def _tries(tested: ScoreTest) -> list[dict[str, Value]]:
    """Values of the spanned shapes to start from."""
    effect = tested.candidate.effect
    spanned = {item.name: item for item in effect.parameters() if item.spanned}
    if not spanned:
        return [{}]
    coefficients = tested.score.strengths.reshape(len(effect.spanning()), -1)
    if set(spanned) == {"phase_rad"} and len(effect.spanning()) == 2:  # A sin(x + p) = A cos p sin x + A sin p cos x
        phase = np.arctan2(coefficients[1], coefficients[0])
        item = spanned["phase_rad"]
        return [{"phase_rad": float(phase[0]) if item.size == 1 else tuple(float(x) for x in phase)}]
    if "direction" in spanned:  # (direction, phase) spanned by their products: the nearest product
        names = [dict(span) for span in effect.spanning()]
        table = np.zeros((3, 2))
        for span, coefficient in zip(names, coefficients[:, 0], strict=True):
            table[int(np.argmax(span["direction"])), int(np.asarray(span["phase_rad"]) > 0)] += coefficient
        left, _, right = np.linalg.svd(table)
        return [
            {"direction": tuple(float(x) for x in left[:, 0]), "phase_rad": float(np.arctan2(right[0, 1], right[0, 0]))}
        ]
    return [{"phase_rad": float(phase)} for phase in _PHASES]


@dataclass(frozen=True)
class Refit:
    """Effects fitted together.

    Attributes:
        fits: the effects. data: where.
        left: (c count,) what they leave of the whitened residual; the calibration is not projected out.
        columns: (c count, p) their whitened derivatives there, each for a typical size.
        short: by how much more is left (chi-square) than the calibration's tangent tells, where that is too far off.
    """

    fits: list[Fitted]
    data: WhitenedData
    left: Array
    columns: Array
    short: float = 0.0

    @property
    def misfit(self) -> float:
        """Chi-square, the calibration projected out."""
        taken = self.data.absorbed.along(self.left)
        return float(self.left @ self.left - taken @ taken)

    @property
    def attained(self) -> float:
        """Chi-square that was attained around the calibration that then fits best."""
        return self.misfit + self.short

    @cached_property
    def explained(self) -> Explained:
        """What they leave, with their tangents explained."""
        absorbed = self.data.absorbed
        if not self.fits:
            return Explained(absorbed, self.data.whitened)
        return Explained(absorbed, project(absorbed, self.left)).extended(self.columns)


def refit(fits: Sequence[Fitted], data: WhitenedData, most: int = 24, held: Array | None = None) -> Refit:
    """All parameters of all effects together by nonlinear least squares.

    The calibration moves along its tangent, which is projected out. Strengths are held near nothing, and shapes among
    what is searched: a warm-up slower than the recording tells no time, only a slope. The derivatives, which cost most,
    are taken anew only where the misfit does not fall as they foretold (Levenberg-Marquardt with a chord: Nocedal and
    Wright, Numerical Optimization, 2006, section 10.3; Kelley, Iterative Methods, 1995, section 5.4).

    Args:
        most: steps at most. held: (p,) prior precisions of the strengths, in typical sizes; by default next to none.
    """
    fits = list(fits)
    if not fits:
        return at(fits, data)
    scale = np.concatenate([each.scale for each in fits])
    problem = _Problem(fits, data, held)
    here = problem.at(np.concatenate([each.values for each in fits]) / scale)
    slopes, damping, gone = problem.slopes(here), _DAMPED, 0.0
    if data.in_place and slopes.to_gain(here, home := slopes.home(here)) > _FLAT:
        ahead = problem.at(here.point + home)
        if ahead.misfit < here.misfit:
            here = ahead
            slopes = problem.slopes(here)
    for _ in range(most):
        step = slopes.step(here, damping)
        ahead = problem.at(here.point + step)
        promised, kept = slopes.promise(here, step), here.misfit - ahead.misfit
        if kept > 0.0:
            here, damping, gone = ahead, max(damping / 10.0, _LEAST), gone + kept
        else:
            damping *= 10.0
        if promised < _FLAT or damping > _LARGEST:
            break
        if slopes.at is not here.point and kept < _STRAIGHT * promised:
            slopes, gone = problem.slopes(here), 0.0
    if gone > _NEAR:
        slopes = problem.slopes(here)
    return Refit(here.fits, data, here.left, slopes.columns)


@dataclass(frozen=True)
class _Point:
    """Parameters (p,) in typical sizes, the effects there, what they change of the readings (n, 6) and leave of the
    whitened residual, its misfit; how far the prior's mean is away, and its precisions (p,)."""

    point: Array
    fits: list[Fitted]
    change: Array
    left: Array
    misfit: float
    away: Array
    precision: Array


@dataclass(frozen=True)
class _Slopes:
    """Whitened derivatives (c count, p) at a point; their Gram matrix, the calibration projected out, the prior's
    precisions (p,) in."""

    at: Array
    columns: Array
    gram: Array
    absorbed: Basis
    precision: Array

    def moment(self, here: _Point) -> Array:
        """(p,) minus half the misfit's gradient."""
        return np.asarray(self.columns.T @ project(self.absorbed, here.left) + here.precision * here.away)

    @cached_property
    def _directions(self) -> tuple[Array, Array, Array]:
        """(p,) lengths of the columns; (p,) values and (p, p) vectors of the Gram matrix of columns of unit length."""
        length = np.sqrt(np.einsum("ij,ij->j", self.columns, self.columns) + self.precision + _UNFELT)
        return length, *np.linalg.eigh(self.gram / np.outer(length, length))

    def step(self, here: _Point, damping: float) -> Array:
        """(p,), in the directions that the calibration does not absorb."""
        length, values, vectors = self._directions
        free = values > ABSORBED**2
        along = vectors[:, free].T @ (self.moment(here) / length)
        return np.asarray(vectors[:, free] @ (along / (values[free] + damping)) / length)

    def home(self, here: _Point) -> Array:
        """(p,) to where the prior would have it, in the directions that the calibration absorbs."""
        length, values, vectors = self._directions
        root = np.sqrt(here.precision)
        absorbed = vectors[:, values <= ABSORBED**2] / length[:, None]
        return np.asarray(absorbed @ np.linalg.lstsq(root[:, None] * absorbed, root * here.away, rcond=1e-9)[0])

    @staticmethod
    def to_gain(here: _Point, home: Array) -> float:
        """By how much the prior's part of the misfit should fall."""
        return float(here.precision @ (here.away**2 - (here.away - home) ** 2))

    def promise(self, here: _Point, step: Array) -> float:
        """By how much the misfit should fall."""
        return float(step @ (2.0 * self.moment(here) - self.gram @ step))


@dataclass(frozen=True)
class _Problem:
    """Effects to be fitted; the prior precisions (p,) of their strengths."""

    fits: Sequence[Fitted]
    data: WhitenedData
    held: Array | None = None

    def at(self, point: Array) -> _Point:
        """The misfit (chi-square) with the calibration's tangent projected out; infinite beyond what can be said."""
        numbers = iter(point)
        fits = [
            replace(each, values=np.array(list(itertools.islice(numbers, len(each.values)))) * each.scale)
            for each in self.fits
        ]
        if not all((np.abs(each.values) <= MAGNITUDES[1]).all() for each in fits):
            return _Point(point, fits, np.zeros(0), np.zeros(0), np.inf, np.zeros(0), np.zeros(0))
        change = self.data.change([each.effect for each in fits])
        left = self.data.whiten(self.data.residual - change)
        absorbed = self.data.absorbed.along(left)
        away, precision = self._expected(point, fits)
        misfit = float(left @ left - absorbed @ absorbed + precision @ away**2)
        return _Point(point, fits, change, left, misfit, away, precision)

    def _expected(self, point: Array, fits: Sequence[Fitted]) -> tuple[Array, Array]:
        """How far the prior's mean is away, and its precisions: of strengths about nothing, of searched shapes among
        the values that are searched. What nothing holds may lie anywhere."""
        away, precision, first = -point, np.zeros(len(point)), 0
        for each, grids in zip(fits, self.searched, strict=True):
            for item in each.free:
                own = slice(first, first := first + item.size)
                if item.strength:
                    precision[own] = _HELD**2 if self.held is None else self.held[own]
                elif grids[item.name]:
                    away[own], width = among(getattr(each.effect, item.name), item, grids[item.name])
                    precision[own] = 1.0 / width**2
        return away, precision

    @cached_property
    def searched(self) -> list[dict[str, tuple[Array, ...]]]:
        """Of each effect's parameters the values that are searched, which are the same wherever it is fitted."""
        effects = [(each.candidate.effect, each.free) for each in self.fits]
        return [{item.name: searched(effect, item, self.data) for item in free} for effect, free in effects]

    @cached_property
    def touched(self) -> list[NDArray[np.bool_]]:
        """The channels of each effect, which are the same wherever it is fitted."""
        return touched_by(self.fits, self.data)

    def slopes(self, here: _Point) -> _Slopes:
        """The derivatives at a point."""
        columns = side_by_side(*tangents(here.fits, self.data, self.touched, here.change))
        shared = self.data.absorbed.along(columns)
        gram = columns.T @ columns - shared.T @ shared + np.diag(here.precision)
        return _Slopes(here.point, columns, gram, self.data.absorbed, here.precision)


def touched_by(fits: Sequence[Fitted], data: WhitenedData) -> list[NDArray[np.bool_]]:
    """The channels that matter to each effect: those that it touches, all where it touches none yet."""
    if len(fits) == 1 or any(each.candidate.names for each in fits):  # what a channel's reading does to another's
        return [np.ones(len(CHANNELS), dtype=bool) for _ in fits]
    touched = [each.touched(data) for each in fits]
    return [own if own.any() else ~own for own in touched]


def tangents(
    fits: Sequence[Fitted],
    data: WhitenedData,
    touched: Sequence[NDArray[np.bool_]] | None = None,
    change: Array | None = None,
) -> list[Array]:
    """The tangent of each fitted effect with the others in place: those that touch a channel that it touches.

    Args:
        touched: as ``touched_by``, where it is known. change: (n, 6) of the readings by all, where it is known.
    """
    touched = touched_by(fits, data) if touched is None else touched
    change = data.change([each.effect for each in fits]) if change is None else change
    return [tangent_of(index, fits, data, touched, change) for index in range(len(fits))]


def tangent_of(
    index: int, fits: Sequence[Fitted], data: WhitenedData, touched: Sequence[NDArray[np.bool_]], change: Array
) -> Array:
    """(c count, p) the tangent of one of some fitted effects, as ``tangents`` makes that of each."""
    each, here, effects = fits[index], touched[index], [fit.effect for fit in fits]
    near = [number for number, own in enumerate(touched) if number == index or (here & own).any()]
    beside = [effects[number] for number in near]

    def slopes() -> Iterator[Array]:
        moves = data.changes(beside, near.index(index), each.moved, here)
        for moved, size in zip(moves, each.step / each.scale, strict=True):
            slope = np.zeros_like(change)
            slope[:, here] = (moved[:, here] - change[:, here]) / size
            yield slope

    return data.whiten_changes(slopes()).full(data.size)


def at(fits: Sequence[Fitted], data: WhitenedData) -> Refit:
    """Effects as they were fitted elsewhere, in whitened data."""
    if not fits:
        return Refit([], data, data.whitened, np.zeros((data.size, 0)))
    change = data.change([each.effect for each in fits])
    left = data.whiten(data.residual - change)
    return Refit(list(fits), data, left, side_by_side(*tangents(fits, data, change=change)))


def explained_by(fits: Sequence[Fitted], data: WhitenedData) -> Explained:
    """What fitted effects leave of the residual in whitened data, with their tangents explained."""
    return at(fits, data).explained
