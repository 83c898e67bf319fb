"""Refitting a set of mean effects for real: all their parameters together, through the whole pipeline."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from estimators.gap.bench import Bench, project
from estimators.gap.candidates import STEP, Candidate, Shape
from estimators.gap.scan import Offer
from estimators.gap.score import Explained
from rig.effects import Effect
from rig.effects.base import Parameter, Value

Array = NDArray[np.float64]

#: Shapes that a fit cannot move smoothly: found by the scan and kept.
_FIXED = ("at_s", "order")
#: Strengths are held near zero by a prior of so many typical sizes, inverted: what the calibration absorbs stays there.
_HELD = 1e-2
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
    def effect(self) -> Effect:
        """The effect itself; values beyond their bounds are moved to them."""
        numbers = iter(self.values)
        given: dict[str, object] = {"where": self.candidate.where, **self.candidate.names, **self.kept}
        for item in self.free:
            taken = [float(np.clip(number, item.lower, item.upper)) for number in itertools.islice(numbers, item.size)]
            given[item.name] = taken[0] if item.size == 1 else tuple(taken)
        return self.candidate.effect.from_mapping(given)

    def tangent(self, bench: Bench, others: Sequence[Effect] = ()) -> Array:
        """(c count, p) whitened derivatives at the fitted values, each scaled to a typical size."""
        still = bench.change([self.effect, *others])
        parts = []
        for row in np.diag(STEP * self.scale):
            moved = replace(self, values=self.values + row)
            parts.append((bench.change([moved.effect, *others]) - still) / STEP)
        columns = bench.whiten_changes(parts)
        full = np.zeros((len(parts), bench.size)).T
        full[columns.rows] = columns.values
        return full


def started(offer: Offer, bench: Bench, explained: Explained) -> Fitted:
    """The fit's start: the offer's shape, the best of a few phases, and strengths by linear least squares."""
    effect = offer.candidate.effect
    kept = {name: value for name, value in offer.shape.items() if name in _FIXED}
    best: tuple[float, Fitted] | None = None
    for spanned in _tries(offer):
        shape: dict[str, Value] = {**offer.shape, **spanned}
        columns = bench.whiten_changes(offer.candidate.derivatives(bench, shape))
        score = explained.score(columns)
        if best is not None and score.statistic <= best[0]:
            continue
        values, idle = _split(offer.candidate, score.strengths, np.asarray(columns.values.any(axis=0)))
        shapes = [item for item in effect.parameters() if not item.strength and item.name not in kept]
        values += [np.atleast_1d(np.asarray(shape[item.name], dtype=float)) for item in shapes]
        best = (score.statistic, Fitted(offer.candidate, np.concatenate(values), {**kept, **idle}))
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


def _tries(offer: Offer) -> list[dict[str, Value]]:
    """Values of the spanned shapes to start from."""
    effect = offer.candidate.effect
    spanned = {item.name: item for item in effect.parameters() if item.spanned}
    if not spanned:
        return [{}]
    coefficients = offer.score.strengths.reshape(len(effect.spanning()), -1)
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


def refit(fits: Sequence[Fitted], bench: Bench, most: int = 6) -> tuple[list[Fitted], Explained]:
    """All parameters of all effects together by nonlinear least squares; and what they leave.

    The calibration moves along its tangent, which is projected out.

    Args:
        most: evaluations at most, those for derivatives not counted.
    """
    fits = list(fits)
    if not fits:
        return fits, explained_by(fits, bench)
    sizes = np.cumsum([0] + [len(each.values) for each in fits])
    scale = np.concatenate([each.scale for each in fits])
    start = np.concatenate([each.values for each in fits]) / scale

    def moved(point: Array) -> list[Fitted]:
        values = point * scale
        return [
            replace(each, values=values[first:last])
            for each, first, last in zip(fits, sizes[:-1], sizes[1:], strict=True)
        ]

    held = _HELD * np.concatenate([np.full(item.size, float(item.strength)) for each in fits for item in each.free])

    def left(point: Array) -> Array:
        effects = [each.effect for each in moved(point)]
        white = bench.whitened - project(bench.absorbed, bench.whiten(bench.change(effects)))
        return np.concatenate([white, held * point])

    found = least_squares(left, start, method="trf", x_scale="jac", diff_step=1e-4, max_nfev=most, ftol=1e-6, xtol=1e-6)
    fits = moved(found.x if 2.0 * found.cost <= float(left(start) @ left(start)) else start)
    return fits, explained_by(fits, bench)


def explained_by(fits: Sequence[Fitted], bench: Bench) -> Explained:
    """What fitted effects leave of the residual on a bench, with their tangents explained."""
    calibrated = Explained(bench.absorbed, bench.whitened)
    if not fits:
        return calibrated
    effects = [each.effect for each in fits]
    columns = [
        each.tangent(bench, [other for other in effects if other is not own])
        for each, own in zip(fits, effects, strict=True)
    ]
    left = bench.whitened - project(bench.absorbed, bench.whiten(bench.change(effects)))
    return Explained(bench.absorbed, left).extended(np.hstack(columns))
