"""Known-angle calibration from sufficient statistics: separate, Renk (14), (20), and simultaneous, Renk (15), (21)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from estimators.batch.optimum import Centred, parameters_of, separate, simultaneous
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import PARAMETERS_AT_ONCE, Method, SensorParameters, Weighting, check_options
from estimators.known_angle.refusal import why_not
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array
from rig.errors import RefusedFit, RigError
from rig.threads import one_blas_thread


@dataclass(frozen=True, eq=False)
class SensorFit:
    """The optimum of one sensor, with its Fisher information.

    Attributes:
        method, weighting: as asked for.
        parameters: the estimate.
        count: n.
        information: at the estimate, for readings whose noise is as the weights have it.
        covariance: (p, p) in the coordinates of ``SensorParameters.jacobian``.
        noise: (3,) standard deviation of a reading, given or estimated [recorded unit].
        noise_given: whether it was given.
        residual_square: (3,) sum of squared residuals [recorded unit squared].
        degrees_of_freedom: (3,) n less the parameters that each channel's readings have paid for.
        problem: why the data cannot tell the parameters; None where they can.
    """

    method: Method
    weighting: Weighting
    parameters: SensorParameters
    count: int
    information: Information
    covariance: Array
    noise: Array
    noise_given: bool
    residual_square: Array
    degrees_of_freedom: Array
    problem: str | None = None

    @property
    def rms(self) -> Array:
        """(3,) root mean square residual of each channel [recorded unit]; the paper's data-fit error."""
        return np.sqrt(self.residual_square / self.count)


def fit_sensor(
    statistics: Statistics,
    reference_magnitude: float = 1.0,
    *,
    method: Method = "simultaneous",
    noise: ArrayLike | None = None,
    weighting: Weighting = "likelihood",
    field_points: ArrayLike = (0.0, 0.0, -1.0),
    name: str = "sensor",
    refuse: bool = True,
) -> SensorFit:
    """Calibrate one sensor.

    The global minimum is found without an initial guess (``estimators.batch.global_minima``).

    Args:
        statistics: of three channels.
        reference_magnitude: |f| [m/s^2, field unit].
        method: one field direction for all three channels, or one for each.
        noise: (3,) standard deviation of a reading, from a locked recording [recorded unit]; None: from the residuals,
            channel by channel, over the degrees of freedom that are left.
        weighting: ``likelihood`` weighs the channels by 1/noise^2 (the maximum-likelihood estimate), ``equal`` as in
            the paper; the covariance holds for either. Without meaning for separate fits.
        field_points: (3,) any vector, base frame, within 90 degrees of the field: it chooses between (f, P) and
            (-f, -P), which give the same readings.
        name: of the sensor, for messages.
        refuse: raise where the parameters cannot be told; otherwise say so in ``SensorFit.problem``.

    Raises:
        RigError: an option is unknown, the statistics are not of three channels, or there are fewer samples than
            parameters.
        RefusedFit: the poses cannot determine the parameters, two solutions fit alike, or a channel does not respond.
    """
    _check(statistics, method, weighting, name)
    n = statistics.count
    with one_blas_thread():
        data = Centred.of(
            statistics.gram, statistics.cross[None], statistics.square.diagonal()[None], np.array([statistics.count])
        )
        # What rounding leaves of a sum of squares; noise below it cannot be seen, and may not become a division by
        # zero.
        rounding = data.rounding[0]
        _check_response(data, name)
        given = None if noise is None else np.maximum(_three(noise, name), rounding)
        known = None if given is None else given[None]
        optimum = simultaneous(data, known, weighting) if method == "simultaneous" else separate(data)
        points = np.asarray(field_points, dtype=float)
        parameters = parameters_of(optimum, data, reference_magnitude, points[None])[0]
        residual = optimum.mean_square[0] * n
        assumed = given if given is not None else optimum.noise[0]
        if weighting == "equal":
            assumed = np.ones(3)
        information = Information.of(statistics.gram, parameters, assumed, method)
        freedom = n - information.leverage()
        sigma = given if given is not None else np.maximum(np.sqrt(residual / np.maximum(freedom, 1.0)), rounding)
        if weighting == "equal":
            covariance = information.sandwich(sigma, assumed)
        else:
            information = information.with_noise(sigma, assumed)
            covariance = information.covariance
        fit = SensorFit(
            method,
            weighting,
            parameters,
            n,
            information,
            covariance,
            sigma,
            given is not None,
            residual,
            freedom,
        )
        spread, rank = data.problems.covariance, int(data.rank[0])
        problem = why_not(parameters, information, covariance, spread, rank, optimum.rivals, sigma, n)
    if problem is None:
        return fit
    if refuse:
        raise RefusedFit(f"{name}: {problem}")
    return replace(fit, problem=problem)


def _check(statistics: Statistics, method: Method, weighting: Weighting, name: str) -> None:
    check_options(method, weighting)
    if statistics.channels != 3:
        raise RigError(f"{name}: found {statistics.channels} channels, expected the three of one sensor")
    needed = PARAMETERS_AT_ONCE[method]
    if statistics.count < needed:
        raise RigError(
            f"{name}: found {statistics.count} samples for the {needed} parameters of a {method} fit, expected at least"
            f" {needed}"
        )


def _check_response(data: Centred, name: str) -> None:
    if data.rank[0] == 0:
        raise RefusedFit(f"{name}: the orientation never changes, expected readings in many orientations")
    silent = np.flatnonzero(np.sqrt(data.variance[0]) <= 2.0 * data.rounding[0])
    if silent.size:
        raise RefusedFit(
            f"{name}: channel {int(silent[0]) + 1} reads the same in every orientation, expected it to see the field"
            " turn"
        )


def _three(values: ArrayLike, name: str) -> Array:
    noise = np.asarray(values, dtype=float)
    if noise.shape != (3,) or not np.isfinite(noise).all() or (noise < 0).any():
        raise RigError(f"{name}: noise: found {np.array2string(noise)}, expected three numbers, none negative")
    return noise
