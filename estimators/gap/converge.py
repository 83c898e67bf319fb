"""Causes and calibration fitted together, to the end: refits on benches around ever better calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from estimators.gap.bench import Bench
from estimators.gap.rebase import around, rebased
from estimators.gap.refine import Fitted, Refit, refit

#: Benches set up anew at most.
_ROUNDS: Final = 4
#: Misfit (chi-square) by which a bench is off that is worth another.
_OFF: Final = 1.0


def converged(fits: Sequence[Fitted], bench: Bench, rough: Bench | None = None) -> Refit:
    """The fitted effects on the bench that they hold on: the given one where it was good enough.

    Args:
        rough: the bench as means over neighbouring samples: effects that outlive these are fitted there first, which
            leaves little to do.
    """
    if rough is not None and rough is not bench and all(fit.candidate.smooth for fit in fits):
        first = converged(fits, rough)
        fits, bench = first.fits, bench if first.bench is rough else around(bench, first.bench.pipeline)
    found = refit(fits, bench)
    for _ in range(_ROUNDS if found.fits else 0):
        effects = [fit.effect for fit in found.fits]
        fresh = rebased(bench, effects)
        left = fresh.whiten(fresh.residual - fresh.change(effects))
        if abs(float(left @ left) - found.misfit) < _OFF:
            break
        bench = fresh
        found = refit(found.fits, bench, most=4)
    return found
