"""The amplitude of a discrepancy between the steps of its grid.

What n directions are made of tells a variance to sqrt(2 / n) of itself. A grid that doubles the amplitude from step to
step passes that by where there are more than a few: the evidence at its best step is up to .15 n nats short. There the
likeliest amplitude is searched for, the grid put on it, and the integral about it is Laplace's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import exp, log, pi, sqrt
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.weighed import Weighed
from rig.arrays import Array

#: Of the log mass of the likeliest, within which others are told so.
_NEAR: Final = 10.0
#: What a step of the grid that is half a step off the likeliest loses for each direction: (x - 1 - log x) / 2 at x = 2.
_LOST: Final = 0.16
#: The share of its standard deviation to which the logarithm of a variance is searched for.
_AS_NEAR: Final = 0.1


def told(one: Weighed) -> float:
    """The information about the logarithm of the variance, where that is likeliest."""
    return _information(_shares(one))


def between_steps(linear: Linear, found: Sequence[Weighed]) -> list[Weighed]:
    """Terms beside a set of effects, each that may lead at its likeliest amplitude, the likeliest first."""
    if not found:
        return []
    columns = linear.columns
    every, top = list(found), max(each.log_mass for each in found)
    for index, each in enumerate(every):
        if each.log_mass + _LOST * len(each.term.values) < top - _NEAR:  # as much as any shares could lose
            continue
        shares = _shares(each)
        sharp = _information(shares) * _step(each) ** 2 > 2.0 * pi
        if sharp and each.log_mass + _LOST * float(shares.sum()) > top - _NEAR:
            every[index] = _likeliest(linear, each, columns)
    return sorted(every, key=lambda each: -each.log_mass)


def _shares(one: Weighed) -> Array:
    """(r,) of each direction the share of its variance that is the term's, at its likeliest step."""
    return np.asarray(one.term.values * one.term.shrunk[0][int(np.argmax(one.gains))])


def _information(shares: Array) -> float:
    return 0.5 * float(shares @ shares)


def _step(one: Weighed) -> float:
    """Of the grid, in the logarithm of the variance."""
    return 2.0 * log(one.term.ratio)


def _likeliest(linear: Linear, one: Weighed, columns: Array) -> Weighed:
    term, best = one.term, int(np.argmax(one.gains))
    along = term.along(columns)

    def gains(variances: Array) -> Array:
        ratio = np.outer(variances, term.values)
        shrink = variances[:, None] / (1.0 + ratio)
        gained = linear.beyond(np.matmul(along.T * shrink[:, None], along))
        return np.asarray(gained - 0.5 * np.log1p(ratio).sum(axis=1))

    def lost(off: float) -> float:
        return -float(gains(term.variances[best : best + 1] * exp(off))[0])

    step = _step(one)
    within = {"xatol": _AS_NEAR / sqrt(told(one))}
    off = float(minimize_scalar(lost, bounds=(-step, step), method="bounded", options=within).x)
    moved = replace(term, shift=term.shift * exp(off))
    found = replace(one, term=moved, gains=gains(moved.variances))
    off = 1.0 / sqrt(told(found))
    below, at, above = gains(moved.variances[best] * np.exp([-off, 0.0, off])).tolist()
    information = max(2.0 * at - below - above, 1e-9) / off**2
    found.gains[best] += min(log(sqrt(2.0 * pi / information) / step), 0.0)  # the peak's width, in steps
    return found
