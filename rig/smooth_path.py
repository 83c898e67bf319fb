"""A smooth path through poses that err: what they show of their own noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.fft import dct, idct
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from rig.arrays import Array
from rig.pose_nodes import one_sign, quaternions

#: Fewer poses show no path.
_FEWEST: Final = 16
#: Logarithm of the weight of a path's squared second differences: from none at all to a straight line.
_WEIGHTS: Final = (-12.0, 24.0)


@dataclass(frozen=True)
class SmoothPath:
    """The smooth path through poses that err.

    Attributes:
        turns: (n, 3) [rad] rotation vectors, in the tool's frame, from the poses to the path.
        kept: (n,) share of each cosine, from the slowest to the fastest, that the path keeps of the poses.
    """

    turns: Array
    kept: Array


def smooth_path(R_base_tool: Array) -> SmoothPath:
    """The smooth path through poses (n, 3, 3) at even times.

    Of unit quaternions, a discrete spline of the weight that generalised cross-validation finds, by cosine transform:
    Garcia, Computational Statistics and Data Analysis 54 (2010), equations 5 to 13. Poses without noise are their own
    smooth path, however rough.
    """
    count = len(R_base_tool)
    logged = one_sign(quaternions(R_base_tool))
    waves = dct(logged, axis=0, norm="ortho")
    power = np.sum(waves**2, axis=1)
    if count < _FEWEST or not power[1:].any():
        return SmoothPath(np.zeros((count, 3)), np.ones(count))
    rough = (2.0 - 2.0 * np.cos(np.pi * np.arange(count) / count)) ** 2

    def score(weight: float) -> float:
        left = 1.0 - 1.0 / (1.0 + np.exp(weight) * rough)
        return float(np.log(left**2 @ power) - 2.0 * np.log(left.sum()))

    weight = float(minimize_scalar(score, bounds=_WEIGHTS, method="bounded").x)
    kept = 1.0 / (1.0 + np.exp(weight) * rough)
    smooth = Rotation.from_quat(idct(waves * kept[:, None], axis=0, norm="ortho"), scalar_first=True)
    turns = (Rotation.from_quat(logged, scalar_first=True).inv() * smooth).as_rotvec()
    return SmoothPath(np.asarray(turns), np.asarray(kept))
