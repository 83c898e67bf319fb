"""The paper's way: quasi-Newton minimisation of the sum of squared residuals with numerical gradients.

Renk et al. (2005) minimise (15) and (21) with MATLAB's ``fminunc``, without a gradient, from axes along +i of frame 6,
a sensitivity of 1 V per unit, and an offset of 2.5 V; the field starts straight down, which the paper leaves open.
Here: SciPy's BFGS and its finite differences. The orientations are computed once, before. The cost is written in two
ways: with NumPy's arrays as they come, which is what one writes; and laid out by hand for the cache and for BLAS,
several times as fast, to show what of the distance is the method's and what the program's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize

from rig.arrays import Array

_START: Final = np.array([0.0, 0.0, 1.0, 2.5] * 3 + [0.5 * np.pi, 0.0])


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the minimisation ended.

    Attributes:
        axes: (3, 3) unit vectors P_k, frame 6. sensitivity, offset: (3,). field: (3,) unit vector, base frame.
        rms: root of the summed squares of the channels' RMS residuals, as the paper gives it [recorded unit].
        evaluations: of the cost.
    """

    axes: Array
    sensitivity: Array
    offset: Array
    field: Array
    rms: float
    evaluations: int


def direction(elevation: Array | float, azimuth: Array | float) -> Array:
    """(..., 3) Renk (6), (12): +i turned about j, then about k [rad]."""
    return np.stack(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), -np.sin(elevation)], axis=-1
    )


def fit(rotations: Array, readings: Array, magnitude: float) -> Fit:
    """Calibrate the three channels of one sensor at once, Renk (15), (21).

    Args:
        rotations: (n, 3, 3) R_base_tool.
        readings: (n, 3) [recorded unit].
        magnitude: of the field.
    """

    def cost(x: Array) -> float:
        gain, offset, field = _unpacked(x, magnitude)
        in_tool = np.einsum("i,nij->nj", field, rotations)
        return float(np.sum((readings - (in_tool @ gain.T + offset)) ** 2))

    return _minimised(cost, len(readings))


def fit_laid_out(rotations: Array, readings: Array, magnitude: float) -> Fit:
    """The same with the arrays laid out for it.

    Args:
        rotations: (3, 3 n) as of ``laid_out``.
        readings: (3, n), contiguous [recorded unit].
        magnitude: of the field.
    """

    def cost(x: Array) -> float:
        gain, offset, field = _unpacked(x, magnitude)
        left = gain @ (field @ rotations).reshape(3, -1)
        left += offset[:, None]
        left -= readings
        flat = left.ravel()
        return float(flat @ flat)

    return _minimised(cost, readings.shape[1])


def laid_out(rotations: Array) -> Array:
    """(3, 3 n), from R_base_tool (n, 3, 3): the layout in which a field times all rotations is one product."""
    return np.ascontiguousarray(rotations.transpose(1, 2, 0).reshape(3, -1))


def _unpacked(x: Array, magnitude: float) -> tuple[Array, Array, Array]:
    """Rows S_k P_k (3, 3), offsets (3,) and the field (3,)."""
    channels = x[:12].reshape(3, 4)
    gain = channels[:, 2, None] * direction(channels[:, 0], channels[:, 1])
    return gain, channels[:, 3], magnitude * direction(x[12], x[13])


def _minimised(cost: Callable[[Array], float], samples: int) -> Fit:
    found = minimize(cost, _START, method="BFGS")
    channels = found.x[:12].reshape(3, 4)
    axes, field = direction(channels[:, 0], channels[:, 1]), direction(found.x[12], found.x[13])
    sign = np.where(channels[:, 2] < 0.0, -1.0, 1.0)
    return Fit(
        axes * sign[:, None],
        np.abs(channels[:, 2]),
        channels[:, 3],
        field,
        float(np.sqrt(found.fun / samples)),
        int(found.nfev),
    )
