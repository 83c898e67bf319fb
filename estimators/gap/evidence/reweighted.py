"""What is left of a residual where the calibration and the causes are fitted with other weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimators.gap.data.projection import Columns, project, side_by_side
from estimators.gap.data.steps import Step
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
    columns = data.after(steps, Columns(side_by_side(linear.left, linear.tangent), 0))
    both = project(data.stepped(steps).absorbed, columns.values)
    left, tangent = both[:, 0], both[:, 1:]
    if tangent.shape[1]:
        left = left - tangent @ np.linalg.lstsq(tangent, left, rcond=1e-9)[0]
    undone = [replace(step, factor=1.0 / step.factor) for step in reversed(steps)]
    return data.after(undone, Columns(left[:, None], 0)).values[:, 0]
