"""Causes and calibration fitted together, to the end: refits on benches around ever better calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from estimators.gap.bench import Bench
from estimators.gap.rebase import rebased
from estimators.gap.refine import Fitted, refit
from estimators.gap.score import Explained

#: Benches set up anew at most.
_ROUNDS: Final = 4
#: Misfit (chi-square) by which a bench is off that is worth another.
_OFF: Final = 1.0


def converged(fits: Sequence[Fitted], bench: Bench) -> tuple[list[Fitted], Explained, Bench]:
    """The fitted effects, what they leave, and the bench that this holds on: the given one where it was good enough."""
    fitted, explained = refit(fits, bench)
    for _ in range(_ROUNDS if fitted else 0):
        effects = [fit.effect for fit in fitted]
        fresh = rebased(bench, effects)
        left = fresh.whiten(fresh.residual - fresh.change(effects))
        if abs(float(left @ left) - float(explained.residual @ explained.residual)) < _OFF:
            break
        bench = fresh
        fitted, explained = refit(fitted, bench, most=2)
    return fitted, explained, bench
