"""Causes and calibration fitted together, to the end: refits on whitened around ever better calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.data.rebase import rebased
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.refine import Fitted, Refit, refit

#: Calibrations started from anew at most.
_ROUNDS: Final = 4
#: Misfit (chi-square) by which a recording is off that is worth another.
_OFF: Final = 1.0


def converged(fits: Sequence[Fitted], data: WhitenedData, rough: WhitenedData | None = None) -> Refit:
    """The fitted effects, around the calibration that they hold beside: the given one where that was good enough.

    Args:
        rough: means over neighbouring samples: effects that outlive these are fitted there first, which
            leaves little to do.
    """
    if rough is not None and rough is not data and all(fit.candidate.smooth for fit in fits):
        first = converged(fits, rough)
        fits, data = first.fits, data if first.data is rough else data.like(first.data)
    found = refit(fits, data)
    least = np.inf
    for _ in range(_ROUNDS if found.fits else 0):
        effects = [fit.effect for fit in found.fits]
        fresh = rebased(data, effects)
        left = fresh.whiten(fresh.residual - fresh.change(effects))
        misfit = float(left @ left)
        if abs(misfit - found.misfit) < _OFF or misfit >= least:  # another calibration that is no better ends nothing
            break
        data, least = fresh, misfit
        found = refit(found.fits, data, most=4)
    if found.fits and not data.in_place:  # what the calibration takes of a strong cause, it takes beside that
        found = refit(found.fits, data.around(data.pipeline, [fit.effect for fit in found.fits]), most=4)
    return found
