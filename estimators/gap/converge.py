"""Causes and calibration fitted together, to the end: refits on benches around ever better calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from estimators.gap.bench import Bench
from estimators.gap.rebase import around, rebased
from estimators.gap.refine import Fitted, refit
from estimators.gap.score import Explained

#: Benches set up anew at most.
_ROUNDS: Final = 4
#: Misfit (chi-square) by which a bench is off that is worth another.
_OFF: Final = 1.0


def converged(
    fits: Sequence[Fitted], bench: Bench, rough: Bench | None = None
) -> tuple[list[Fitted], Explained, Bench]:
    """The fitted effects, what they leave, and the bench that this holds on: the given one where it was good enough.

    Args:
        rough: the bench as means over neighbouring samples: effects that outlive these are fitted there first, which
            leaves little to do.
    """
    if rough is not None and rough is not bench and all(fit.candidate.smooth for fit in fits):
        fits, _, fresh = converged(fits, rough)
        bench = bench if fresh is rough else around(bench, fresh.pipeline)
    fitted, explained = refit(fits, bench)
    for _ in range(_ROUNDS if fitted else 0):
        effects = [fit.effect for fit in fitted]
        fresh = rebased(bench, effects)
        left = fresh.whiten(fresh.residual - fresh.change(effects))
        if abs(float(left @ left) - float(explained.residual @ explained.residual)) < _OFF:
            break
        bench = fresh
        fitted, explained = refit(fitted, bench, most=4)
    return fitted, explained, bench
