"""The calibration moved to where it belongs once the causes are known.

The data takes the calibration's freedom to first order. A strong cause can have pushed the calibration further than
that: then the data are set up anew around the calibration with the causes in place, by Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.data.tangent import moments, stepped
from estimators.gap.data.whitened import WhitenedData
from rig.effects import Effect

#: Directions of the calibration's parameters that move the readings by less than this share are left alone.
_FELT: Final = 1e-6


def rebased(data: WhitenedData, effects: Sequence[Effect]) -> WhitenedData:
    """The data around the calibration that fits best, to first order, with these effects in place."""
    gram, moment = moments(data.tangents, data.whiten(data.residual - data.change(effects)))
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = np.inf
    step = np.linalg.pinv(gram / np.outer(scale, scale), rcond=_FELT, hermitian=True) @ (moment / scale) / scale
    return data.around(stepped(data.pipeline, step), effects)
