"""Whether successive residuals know of each other: von Neumann's ratio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from estimators._json import AsJson
from estimators.goodness.residuals import Residuals


@dataclass(frozen=True)
class Whiteness(AsJson):
    """The correlation of successive residuals.

    Attributes:
        correlation: mean over the channels.
        p_value: of as much or more in white noise.
        inflation: factor by which standard deviations are too small if the memory is that of a first-order process,
            sqrt((1 + r) / (1 - r)); at least one.
    """

    correlation: float
    p_value: float
    inflation: float


def whiteness(residuals: Residuals) -> Whiteness:
    """Von Neumann's ratio of the mean squared difference of successive residuals to twice their mean square.

    For white noise it is 1 - r with r of mean zero and variance 1 / n (J. von Neumann, Annals of Mathematical
    Statistics 12, 1941). Pairs across a gap in time are left out.
    """
    z = residuals.standardised
    if len(z) < 3:
        return Whiteness(0.0, 1.0, 1.0)
    interval = np.diff(residuals.t)
    near = interval < 1.5 * np.median(interval)
    steps = np.diff(z, axis=0)[near]
    pairs = len(steps)
    mean_square = np.square(z).mean(axis=0)
    told = mean_square > 0.0
    if not told.any():
        return Whiteness(0.0, 1.0, 1.0)
    ratio = np.square(steps).sum(axis=0)[told] / (2.0 * pairs * mean_square[told])
    correlation = float(np.clip(1.0 - ratio.mean(), -0.999, 0.999))
    p_value = float(ndtr(-correlation * np.sqrt(pairs * int(told.sum()))))
    return Whiteness(correlation, p_value, max(1.0, float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))))
