"""What is left of a residual where the calibration and the causes are fitted with other weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimators.gap.data.projection import project, side_by_side
from estimators.gap.data.steps import Step, after_steps
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear
from rig.arrays import Array


def left_by_weights(data: WhitenedData, linear: Linear, steps: Sequence[Step]) -> Array:
    """(c n,) what linearised effects and the calibration leave, whitened as the data are, where both are fitted under
    further steps of whitening: generalised least squares.

    Under the weights of the data, noise of one channel that these know nothing of moves the calibration, and with it
    every other channel.

    Args:
        data: what the effects were linearised in. steps: of whitening, beyond those of the data.
    """
    own = data.stepped(steps)
    both = project(own.absorbed, _after(data, steps, side_by_side(linear.left, linear.tangent)))
    left, tangent = both[:, 0], both[:, 1:]
    if tangent.shape[1]:
        left = left - tangent @ np.linalg.lstsq(tangent, left, rcond=1e-9)[0]
    undone = [replace(step, factor=1.0 / step.factor) for step in reversed(steps)]
    return _after(data, undone, left[:, None])[:, 0]


def _after(data: WhitenedData, steps: Sequence[Step], columns: Array) -> Array:
    """Whitened columns (c n, m) after further steps, each on its channel and recording."""
    by_channel = columns.T.reshape(columns.shape[1], len(data.columns), data.count).copy()
    for index, column in enumerate(data.columns):
        for part, own in enumerate(data.stretches):
            here = [step for step in steps if (step.column, step.part) == (column, part)]
            if here:
                by_channel[:, index, own] = after_steps(here, by_channel[:, index, own], data.parts[part].gaps[column])
    return np.ascontiguousarray(by_channel.reshape(columns.shape[1], -1).T)
