"""The attitude-free calibration of one sensor: readings in; gain, offset and covariance out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.ellipsoid.levenberg import Start, levenberg_marquardt
from estimators.ellipsoid.likelihood import Optimum, parameter_names
from estimators.ellipsoid.monomials import FREE, packed
from estimators.ellipsoid.optimum import Estimate, Readings, estimate
from estimators.ellipsoid.refusal import Spread, problem_of, without_ellipsoid
from estimators.ellipsoid.used_rows import Dropped, check_finite, usable
from rig.arrays import Array, Rows
from rig.errors import RefusedFit, RigError
from rig.threads import one_blas_thread

Parameters = Literal[6, 9]


@dataclass(frozen=True, eq=False)
class EllipsoidFit:
    """The calibration of one sensor without knowledge of its attitude.

    Readings are V = gain h + offset + noise with |h| = reference_magnitude, Camps (1), (6). Any rotation of h gives the
    same readings, so the gain is the symmetric one: it defines the sensor's own frame.

    Attributes:
        parameters: 6: the gain is diagonal, Camps (1); 9: symmetric, Camps (6).
        gain: (3, 3) [recorded unit / field unit], positive definite.
        offset: (3,) [recorded unit].
        reference_magnitude: of the field [field unit].
        names: (p,) as of ``likelihood.parameter_names``.
        covariance: (p, p) of them, to second order in the noise.
        noise: (3,) standard deviation of each channel's noise, given or from the residuals [recorded unit].
        noise_given: whether it was given.
        samples: readings that were used. degrees_of_freedom: these less p.
        chi_square: sum of squared residuals over their variances by ``noise``.
        spread: of the directions.
        optimum: the ellipsoid and the information of its coefficients; None if not of the likelihood.
        dropped: readings that were left out.
        used: (samples,) the row numbers of the others; None: all.
        problem: why the readings cannot tell the parameters; None where they can.
        estimator: "likelihood", or "levenberg-marquardt" as in the paper.
        estimate: the optimum with the sums that it was made of; None if not of the likelihood.
    """

    parameters: Parameters
    gain: Array
    offset: Array
    reference_magnitude: float
    names: tuple[str, ...]
    covariance: Array
    noise: Array
    noise_given: bool
    samples: int
    degrees_of_freedom: int
    chi_square: float
    spread: Spread
    optimum: Optimum | None = None
    dropped: Dropped = field(default_factory=Dropped)
    used: Rows | None = None
    problem: str | None = None
    estimator: str = "likelihood"
    estimate: Estimate | None = None

    @property
    def values(self) -> Array:
        """(p,) the estimates in the order of ``names``."""
        return np.concatenate([packed(self.gain)[: self.parameters - 3], self.offset])

    @property
    def std(self) -> Array:
        """(p,) standard deviations in the order of ``names``."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def condition(self) -> float:
        """Of the information scaled to a unit diagonal."""
        return np.nan if self.optimum is None else self.optimum.condition

    @property
    def matrix(self) -> Array:
        """(3, 3) with field = matrix @ (reading - offset), in the sensor's own frame [field unit / recorded unit]."""
        return np.asarray(np.linalg.inv(self.gain))

    def field_of(self, readings: ArrayLike) -> Array:
        """(n, 3) the field of readings (n, 3) [field unit], in the sensor's own frame."""
        return np.asarray((np.asarray(readings, dtype=float) - self.offset) @ self.matrix.T)


