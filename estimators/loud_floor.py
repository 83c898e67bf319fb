"""Residuals held against a noise floor, and a floor that is louder than they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

#: Residuals that are below their floor by chance once in so many calibrations.
P_VALUE_LIMIT: Final = 1e-4
#: Standard deviations that are too large by less than this do no harm.
HARMLESS: Final = 1.02


def against_floor(value: float, freedom: float, ratios: ArrayLike, widening: float = 1.0) -> dict[str, Any]:
    """Chi-square of residuals against a given floor, as of ``Quality``.

    Args:
        value: sum of squared residuals over their variances. freedom: what it is expected to be.
        ratios: (3,) of residuals over the floor, channel by channel.
        widening: the floor was measured too: its own uncertainty makes the variance so many times that of chi-square;
            a scaled chi-square with the same mean and variance matches it (Satterthwaite).
    """
    return {
        "value": value,
        "degrees_of_freedom": freedom,
        "p_value": float(chdtrc(freedom / widening, value / widening)) if freedom else 1.0,
        "residual_over_floor": [float(ratio) for ratio in np.asarray(ratios)],
    }


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
