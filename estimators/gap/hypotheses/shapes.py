"""What is expected of shapes before the data: times, places and frequencies among those that are searched."""

from __future__ import annotations

from typing import Final

import numpy as np

from estimators.gap.data.stack import part_of
from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array
from rig.effects import Effect
from rig.effects.parameters import Parameter

#: One over the density of a normal number of width one, where it is highest.
_NORMAL: Final = float(np.sqrt(2.0 * np.pi))


def shape_prior(effect: Effect, item: Parameter, data: WhitenedData) -> tuple[Array, Array]:
    """Prior mean less the value, and prior width, of a parameter's components in typical sizes.

    A shape that is searched on a grid is normal in the grid's steps, about its middle, with the density of its values
    there; a tone's frequency has a density of one over its band, a phase of one over half a turn, as the strength has
    either sign; others are expected where they are.

    Args:
        effect: with its values. item: one of its parameters.
    """
    nothing = np.zeros(item.size)
    if item.name == "freq_Hz" and effect.tone:
        own = data.parts[part_of(type(effect)) or 0]
        band = sum(high - low for low, high in effect.bands) if effect.bands else 0.5 * own.samples / own.interval_s
        return nothing, nothing + band / _NORMAL / item.typical
    if item.spanned and not item.unit_vector:
        return nothing, nothing + np.pi / _NORMAL / item.typical
    grids = searched(type(effect), item, data)
    if not grids:
        return nothing, nothing + 1.0
    return among(getattr(effect, item.name), item, grids)


def among(value: object, item: Parameter, grids: tuple[Array, ...]) -> tuple[Array, Array]:
    """The same of a shape that is searched, from its value and its ``searched`` ones."""
    values = np.atleast_1d(np.asarray(value, dtype=float))
    places = [_place(own, grid) for own, grid in zip(values, grids, strict=True)]
    away = [(0.5 * (len(grid) - 1) - place) * step for (place, step), grid in zip(places, grids, strict=True)]
    width = [len(grid) * step / _NORMAL for (_, step), grid in zip(places, grids, strict=True)]
    return np.array(away) / item.typical, np.array(width) / item.typical


def searched(effect: type[Effect], item: Parameter, data: WhitenedData) -> tuple[Array, ...]:
    """The values of each component of a shape that is searched on a grid; none of what is not."""
    return () if item.strength else effect.ranges(data.base).get(item.name, ())


def _place(value: float, grid: Array) -> tuple[float, float]:
    """Where a value is in an even or a geometric grid, in its steps, beyond its ends too; and the step there."""
    if value > 0.0 and grid[0] > 0.0 and np.allclose(grid[1:] / grid[:-1], ratio := grid[1] / grid[0]):
        return float(np.log(value / grid[0]) / np.log(ratio)), value * float(np.log(ratio))
    step = float(grid[1] - grid[0])
    return float(value - grid[0]) / step, step
