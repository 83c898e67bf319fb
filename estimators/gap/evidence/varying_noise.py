"""Noise with a name in another form than the catalogue's: of a size that follows something.

An effect of the catalogue has one strength for a whole recording. What grows with the field, with the arm's speed or
with time remembers as such an effect does, but is not it: what whitening by the effect leaves has another variance now
than then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.steps import Step, after_steps
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.prior import OTHER, OTHER_FORM, OTHER_NOISE
from estimators.gap.hypotheses.stochastic import Left
from rig.arrays import Array
from rig.channels import COLUMNS_OF

#: How much of the variance follows, over how much does not: tried.
_RATIOS: Final = (0.3, 1.0, 3.0, 10.0, 100.0)


def varying(states: Sequence[NoiseState], before: NoiseState, lefts: Sequence[Left]) -> list[NoiseState]:
    """The likeliest of states with one more noise effect each, its noise of a size that follows something: one state,
    or none where nothing shows that.

    Args:
        before: the state that they go beyond. lefts: of each recording, under that.
    """
    likely = [each for each in states if each.steps[len(before.steps) :] and not each.fitted[-1].in_time]
    if not likely:
        return []
    own = max(likely, key=lambda each: 0.5 * sum(one.gain for one in each.fitted[-1].every) + each.log_weight)
    further = own.steps[len(before.steps) :]
    found: dict[str, tuple[float, list[Step]]] = {}
    for number, left in enumerate(lefts):
        data, touched = left.data, {step.column for each in own.fitted for step in each.steps(left.data)}
        white = {
            column: after_steps(
                [step for step in further if (step.column, step.part) == (column, number)],
                data.channel(left.explained.residual, column),
                data.gaps[column],
            )
            for column in sorted(touched)
        }
        for name, courses in _courses(data, list(white)).items():
            gained, steps = found.get(name, (0.0, []))
            for where in COLUMNS_OF.values():
                board = [column for column in white if column in range(6)[where]]
                more, root = _likeliest(data, white, courses, board)
                gained += more
                steps = [*steps, *(Step(column, 1.0 / root[column], True, number) for column in board)]
            found[name] = gained, steps
    gained, steps = max(found.values(), key=lambda each: each[0])
    # in place of the effect's own share of the prior
    share = np.log(OTHER * OTHER_NOISE * OTHER_FORM / (len(found) * len(states)))
    shape = -np.log(len(_RATIOS)) * len(lefts)
    if gained + shape + share < 0.0:
        return []
    weight = own.log_weight + float(share + shape)
    return [replace(before, name="noise", steps=(*own.steps, *steps), log_weight=weight, other=True)]


def _courses(data: WhitenedData, columns: Sequence[int]) -> dict[str, dict[int, Array]]:
    """What the variance of each channel (n,) may follow, of mean one."""
    inputs = np.nan_to_num(data.base.inputs)
    slope = np.gradient(inputs, data.t, axis=0) ** 2
    if data.base.q_encoder is not None:
        speed = np.sum(data.base.joint_velocity**2, axis=1)
    else:
        speed = np.sum(slope / np.maximum(slope.mean(axis=0), 1e-300), axis=1)
    time = np.linspace(0.0, 1.0, data.count)
    every = {
        "the field": inputs**2,
        "how fast the field changes": slope,
        "how fast the arm moves": speed[:, None].repeat(6, axis=1),
        "time, growing": time[:, None].repeat(6, axis=1) ** 2,
        "time, falling": time[::-1, None].repeat(6, axis=1) ** 2,
    }
    size = {name: np.maximum(values.mean(axis=0), 1e-300) for name, values in every.items()}
    return {name: {own: values[:, own] / size[name][own] for own in columns} for name, values in every.items()}


def _likeliest(
    data: WhitenedData, white: Mapping[int, Array], courses: Mapping[int, Array], board: Sequence[int]
) -> tuple[float, dict[int, Array]]:
    """The gain in log likelihood, and standard deviations (n,) of each of a sensor's channels, of mean square one."""
    best: tuple[float, dict[int, Array]] = 0.0, {column: np.ones(data.count) for column in board}
    for ratio in _RATIOS:
        gained, roots = 0.0, {}
        for column in board:
            there = data.weights[:, column] > 0.0
            root = np.sqrt((1.0 + ratio * courses[column]) / (1.0 + ratio))
            values = white[column][there]
            gained -= float(np.sum(np.log(root[there])) + 0.5 * np.sum((values / root[there]) ** 2 - values**2))
            roots[column] = np.where(there, root, 1.0)
        if gained > best[0]:
            best = gained, roots
    return best
