"""Known-angle calibration from sufficient statistics: separate, Renk (14), (20), and simultaneous, Renk (15), (21)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.known_angle.global_minimum import Compressed, Solution, explained, local_minima, reweighted
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import METHODS, PARAMETERS_AT_ONCE, PARAMETERS_OF, Method, SensorParameters
from estimators.known_angle.refusal import Rival, why_not
from estimators.known_angle.statistics import Statistics
from rig.errors import RefusedFit, RigError, unknown_name
from rig.threads import one_blas_thread

Array = NDArray[np.float64]

Weighting = Literal["likelihood", "equal"]
WEIGHTINGS: Final[tuple[Weighting, ...]] = ("likelihood", "equal")

#: Relative change of the weights that ends their iteration: it moves the estimate by a millionth of its standard
#: deviation.
_SETTLED: Final = 1e-6


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

    The global minimum is found without an initial guess (``estimators.known_angle.global_minimum``).

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
        data = Compressed.of(statistics)
        # What rounding leaves of a sum of squares; noise below it cannot be seen, and may not become a division by
        # zero.
        rounding = np.sqrt(8.0 * np.finfo(float).eps * data.mean_square)
        _check_response(data, rounding, name)
        given = None if noise is None else np.maximum(_three(noise, name), rounding)
        together = method == "simultaneous"
        optimum = _simultaneous(data, n, given, weighting, rounding) if together else _separate(data)
        points = np.asarray(field_points, dtype=float)
        parameters = optimum.parameters(reference_magnitude, points)
        residual = optimum.mean_square * n
        assumed = given if given is not None else optimum.noise
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
        problem = why_not(parameters, information, covariance, data, optimum.rivals, sigma, n)
    if problem is None:
        return fit
    if refuse:
        raise RefusedFit(f"{name}: {problem}")
    return replace(fit, problem=problem)


@dataclass(frozen=True, eq=False)
class _Optimum:
    """The best solution of all three channels: fields (3, 3), m_k (3, 3), offsets (3,), mean square residuals (3,), the
    noise (3,) that the weights rest on, and the next best minima."""

    fields: Array
    scaled_axes: Array
    offset: Array
    mean_square: Array
    noise: Array
    rivals: tuple[Rival, ...]

    def parameters(self, magnitude: float, points: Array) -> SensorParameters:
        """With the sign that puts each field on the side of ``points`` (3,)."""
        sign = np.array([_sign(field, points) for field in self.fields])[:, None]
        length = np.maximum(np.sqrt(np.square(self.scaled_axes).sum(axis=1)), 1e-300)
        axes = sign * self.scaled_axes / length[:, None]
        return SensorParameters(magnitude, length / magnitude, self.offset, axes, sign * self.fields)


def _simultaneous(data: Compressed, n: int, given: Array | None, weighting: Weighting, rounding: Array) -> _Optimum:
    """The maximum of the likelihood over everything, the noise included where it is not given; or of equal weights."""
    left = n - data.rank - 1
    if given is not None:
        sigma = given
    elif left > data.rank:  # the noise that no linear function of the rotation explains: consistent before any fit
        sigma = np.maximum(np.sqrt(data.floor * n / left), rounding)
    else:
        sigma = np.sqrt(data.variance)
    weights = np.ones(3) if weighting == "equal" else sigma**-2.0
    minima = local_minima(data, explained(data), weights)
    if not minima:
        raise RefusedFit("no best fit is found: the readings, or their noise, differ by too many orders of magnitude")
    best = minima[0]
    if given is None and weighting == "likelihood":
        freedom = n - PARAMETERS_OF["simultaneous"] / 3.0  # their exact split moves the weights by less than 1/n
        for _ in range(50):
            updated = 1.0 / np.maximum(best.mean_square * n / freedom, rounding**2)
            change = float(np.abs(np.log(updated / weights)).max())
            weights = updated
            if change < _SETTLED:
                break
            best = reweighted(data, best, weights)
    return _Optimum(
        np.tile(best.field, (3, 1)),
        best.scaled_axes,
        best.offset(data),
        best.mean_square,
        1.0 / np.sqrt(weights),
        tuple(Rival(None, other.field, other.mean_square - best.mean_square) for other in minima[1:]),
    )


def _separate(data: Compressed) -> _Optimum:
    """The least squares of each channel by itself."""
    best: list[Solution] = []
    rivals: list[Rival] = []
    offsets: list[float] = []
    for k in range(3):
        channel = data.channel(k)
        minima = local_minima(channel, explained(channel), np.ones(1))
        best.append(minima[0])
        offsets.append(float(minima[0].offset(channel)[0]))
        rivals += [Rival(k, other.field, other.mean_square - minima[0].mean_square) for other in minima[1:]]
    return _Optimum(
        np.array([solution.field for solution in best]),
        np.array([solution.scaled_axes[0] for solution in best]),
        np.array(offsets),
        np.array([solution.mean_square[0] for solution in best]),
        np.ones(3),
        tuple(rivals),
    )


def _sign(field: Array, points: Array) -> float:
    """+1 or -1, so that the field lies on the side of ``points``; by its largest component where it lies on neither."""
    along = float(field @ points) / float(np.sqrt(points @ points))
    if abs(along) < 1e-9:
        along = float(field[np.argmax(np.abs(field))])
    return 1.0 if along >= 0.0 else -1.0


def _check(statistics: Statistics, method: Method, weighting: Weighting, name: str) -> None:
    if method not in METHODS:
        raise unknown_name("method", method, METHODS)
    if weighting not in WEIGHTINGS:
        raise unknown_name("weighting", weighting, WEIGHTINGS)
    if statistics.channels != 3:
        raise RigError(f"{name}: found {statistics.channels} channels, expected the three of one sensor")
    needed = PARAMETERS_AT_ONCE[method]
    if statistics.count < needed:
        raise RigError(
            f"{name}: found {statistics.count} samples for the {needed} parameters of a {method} fit, expected at least"
            f" {needed}"
        )


def _check_response(data: Compressed, rounding: Array, name: str) -> None:
    if data.rank == 0:
        raise RefusedFit(f"{name}: the orientation never changes, expected readings in many orientations")
    silent = np.flatnonzero(np.sqrt(data.variance) <= 2.0 * rounding)
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
