"""The floor as loud at each time as the sweep shows, as far as its level was seen to change at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.projection import Columns
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.states import NoiseState, refined
from estimators.gap.floor.unsteady import Unsteady
from estimators.gap.hypotheses.prior import FLOOR_MOVED
from estimators.gap.hypotheses.stochastic import Left

#: The state of such a floor.
UNSTEADY: Final = "unsteady floor"


def unsteady_floor(lefts: Sequence[Left]) -> NoiseState | None:
    """The logarithm of the variance is a process in time as it was at rest, at its likeliest given what is left.

    None where no channel's noise is unsteady at rest, or the sweep does not show it.

    Args:
        lefts: of each recording.
    """
    steps, weight = list[Step](), float(np.log(FLOOR_MOVED))
    for number, left in enumerate(lefts):
        for unsteady, columns in _together(left.data).items():
            here = left.data.weights[:, columns] > 0.0
            white = np.array([left.data.channel(left.explained.residual, column) for column in columns])
            many, squares = here.sum(axis=1).astype(float), np.sum(white**2, axis=0)
            inverse, price, gained = unsteady.inverse_variance(squares, many, left.data.interval_s)
            if gained > 0.0:
                weight += price
                steps += [
                    Step(column, np.where(there, np.sqrt(inverse), 1.0), True, number, of_floor=True)
                    for column, there in zip(columns, here.T, strict=True)
                ]
    if not steps:
        return None
    under = [_after(left, [step for step in steps if step.part == number]) for number, left in enumerate(lefts)]
    return refined(NoiseState(UNSTEADY, (), tuple(steps), weight), under)


def _together(data: WhitenedData) -> dict[Unsteady, list[int]]:
    """Channels that have a level in common."""
    found: dict[Unsteady, list[int]] = {}
    for column in data.columns:
        if (unsteady := data.floor[column].unsteady) is not None:
            found.setdefault(unsteady, []).append(column)
    return found


def _after(left: Left, steps: Sequence[Step]) -> Left:
    """What is left of a recording, after further steps of whitening."""
    own = [replace(step, part=0) for step in steps]
    residual = left.data.after(own, Columns(left.explained.residual[:, None], 0)).values[:, 0]
    return Left(left.data.stepped(own), replace(left.explained, residual=residual))
