"""What a maneuver can tell, before anyone runs it: the Cramer-Rao bound of poses, a truth and a noise floor.

No unbiased estimate has a smaller covariance than the inverse of the Fisher information, and the known-angle fit
reaches it. The information needs the poses only through the Gram matrix of [vec R, 1], so that a maneuver's worth up to
any instant is a prefix sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimators.batch.parameters import ManyParameters, Uncertainty, places
from estimators.design.prediction import KnownAnglePrediction
from estimators.known_angle.agreement import angles_between
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import Method, SensorParameters, columns_by_name, sizes_by_name
from estimators.known_angle.reported import report
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array
from rig.errors import RefusedFit
from rig.threads import one_blas_thread


def predict(
    gram: ArrayLike, count: int, truth: SensorParameters, noise: ArrayLike, method: Method = "simultaneous"
) -> KnownAnglePrediction:
    """The bound of one sensor.

    Args:
        gram: (10, 10) sum of x x^T, x = [vec R_base_tool by rows, 1], as of ``Statistics``.
        count: n, the number of samples in it.
        truth: where the information is taken; a data sheet's values will do.
        noise: (3,) standard deviation of a reading, above zero [recorded unit].
        method: of the calibration that is foreseen.
    """
    poses = np.asarray(gram, dtype=float)
    sigma = np.broadcast_to(np.asarray(noise, dtype=float), (3,))
    with one_blas_thread():
        information = Information.of(poses, truth, sigma, method)
        covariance = information.covariance
        reported = report(truth, covariance, method)
        pairs = angles_between(truth, covariance, method)
        problem = _problem(poses, count, truth, sigma, method)
    lost = information.undetermined()
    untold = dict(reported.untold)
    for name in lost:
        untold |= dict.fromkeys(reported.names[columns_by_name(method)[name]], f"{name} is left open by these poses")
    std = np.sqrt(reported.covariance.diagonal())
    std[[name in untold for name in reported.names]] = np.nan
    sizes = sizes_by_name(covariance.diagonal(), method)
    spread_deg = {name: np.nan if name in lost else float(np.degrees(size)) for name, size in sizes.items()}
    return KnownAnglePrediction(
        method=method,
        samples=count,
        noise=sigma,
        names=reported.names,
        values=reported.values,
        std=std,
        untold=untold,
        axis_std_deg=np.array([spread_deg[f"axis{k}"] for k in (1, 2, 3)]),
        field_std_deg=np.array([value for name, value in spread_deg.items() if name.startswith("field")]),
        angles_between_std_deg={
            pair: np.nan if any(f"axis{number}" in lost for number in pair.split("-")) else value
            for pair, (_, value) in pairs.items()
        },
        condition=information.condition,
        problem=problem,
    )


def _problem(gram: Array, count: int, truth: SensorParameters, noise: Array, method: Method) -> str | None:
    """Why a fit to readings of these poses would be refused: such a fit is tried, without the noise in the readings."""
    theta = truth.coefficients
    exact = Statistics(count, gram, gram @ theta, theta.T @ gram @ theta)
    try:
        fit = fit_sensor(
            exact,
            truth.reference_magnitude,
            method=method,
            noise=noise,
            field_points=truth.fields[0],
            refuse=False,
        )
    except RefusedFit as refusal:
        return str(refusal).removeprefix("sensor: ")
    return fit.problem


@dataclass(frozen=True, eq=False)
class Growth:
    """How the bound of one sensor falls as a maneuver goes on.

    Attributes:
        sensitivity: (b, 3) standard deviation relative to S_k. offset: (b, 3) [recorded unit].
        axis_deg: (b, 3) root mean square angle between each axis and its estimate [deg].
        field_deg: (b, 1), or (b, 3) of separate fits [deg].
        share: (b,) of everything learned in the end, what each interval has paid for: tr(C F_i) / p with C the final
            bound and F_i the information of interval i. The shares add up to one; NaN where the end leaves something
            open.

    After b intervals of the maneuver each; NaN until the parameters are determined.
    """

    sensitivity: Array
    offset: Array
    axis_deg: Array
    field_deg: Array
    share: Array


def growth(grams: ArrayLike, truth: SensorParameters, noise: ArrayLike, method: Method = "simultaneous") -> Growth:
    """The bound after each interval of a maneuver.

    Args:
        grams: (b, 10, 10) of each interval alone, as of ``predict``.
        truth, noise, method: as of ``predict``.
    """
    parts = np.asarray(grams, dtype=float)
    sigma = np.broadcast_to(np.asarray(noise, dtype=float), (len(parts), 3))
    with one_blas_thread():
        many = ManyParameters.stacked([truth] * len(parts))
        own = many.information(parts)
        found = Uncertainty.of(np.cumsum(own, axis=0), sigma, method)
        final = found.covariance[-1]
        paid = [
            np.einsum("ij,bji->b", final[np.ix_(place, place)], own[:, k]) / sigma[0, k] ** 2
            for k, place in enumerate(places(method))
        ]
    variance = np.where(found.determined[:, None], np.einsum("bii->bi", found.covariance), np.nan)
    share = np.sum(paid, axis=0) / variance.shape[1]
    sizes = sizes_by_name(variance, method)

    def spread(stem: str) -> Array:
        """(b, c) of what begins with ``stem``."""
        return np.stack([size for name, size in sizes.items() if name.startswith(stem)], axis=1)

    return Growth(
        sensitivity=spread("sensitivity"),
        offset=spread("offset") * truth.scales[:, 1],
        axis_deg=np.degrees(spread("axis")),
        field_deg=np.degrees(spread("field")),
        share=share if found.determined[-1] else np.full(len(parts), np.nan),
    )
