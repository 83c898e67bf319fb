"""A spectrum without a name: a level in each of some bands, halved where that is likelier.

The bands are the leaves of binary trees, one in each octave. Of all trees the likeliest is found from the leaves
upwards (Donoho, Annals of Statistics 25, 1997: dyadic trees pruned by what their leaves cost). So noise may fall with
frequency as well as stand in a line that wanders.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from rig.arrays import Array, Mask

#: Log range of a band's excess before the data.
RANGE: Final = 12.0
#: Probability that a band is halved.
_HALVED: Final = 0.25
#: A band of so many cosines is not halved, as a line that does not wander is a tone.
_NARROW: Final = 16


def piecewise(power: Array, least: float = 1.0, alike: int = 1) -> tuple[float, float, Array]:
    """The gain in log likelihood of the likeliest bands against a level of one, what they cost, and their levels (m,).

    Args:
        power: (m,) squares of a cosine transform without its mean, of mean one without excess.
        least: level that none falls below.
        alike: so many channels have one spectrum; ``power`` is then the sum of theirs.
    """
    size = 2 ** int(np.ceil(np.log2(len(power) + 1)))
    sums, many = [np.zeros(size)], [np.zeros(size)]
    sums[0][1 : len(power) + 1], many[0][1 : len(power) + 1] = power, float(alike)
    while len(sums[-1]) > 2:
        sums.append(sums[-1].reshape(-1, 2).sum(axis=1))
        many.append(many[-1].reshape(-1, 2).sum(axis=1))
    first = np.cumsum([0, *map(len, sums)])
    gains, costs, raised = _bands(np.concatenate(sums), np.concatenate(many), least)
    alone = np.maximum(gains - costs, 0.0)
    worth, halved = np.zeros(size), list[Mask]()
    for level, own in enumerate(alone[start:end] for start, end in pairwise(first)):
        if 2**level > _NARROW:
            apart = worth.reshape(-1, 2).sum(axis=1) + np.log(_HALVED)
            own = own + np.log(1.0 - _HALVED)
            halved.append(apart > own)
            worth = np.maximum(apart, own)
        else:
            halved.append(np.zeros(len(own), dtype=bool))
            worth = own
    gain, cost, levels = 0.0, 0.0, np.ones(size)
    open_bands = [(level, 1) for level in range(len(sums))]  # octaves
    while open_bands:
        level, index = open_bands.pop()
        if halved[level][index]:
            cost -= float(np.log(_HALVED))
            open_bands += [(level - 1, 2 * index), (level - 1, 2 * index + 1)]
            continue
        if 2**level > _NARROW:
            cost -= float(np.log(1.0 - _HALVED))
        place = first[level] + index
        if gains[place] > costs[place]:
            gain, cost = gain + float(gains[place]), cost + float(costs[place])
            levels[index * 2**level : (index + 1) * 2**level] = raised[place]
    return gain, cost, levels[1 : len(power) + 1]


def _bands(sums: Array, many: Array, least: float) -> tuple[Array, Array, Array]:
    """Gain, cost and level of bands of so many cosines each, from the sums of their squares."""
    counted = np.maximum(many, 1.0)
    ratio = np.where(many > 0, sums / counted, 1.0)
    raised = np.maximum(ratio, least)
    return (
        0.5 * many * (ratio - np.log(raised) - ratio / raised),
        np.log(RANGE / np.sqrt(4.0 * np.pi / counted)),
        raised,
    )
