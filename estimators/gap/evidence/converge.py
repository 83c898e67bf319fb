"""Causes and calibration fitted together, to the end: refits on whitened around ever better calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.rebase import rebased
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.refine import Fitted, Refit, at, refit

#: Calibrations started from anew at most.
_ROUNDS: Final = 8
#: Misfit (chi-square) by which a recording is off that is worth another.
_OFF: Final = 1.0
#: The least share of the way to the effects that are likeliest, as if the calibration followed its tangent.
_SHORTEST: Final = 0.1


def converged(fits: Sequence[Fitted], data: WhitenedData, rough: WhitenedData | None = None) -> Refit:
    """The fitted effects, around the calibration that they hold beside: the given one where that was good enough.

    Where the calibration is pushed so far that its tangent does not tell what it takes, a part of the way is gone: what
    is left then is what was attained, not what a straight line promised.

    Args:
        rough: means over neighbouring samples: effects that outlive these are fitted there first, which
            leaves little to do.
    """
    if rough is not None and rough is not data and all(fit.candidate.smooth for fit in fits):
        first = converged(fits, rough)
        fits, data = first.fits, data if first.data is rough else data.like(first.data)
    found = refit(fits, data)
    if not found.fits:
        return found
    if data.in_place:
        reached, least = list(fits), _left(fits, data)
    else:  # with nothing there, the calibration is where it fits best
        reached, least = [_without_strength(fit) for fit in found.fits], float(data.whitened @ data.whitened)
    for number in range(_ROUNDS + 1):
        share, tried = 1.0, list(found.fits)
        fresh, misfit = _attained(tried, data)
        if abs(misfit - found.misfit) < _OFF:
            break
        while misfit >= least and share > _SHORTEST:
            share *= 0.5
            tried = [_between(*pair, share) for pair in zip(reached, found.fits, strict=True)]
            fresh, misfit = _attained(tried, data)
        better = misfit < least
        if not better or number == _ROUNDS:  # another calibration that is no better ends nothing
            attained = min(misfit, least)
            there = at(tried, fresh) if better else at(reached, data) if data.in_place else found
            return replace(there, short=max(attained - found.misfit, 0.0))
        data, least, reached = fresh, misfit, tried
        found = refit(tried, data, most=4)
    if not data.in_place:  # what the calibration takes of a strong cause, it takes beside that
        found = refit(found.fits, data.around(data.pipeline, [fit.effect for fit in found.fits]), most=4)
    return found


def _left(fits: Sequence[Fitted], data: WhitenedData) -> float:
    """What some effects leave (chi-square) around the calibration as it is."""
    left = data.whiten(data.residual - data.change([fit.effect for fit in fits]))
    return float(left @ left)


def _attained(fits: Sequence[Fitted], data: WhitenedData) -> tuple[WhitenedData, float]:
    """The data around the calibration that fits best beside some effects, and what these leave there (chi-square)."""
    fresh = rebased(data, [fit.effect for fit in fits])
    return fresh, _left(fits, fresh)


def _between(one: Fitted, other: Fitted, share: float) -> Fitted:
    return replace(other, values=(1.0 - share) * one.values + share * other.values)


def _without_strength(fit: Fitted) -> Fitted:
    strengths = sum(item.size for item in fit.free if item.strength)
    return replace(fit, values=np.concatenate([np.zeros(strengths), fit.values[strengths:]]))
