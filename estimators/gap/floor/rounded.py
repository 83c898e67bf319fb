"""The floor of a channel whose converter is coarse: at rest its steps hide the noise, in motion they are noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import ndtr

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arrays import Array

#: Steps, in deviations at rest, from which on these depend on where between two levels a pose lies.
COARSE: Final = 2.0
#: Noise before the converter [steps], all sizes alike beforehand; places between two levels.
_SIZES: Final = np.geomspace(0.02, 0.8, 32)
_PLACES: Final = (np.arange(40) + 0.5) / 40.0 - 0.5


def rounded_floor(segments: Sequence[Array], step: float, duration_s: float) -> ChannelNoise:
    """The noise in motion: what there is before the converter, and a rounding error that is even over a step.

    Args:
        segments: readings (n,) [recorded unit] of poses at rest. step: of the converter [recorded unit].
        duration_s: that they lasted.
    """
    total = np.zeros(len(_SIZES))
    for segment in segments:
        levels, counts = np.unique(np.round((segment - np.median(segment)) / step), return_counts=True)
        upper = (levels[:, None, None] + 0.5 - _PLACES) / _SIZES[:, None]
        lower = (levels[:, None, None] - 0.5 - _PLACES) / _SIZES[:, None]
        chance = np.log(np.maximum(ndtr(upper) - ndtr(lower), 1e-300))  # (levels, sizes, places)
        total += np.logaddexp.reduce(np.einsum("l,lsp->sp", counts.astype(float), chance), axis=1)
    weight = np.exp(total - np.logaddexp.reduce(total))
    square = float(weight @ _SIZES**2)
    spread = float(np.sqrt(weight @ (_SIZES**2 - square) ** 2))
    variance = square + 1.0 / 12.0
    many = sum(len(segment) for segment in segments)
    samples = int(np.clip(2.0 * (variance / max(spread, 1e-12)) ** 2, 2, many))
    return ChannelNoise(variance * step**2, samples=samples, duration_s=duration_s)