def fit_ellipsoid(
    readings: ArrayLike,
    reference_magnitude: float = 1.0,
    *,
    parameters: Parameters = 9,
    noise: ArrayLike | None = None,
    counts: ArrayLike | None = None,
    start: Start | None = None,
    robust: bool = True,
    drop_repeats: bool = True,
    refuse: bool = True,
    name: str = "sensor",
) -> EllipsoidFit:
    """Calibrate a triaxial sensor from the magnitude of the field alone, without a start.

    Args:
        readings: (n, 3) in the order of time [recorded unit]; an accelerometer's with the sensor at rest.
        reference_magnitude: |h| [field unit]; 1 for a relative calibration.
        parameters: 6 or 9.
        noise: (3,) standard deviation of a single sample, from a locked recording [recorded unit]; None: from the
            residuals, for each channel if there are many readings, else one for all.
        counts: (n,) how many samples each reading is the mean of (held poses); None: single samples.
        start: minimise as the paper does, from the data sheet's values, instead; single readings, with their outliers.
        robust: leave out outliers, which Gaussian noise has in one of a thousand data sets.
        drop_repeats: leave out single samples that equal the one before, or are all zero.
        refuse: raise where the parameters cannot be told; otherwise, if there is an ellipsoid at all, say so in
            ``EllipsoidFit.problem``.
        name: of the sensor, for messages.

    Raises:
        RigError: an array of another shape, a NaN or infinity, fewer readings than parameters.
        RefusedFit: the readings cannot determine the parameters.
    """
    if parameters not in FREE:
        raise RigError(f"{name}: parameters: found {parameters}, expected 6 or 9")
    magnitude = float(reference_magnitude)
    if not 0.0 < magnitude < np.inf:
        raise RigError(f"{name}: reference magnitude: found {magnitude:g}, expected a positive number")
    values = np.asarray(readings, dtype=float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise RigError(f"{name}: found readings of shape {values.shape}, expected (n, 3)")
    weights = None if counts is None else _positive(counts, len(values), f"{name}: counts")
    used, dropped = usable(values) if drop_repeats and weights is None else (None, Dropped())
    if used is not None:
        values = values[used]
    if len(values) < parameters:
        left_out = f" ({dropped} left out)" if str(dropped) else ""
        kind = RefusedFit if left_out else RigError
        raise kind(
            f"{name}: found {len(values)} readings{left_out}, expected at least {parameters}, as many as parameters"
        )
    given = None if noise is None else _positive(noise, 3, f"{name}: noise")
    if given is None and len(values) == parameters:
        raise RefusedFit(
            f"{name}: {parameters} readings fit {parameters} parameters exactly, which tells nothing of the noise:"
            f" expected at least {parameters + 1}, or the noise"
        )
    if start is not None:
        if weights is not None:
            raise RigError(
                f"{name}: found both start and counts, expected one or the other: the paper knows no weights"
            )
        check_finite(values, name)
        with one_blas_thread():
            searched = levenberg_marquardt(values, start, magnitude, parameters, given, name)
        return EllipsoidFit(
            parameters=parameters,
            gain=searched.gain,
            offset=searched.offset,
            reference_magnitude=magnitude,
            names=parameter_names(parameters),
            covariance=searched.covariance,
            noise=np.sqrt(searched.variances),
            noise_given=given is not None,
            samples=len(values),
            degrees_of_freedom=len(values) - parameters,
            chi_square=searched.chi_square,
            spread=Spread.of_field((values - searched.offset) @ np.linalg.inv(searched.gain)),
            dropped=dropped,
            used=used,
            estimator="levenberg-marquardt",
        )
    with one_blas_thread(), np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = estimate(Readings(values, weights, given, parameters), robust)
    if found is None:
        check_finite(values, name)  # a single one that is not leaves nothing to solve
        raise RefusedFit(f"{name}: {without_ellipsoid(values, parameters)}")
    if found.kept is not None:
        dropped = Dropped(dropped.repeated, dropped.zero, len(values) - len(found.kept))
        values = values[found.kept]
        used = found.kept if used is None else used[found.kept]
    fit = fit_of(found, values, magnitude, parameters, given is not None, dropped, used)
    if fit.problem is not None and refuse:
        raise RefusedFit(f"{name}: {fit.problem}")
    return fit


def fit_of(
    found: Estimate,
    values: Array,
    magnitude: float,
    parameters: Parameters,
    noise_given: bool,
    dropped: Dropped,
    used: Rows | None,
) -> EllipsoidFit:
    """The fit that an optimum is.

    Args:
        found: the optimum.
        values: (n, 3) the readings that were fitted, or some of them, by which to say what is missing [recorded unit].
        magnitude: of the field.
        parameters: 6 or 9.
        noise_given: whether the noise was known.
        dropped, used: as of ``EllipsoidFit``.
    """
    optimum, samples = found.optimum, found.moments.rows
    spread = Spread(found.moments.first)
    scale = 1.0 if noise_given else optimum.variance
    size = np.append(np.full(parameters - 3, 1.0 / magnitude), np.ones(3))
    return EllipsoidFit(
        parameters=parameters,
        gain=optimum.ellipsoid.gain / magnitude,
        offset=optimum.ellipsoid.center,
        reference_magnitude=magnitude,
        names=parameter_names(parameters),
        covariance=size[:, None] * optimum.covariance * size,
        noise=np.sqrt(scale * found.variances),
        noise_given=noise_given,
        samples=samples,
        degrees_of_freedom=samples - parameters,
        chi_square=optimum.chi_square / scale,
        spread=spread,
        optimum=optimum,
        dropped=dropped,
        used=used,
        problem=problem_of(optimum, spread, values),
        estimate=found,
    )


def _positive(values: ArrayLike, length: int, what: str) -> Array:
    numbers = np.asarray(values, dtype=float)
    if numbers.shape != (length,) or not np.isfinite(numbers).all() or (numbers <= 0.0).any():
        raise RigError(f"{what}: found shape {numbers.shape}, expected {length} positive numbers")
    return numbers
