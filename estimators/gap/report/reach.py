"""How far something outside the catalogue reaches: what acts on other channels than that does is no image of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.evidence.discrepancy import Weighed
from estimators.gap.hypotheses.prior import OTHER
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.report.homogeneity import own_columns
from estimators.gap.search.explanation import Explanation
from rig.arrays import Array

#: Log prior of a second thing outside the catalogue, of which the effect may be an image.
_SECOND: Final = float(np.log(OTHER))


def log_prior_of_image(explanation: Explanation, index: int, terms: Sequence[Weighed]) -> float:
    """Log probability that a thing outside the catalogue does as much as one effect of a set where it does anything.

    Args:
        index: the effect's number in the set. terms: of the discrepancy; none: noise, which may be anywhere.
    """
    if not terms:
        return 0.0
    along, left = own_columns(explanation, index), explanation.linear.left
    channels = len(explanation.data.columns)
    # of each channel, how much likelier the fitted strength is there than none
    gained = np.sum((along * (0.5 * along + left)).reshape(channels, -1), axis=1)
    return _log_prior(gained, terms)


def log_prior_of_image_of_noise(fitted: FittedNoise, columns: Sequence[int], terms: Sequence[Weighed]) -> float:
    """The same of a noise effect.

    Args:
        columns: the channels of the data.
    """
    if not terms:
        return 0.0
    added = np.sum([each.added[:, list(columns)].sum(axis=0) for each in fitted.every], axis=0)
    return _log_prior(0.5 * fitted.gain * added / max(float(added.sum()), 1e-300), terms)


def _log_prior(gained: Array, terms: Sequence[Weighed]) -> float:
    """Each term explains nothing of what an effect gains on channels (c,) where it does nothing."""
    masses = np.array([one.log_mass for one in terms])
    outside = np.array([max(float(gained[~_channels(one)].sum()), 0.0) for one in terms])
    inside = float(np.logaddexp.reduce(masses - outside) - np.logaddexp.reduce(masses))
    return min(float(np.logaddexp(inside, _SECOND)), 0.0)


def _channels(weighed: Weighed) -> NDArray[np.bool_]:
    """(c,) which a term acts on."""
    own = weighed.term.errors.series[:, weighed.term.freedoms]
    return np.asarray(np.any(own != 0.0, axis=(0, 1)))
