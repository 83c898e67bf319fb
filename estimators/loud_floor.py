"""A noise floor that is louder than the readings it is held against."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

#: Residuals that are below their floor by chance once in so many calibrations.
P_VALUE_LIMIT: Final = 1e-4
#: Standard deviations that are too large by less than this do no harm.
HARMLESS: Final = 1.02


def times_too_loud(chi_square: Mapping[str, Any] | None) -> float | None:
    """How many times a floor exceeds the residuals; None where it does not, as far as chance goes.

    Args:
        chi_square: of the residuals against the floor, as of ``Quality``; its p-value knows how well that is known.
    """
    if chi_square is None or not chi_square["degrees_of_freedom"] or not chi_square["value"] > 0.0:
        return None
    times = float(np.sqrt(chi_square["degrees_of_freedom"] / chi_square["value"]))
    return times if times > HARMLESS and 1.0 - chi_square["p_value"] < P_VALUE_LIMIT else None


def loud_words(chi_square: Mapping[str, Any] | None, source: str) -> list[str]:
    """What a floor that is too loud does to a calibration, in words; empty where it is not.

    Args:
        source: where the floor comes from, in words.
    """
    times = times_too_loud(chi_square)
    if times is None:
        return []
    return [
        f"residuals are only {1.0 / times:.3g} times the noise floor ({source}): it is louder than the readings, and"
        f" every standard deviation is {times:.3g} times too large: take a floor at the rate and the settings of the"
        " recording"
    ]
