"""How far something outside the catalogue reaches: what acts on other channels than that does is no image of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import project
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.search.explanation import Explanation
from estimators.gap.search.further_unknowns import SECOND
from estimators.gap.search.hypothesis import Hypothesis
from rig.arrays import Array


class Gains(NamedTuple):
    """How much likelier an effect is on each channel than nothing.

    Attributes:
        beside_others: (c,) beside the other effects of its set. alone: (c,) without them.
    """

    beside_others: Array
    alone: Array


def gains(explanation: Explanation) -> list[Gains]:
    """Of each effect of a set."""
    data, left = explanation.data, explanation.linear.left
    every = project(data.absorbed, data.whiten(data.change([fit.effect for fit in explanation.fits])))
    channels = len(data.columns)
    return [
        Gains(_gained(own, left, channels), _gained(alone, left + every - alone, channels))
        for own, alone in zip(explanation.own_columns, explanation.changes, strict=True)
    ]


def gains_of_noise(fitted: FittedNoise, columns: Sequence[int]) -> Gains:
    """Of a noise effect.

    Args:
        columns: the channels of the data.
    """
    added = np.sum([each.added[:, list(columns)].sum(axis=0) for each in fitted.every], axis=0)
    gained = 0.5 * fitted.gain * added / max(float(added.sum()), 1e-300)
    return Gains(gained, gained)


def log_prior_of_image(gains: Gains, hypothesis: Hypothesis, second: bool) -> float:
    """Log probability that a thing outside the catalogue does as much as an effect where it does anything.

    It explains nothing of what the effect gains where it does nothing. There an effect counts that gains by itself,
    too: another that is an image may do anything there, and what undoes that is no cause. What a second such thing may
    do there is a hypothesis of its own, or, where none was weighed, as likely as that things are rarely alone.

    Args:
        hypothesis: that holds both; one without a discrepancy: noise, which may be anywhere.
        second: whether hypotheses with a second discrepancy were weighed in the effect's place.
    """
    if not hypothesis.terms:
        return 0.0
    masses = np.array([one.log_mass for one in hypothesis.terms])
    also = np.zeros(len(gains.alone), dtype=bool)
    for terms in hypothesis.further:
        also |= _channels(terms[0])
    beyond = [~(_channels(one) | also) for one in hypothesis.terms]
    outside = [max(min(float(each[own].sum()) for each in gains), 0.0) for own in beyond]
    inside = float(np.logaddexp.reduce(masses - outside) - np.logaddexp.reduce(masses))
    return min(inside if second else float(np.logaddexp(inside, SECOND)), 0.0)


def _gained(along: Array, left: Array, channels: int) -> Array:
    """(c,) how much likelier what an effect does (c n,) is on each channel than nothing, from what it leaves."""
    return np.asarray(np.sum((along * (0.5 * along + left)).reshape(channels, -1), axis=1))


def _channels(weighed: Weighed) -> NDArray[np.bool_]:
    """(c,) which a term acts on."""
    own = weighed.term.errors.of_channels(weighed.term.freedoms)
    return np.asarray(np.any(own != 0.0, axis=(0, 2)))
