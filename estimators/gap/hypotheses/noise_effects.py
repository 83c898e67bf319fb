"""Which noise effects of the catalogue a residual shows: each at every place, at its likeliest shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.shapes import among, searched
from estimators.gap.hypotheses.stochastic import FittedNoise, Left, fitted_at
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.effects.parameters import Value

#: Twice a gain from which on a shape is fitted between those of the grid, and how much nearer its neighbours are then.
_WORTH, _NARROWER = 30.0, 0.15
#: How much more power noise that remembers has at some frequency than at others, at least: of a first-order
#: autoregression with a third of it in common from reading to reading. As one name for three channels costs less than
#: three, what is nearly white would have it else.
_COLOURED: Final = 4.0
#: So many steps beyond the grid at most.
_BEYOND: Final = 4


def fitted_noises(left: Left, without: Sequence[str] = ()) -> list[FittedNoise]:
    """Every noise effect at every place, the most evident first."""
    noises, data = [], left.data
    for effect in EFFECTS.values():
        if effect.kind is not Kind.NOISE or effect.name in without or effect.lacking(data.base):
            continue
        if effect.response is not Effect.response:  # one error for all channels: see ``common``
            continue
        for where in effect.places_on(data.base):
            fitted = fit_effect(effect, where, left)
            if fitted is not None:
                noises.append(fitted)
    return sorted(noises, key=lambda fitted: -fitted.evidence)


def fit_effect(effect: type[Effect], where: str, left: Left) -> FittedNoise | None:
    """One noise effect's strengths by maximum likelihood, at its best shape; None where its channels are not there."""
    shapes = [shape for shape in effect.searched(left.data.base) if not _is_white(effect, shape, left.data)]
    tried = [each for each in (fitted_at(effect, where, left, shape) for shape in shapes) if each is not None]
    if not tried:
        return None
    best, rare = max(tried, key=lambda each: each.gain), 1.0
    if len(shapes[0]) == 1 and len(tried) > 2 and best.gain > _WORTH and _positive(shapes):
        (name,) = shapes[0]

        def at(point: float) -> FittedNoise:
            return fitted_at(effect, where, left, {name: float(np.exp(point))}) or best

        gains = {float(np.log(float(str(shape[name])))): each.gain for shape, each in zip(shapes, tried, strict=True)}
        for _ in range(_BEYOND):
            points = sorted(gains)
            index = points.index(max(gains, key=lambda point: gains[point]))
            if 0 < index < len(points) - 1:
                break
            beyond = 2.0 * points[index] - points[1 if index == 0 else -2]
            if _is_white(effect, {name: float(np.exp(beyond))}, left.data):
                break
            gains[beyond] = at(beyond).gain
        points = sorted(gains)
        index = min(max(points.index(max(gains, key=lambda point: gains[point])), 1), len(points) - 2)
        near = points[index - 1 : index + 2]
        best = _between(at, name, np.array(near), np.array([gains[point] for point in near]))
        (item,) = [each for each in effect.parameters() if each.name == name]
        away, width = among(getattr(best.effect, name), item, searched(effect, item, left.data))
        rare = float(np.exp(0.5 * np.sum((away / width) ** 2)))
    return replace(best, searched=len(shapes) * rare)


def _is_white(effect: type[Effect], shape: Mapping[str, Value], data: WhitenedData) -> bool:
    """Whether noise that remembers is, at a shape and as often as readings are taken, hardly other than white: that is
    another effect, channel by channel."""
    if not shape:
        return False
    frequency, interval_s = np.array([0.5 / (data.count * data.samples), 0.5]), data.interval_s / data.samples
    powers = effect.from_mapping({"where": effect.places[0], **shape}).added_spectrum(frequency, interval_s)
    return bool(powers.max() < _COLOURED * powers.min())


def _positive(shapes: Sequence[Mapping[str, Value]]) -> bool:
    """Whether all of a grid have a logarithm: one that begins at zero, as the time of pose noise, is taken as it is."""
    return all(float(str(value)) > 0.0 for shape in shapes for value in shape.values())


def _between(at: Callable[[float], FittedNoise], name: str, grid: Array, gains: Array) -> FittedNoise:
    """The likeliest shape between those of a grid, by parabolas; what it leaves open widens the strengths.

    Args:
        at: fits at a logarithm of the shape. grid, gains: three of these about the best, and twice the gain.
    """
    middle, _ = _vertex(grid, gains)
    step = _NARROWER * float(grid[2] - grid[0])
    points = middle + step * np.array([-1.0, 0.0, 1.0])
    near = [at(float(point)) for point in points]
    top, curvature = _vertex(points, np.array([each.gain for each in near]))
    best = at(top)
    if curvature >= 0.0:
        return best
    width = float(np.sqrt(-2.0 / curvature))  # of twice a log likelihood
    low, high = (np.atleast_1d(np.asarray(each.effect.strengths, dtype=float))[: each.rank] for each in near[::2])
    std = np.hypot(best.std, (high - low) / (2.0 * step) * width)
    return replace(best, std=std, widths={name: float(np.exp(top)) * width})


def _vertex(points: Array, values: Array) -> tuple[float, float]:
    """Where a parabola through three points is highest, no farther than these, and its second derivative."""
    second, first, _ = np.polyfit(points - points[1], values, 2)
    if second >= 0.0:
        return float(points[int(np.argmax(values))]), 2.0 * float(second)
    return float(np.clip(points[1] - 0.5 * first / second, points[0], points[2])), 2.0 * float(second)
