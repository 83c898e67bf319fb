"""The way to the optimum: a direct first ellipsoid, the weighted pass, and a look for outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimators.ellipsoid import outliers
from estimators.ellipsoid.algebraic import first_ellipsoid
from estimators.ellipsoid.distances import Residuals
from estimators.ellipsoid.likelihood import Optimum, solve
from estimators.ellipsoid.moments import Moments
from estimators.ellipsoid.monomials import FREE, quadratic_form, symmetric, table
from estimators.ellipsoid.shape import Ellipsoid
from estimators.ellipsoid.used_rows import spread_rows
from rig.arrays import Array, Mask, Rows

#: Largest change of a quadric's coefficient after which the weights, and the correction of their noise, still stand.
STEP: Final = 0.05
_STEPS: Final = 20
#: Rows by which the noise of the channels is told apart: an eighth, within these bounds.
_FEWEST: Final = 800
_MOST: Final = 32768
#: Of these every third serves the first fit, if there are so many.
_THIRD: Final = 768
#: The noise of the channels is told apart from so many readings on; before, all are taken to be equally noisy.
_FEWEST_FOR_CHANNELS: Final = 1000


@dataclass(frozen=True, eq=False)
class Readings:
    """What is to be fitted, and how.

    Attributes:
        values: (n, 3) [recorded unit].
        counts: (n,) how many samples each is the mean of; None: one.
        noise: (3,) standard deviation of a sample [recorded unit]; None: not known.
        parameters: 6 or 9.
    """

    values: Array
    counts: Array | None
    noise: Array | None
    parameters: int

    def __len__(self) -> int:
        return len(self.values)

    def pick(self, rows: Rows | None) -> Readings:
        """Some of them; all for None."""
        if rows is None:
            return self
        counts = None if self.counts is None else self.counts[rows]
        return Readings(self.values.take(rows, axis=0), counts, self.noise, self.parameters)

    @property
    def assumed(self) -> Array:
        """(3,) variances of a sample's noise, all the same where it is not known [recorded unit squared]."""
        return np.ones(3) if self.noise is None else np.square(self.noise)

    def sample(self) -> Readings:
        """Enough of them to see their noise."""
        return self.pick(spread_rows(len(self), min(max(len(self) // 8, _FEWEST), _MOST)))


@dataclass(frozen=True, eq=False)
class Estimate:
    """An optimum with what it was made of.

    Attributes:
        optimum: the best ellipsoid with its covariance.
        moments: of the readings that it comes from.
        variances: (3,) of a sample's noise, to which ``optimum.variance`` is relative [recorded unit squared].
        kept: (m,) row numbers without outliers; None: all.
    """

    optimum: Optimum
    moments: Moments
    variances: Array
    kept: Rows | None = None

    def leverage(self, readings: Readings) -> Array:
        """(n,) of readings, fitted or not."""
        frame = self.moments.frame
        rows = table(readings.values, frame.whitening, frame.center)
        square = (rows[1:4] ** 2).sum(axis=0)
        weight = square / (quadratic_form(4.0 * symmetric(self.moments.noise)) @ rows[4:])
        free = rows[FREE[len(self.optimum.inverse)]]
        result = weight * np.einsum("ij,ij->j", free, self.optimum.inverse @ free)
        return np.asarray(result if readings.counts is None else result * readings.counts)


def estimate(readings: Readings, resist: bool) -> Estimate | None:
    """The maximum-likelihood ellipsoid; None where the readings lie on none.

    Args:
        readings: more than parameters, or as many with known noise.
        resist: leave out outliers.
    """
    found = plain(readings)
    if not resist or (found is not None and _clean(readings, found)):
        return found
    if found is None and not np.isfinite(readings.values).all():
        return None
    known = readings.noise is not None or len(readings) < _FEWEST_FOR_CHANNELS

    def refit(kept: Mask) -> tuple[Ellipsoid, Array, Array] | None:
        if int(kept.sum()) <= readings.parameters:
            return None
        again = plain(readings.pick(np.flatnonzero(kept)))
        return None if again is None else (again.optimum.ellipsoid, again.leverage(readings), again.variances)

    mask = outliers.inliers(readings.values, readings.assumed, known, readings.parameters, readings.counts, refit)
    if mask is None:
        return None
    kept = np.flatnonzero(mask)
    again = plain(readings.pick(kept))
    return None if again is None else replace(again, kept=kept)


def plain(readings: Readings) -> Estimate | None:
    """The same without a look for outliers."""
    sample = readings.sample()
    weights = readings.assumed
    start = _first(sample)
    if start is None and len(sample) < len(readings):
        start = _first(readings)
    if start is None:
        return None
    if readings.noise is None and len(readings) >= _FEWEST_FOR_CHANNELS:
        found = Residuals.of(sample.values, start, sample.counts).variances()
        weights = weights if found is None else found
    for _ in range(_STEPS):
        moments = Moments.of(readings.values, start, weights, readings.counts)
        optimum = solve(moments, readings.parameters, readings.noise is not None)
        if optimum is None:
            return None
        if optimum.step < STEP:
            return Estimate(optimum, moments, weights)
        start = optimum.ellipsoid
    return None


def _first(readings: Readings) -> Ellipsoid | None:
    """An ellipsoid near the best one of readings; of every third if there are many, as weights do not need the best."""
    step = 3 if len(readings) >= _THIRD else 1
    counts = None if readings.counts is None else readings.counts[::step]
    found = first_ellipsoid(readings.values[::step], readings.parameters, counts)
    if found is None and step > 1:
        found = first_ellipsoid(readings.values, readings.parameters, readings.counts)
    return found


def _clean(readings: Readings, found: Estimate) -> bool:
    """Whether no reading is an outlier, as far as the residuals at hand show."""
    n = len(readings)
    variance, freedom = found.optimum.variance, n - readings.parameters
    if found.optimum.exact:
        return True
    if outliers.heavy_tailed(n, found.moments.fourth, variance):
        return False
    if n > outliers.EXACT_ROWS:
        return found.moments.largest <= outliers.limit(n) ** 2 * variance
    if freedom < 3:
        return True
    squares = Residuals.of(readings.values, found.optimum.ellipsoid, readings.counts).over(found.variances)
    return not outliers.any_outlying(squares, found.leverage(readings), variance, freedom)
