"""A fit brought up to date by the sums of what is new, in time that does not grow with what came before.

The moments of one preliminary ellipsoid add (``moments``). Its weights, the noise of the channels that they were made
with and the readings that were left out stay as they were when all readings were last fitted; that changes an
estimate by some hundredths of its standard deviation.
"""

from __future__ import annotations

from dataclasses import replace

from estimators.ellipsoid import outliers
from estimators.ellipsoid.distances import Residuals
from estimators.ellipsoid.fit import EllipsoidFit, fit_of
from estimators.ellipsoid.likelihood import solve
from estimators.ellipsoid.moments import Moments
from estimators.ellipsoid.optimum import STEP
from estimators.ellipsoid.used_rows import Dropped, usable
from rig.arrays import Array


def brought_up(fit: EllipsoidFit, readings: Array) -> EllipsoidFit | None:
    """A fit of single readings, with those that came after it.

    Args:
        fit: of all readings before, without problems.
        readings: (1 + n, 3) the last one of these, and the new ones [recorded unit].

    Returns:
        None where all have to be fitted anew: the weights do not hold any more, or a problem has shown.
    """
    found = fit.estimate
    if found is None or fit.problem is not None:
        return None
    rows, again = usable(readings)
    new = readings[1:] if rows is None else readings[rows[rows > 0]]
    squares = Residuals.of(new, found.optimum.ellipsoid).over(found.variances)
    inside = squares <= outliers.limit(fit.samples + len(new)) ** 2 * found.optimum.variance
    dropped = Dropped(
        fit.dropped.repeated + again.repeated,
        fit.dropped.zero + again.zero,
        fit.dropped.outliers + int(len(inside) - inside.sum()),
    )
    moments = found.moments
    if inside.any():
        moments = moments + Moments.of(new[inside], moments.frame, found.variances)
    optimum = solve(moments, fit.parameters, fit.noise_given)
    if optimum is None or optimum.step >= STEP:
        return None
    updated = replace(found, optimum=optimum, moments=moments)
    made = fit_of(updated, new, fit.reference_magnitude, fit.parameters, fit.noise_given, dropped, None)
    return made if made.problem is None else None
