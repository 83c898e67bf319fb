"""From the fit of one sensor to its calibration."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from estimators.calibration import SensorCalibration
from estimators.calibration.parts import CONDITION_LIMIT, P_VALUE_LIMIT, Quality
from estimators.ellipsoid.fit import EllipsoidFit
from estimators.ellipsoid.monomials import PAIRS
from estimators.loud_floor import against_floor
from estimators.p_words import p_words
from rig.arrays import Array

METHOD: Final = "ellipsoid"
#: More outliers than this share are a warning.
OUTLIER_LIMIT: Final = 0.01
#: An angle between two axes that is further from 90 degrees than this is likelier a wrong fit.
SKEW_LIMIT_DEG: Final = 20.0

_OWN: Final = (
    "the field is resolved in the sensor's own frame, in which the gain is symmetric: how that lies in the housing, and"
    " whether the axes are right-handed, cannot be told without the attitude"
)


def assemble(
    fit: EllipsoidFit,
    readings: Array,
    *,
    unit: str = "V",
    noise_source: str = "residuals",
    floor_std: Array | None = None,
    counts: Array | None = None,
    R_common_own: Array | None = None,
    field_unit: str | None = None,
) -> SensorCalibration:
    """A calibration with its covariance as sensitivities and angles, and as the entries of the gain.

    Args:
        fit: of the sensor.
        readings: (n, 3) that were given to it [recorded unit].
        unit: the recorded unit.
        noise_source: where ``fit.noise`` comes from.
        floor_std: (3,) standard deviation of a given noise floor itself [recorded unit].
        counts: (n,) as given to the fit.
        R_common_own: (3, 3) from the sensor's own frame to one that both sensors share.
        field_unit: of the field; None: relative.
    """
    names, values, derivative = sensitivities_and_angles(fit)
    used = readings if fit.used is None else readings[fit.used]
    number = None if counts is None else counts if fit.used is None else counts[fit.used]
    by_channel, ratio = _channel_residuals(fit, used, number)
    chi_square = None
    if fit.noise_given:
        relative = np.zeros(3) if floor_std is None else floor_std / fit.noise
        widening = 1.0 + 2.0 * fit.degrees_of_freedom * float(np.mean(np.square(relative)))
        chi_square = against_floor(fit.chi_square, float(fit.degrees_of_freedom), ratio, widening)
    outliers = fit.dropped.outliers
    quality = Quality(
        chi_square=chi_square,
        condition=fit.condition if np.isfinite(fit.condition) else np.inf,
        coverage={
            "mean_direction": fit.spread.mean.tolist(),
            "direction_variances": fit.spread.variances.tolist(),
            "least_along": fit.spread.least_along.tolist(),
        },
        repeats={"repeated": fit.dropped.repeated, "all_zero": fit.dropped.zero},
        outliers={"count": outliers, "share": outliers / max(len(readings), 1)},
        warnings=tuple(_warnings(fit, chi_square, len(readings), dict(zip(names, values, strict=True)))),
    )
    matrix = fit.matrix
    frame = _OWN
    if R_common_own is not None:
        matrix = R_common_own @ matrix
        frame = (
            "the field is resolved in the accelerometer's own frame, found by the constant angle between the two"
            " fields; the gain's entries are in the sensor's own frame, in which it is symmetric"
        )
    return SensorCalibration(
        method=METHOD if fit.estimator == "likelihood" else f"{METHOD}, {fit.estimator}",
        unit=unit,
        field_unit=field_unit,
        reference_magnitude=fit.reference_magnitude,
        matrix=matrix,
        bias=fit.offset,
        parameters=names,
        values=values,
        covariance=derivative @ fit.covariance @ derivative.T,
        identifiable=dict.fromkeys(names, fit.problem or True),
        samples=fit.samples if number is None else int(number.sum()),
        fit_rms=by_channel,
        vector_parameters=fit.names,
        vector_values=fit.values,
        vector_covariance=fit.covariance,
        noise=fit.noise,
        noise_source=noise_source if fit.noise_given else "residuals",
        noise_degrees_of_freedom=None if fit.noise_given else np.full(3, float(fit.degrees_of_freedom)),
        convention=frame,
        quality=quality,
    )


def sensitivities_and_angles(fit: EllipsoidFit) -> tuple[tuple[str, ...], Array, Array]:
    """The lengths of the gain's rows, the angles between them [deg] and the offsets: whatever frame the field is
    resolved in, they are the same. With their derivative by ``fit.values``."""
    gain, pairs = fit.gain, PAIRS[: fit.parameters - 3]
    length = np.linalg.norm(gain, axis=1)
    axes = gain / length[:, None]
    change = np.zeros((len(pairs), 3, 3))
    for column, (i, j) in enumerate(pairs):
        change[column, i, j] = change[column, j, i] = 1.0
    p = fit.parameters
    names = ["sensitivity1", "sensitivity2", "sensitivity3"]
    values, rows = list(length), [np.einsum("cj,j->c", change[:, k], axes[k]) for k in range(3)]
    for i, j in PAIRS[3:] if p == 9 else ():
        cosine = float(axes[i] @ axes[j])
        sine = float(np.sqrt(1.0 - cosine**2))
        by = (
            change[:, i] @ (axes[j] - cosine * axes[i]) / length[i]
            + change[:, j] @ (axes[i] - cosine * axes[j]) / length[j]
        )
        names.append(f"angle{i + 1}-{j + 1}_deg")
        values.append(np.degrees(np.arccos(cosine)))
        rows.append(np.degrees(-by / sine))
    derivative = np.zeros((p, p))
    derivative[: p - 3, : p - 3] = rows
    derivative[p - 3 :, p - 3 :] = np.eye(3)
    names += ["offset1", "offset2", "offset3"]
    return tuple(names), np.concatenate([values, fit.offset]), derivative


def _channel_residuals(fit: EllipsoidFit, readings: Array, counts: Array | None) -> tuple[Array, Array]:
    """(3,) root mean square of the shifts that bring each reading onto the ellipsoid, and (3,) over what the noise lets
    expect. Of the shifts that do so, each reading's is the likeliest: along the noise's covariance times the normal."""
    field = fit.field_of(readings)
    distance = np.linalg.norm(field, axis=1)
    normal = (field / distance[:, None]) @ fit.matrix
    spread = normal * np.square(fit.noise)
    variance = (normal * spread).sum(axis=1)
    shift = spread * ((distance - fit.reference_magnitude) / variance)[:, None]
    expected = np.square(spread) / variance[:, None]
    weight = np.ones(len(readings)) if counts is None else counts
    squares = weight @ np.square(shift)
    freedom = max(fit.degrees_of_freedom, 1) / len(readings)
    ratio = np.sqrt(squares / np.maximum(freedom * expected.sum(axis=0), np.finfo(float).tiny))
    return np.sqrt(np.square(shift).mean(axis=0)), ratio


def _warnings(fit: EllipsoidFit, chi_square: dict[str, Any] | None, given: int, values: dict[str, float]) -> list[str]:
    found = [] if fit.problem is None else [fit.problem]
    if fit.dropped.outliers > OUTLIER_LIMIT * given:
        found.append(
            f"{fit.dropped.outliers} of {given} readings are outliers and were left out: the field, or the sensor, was"
            " disturbed"
        )
    if chi_square is not None and chi_square["p_value"] < P_VALUE_LIMIT:
        worst = float(np.sqrt(chi_square["value"] / max(chi_square["degrees_of_freedom"], 1.0)))
        if worst > 1.0:
            found.append(
                f"residuals are {worst:.3g} times the noise floor ({p_words(chi_square['p_value'])}): the field's"
                " magnitude was not constant, or the model misses something, and the true errors exceed the standard"
                " deviations"
            )
    if np.isfinite(fit.condition) and fit.condition > CONDITION_LIMIT:
        found.append(f"the readings tell the parameters apart badly: condition {fit.condition:.1e}")
    for name, value in values.items():
        if name.startswith("angle") and abs(value - 90.0) > SKEW_LIMIT_DEG:
            found.append(f"{name.removesuffix('_deg')} is {value:.1f} deg, expected axes nearly at right angles")
    return found
