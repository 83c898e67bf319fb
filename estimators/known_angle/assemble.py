"""From the optimum of a sensor to its calibration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from estimators.calibration import SensorCalibration
from estimators.calibration.parts import CONDITION_LIMIT, P_VALUE_LIMIT, AxisCalibration, FieldDirection, Quality
from estimators.known_angle.agreement import angles_between, common_field
from estimators.known_angle.fit import SensorFit
from estimators.known_angle.reported import Reported, report
from estimators.loud_floor import against_floor
from estimators.p_words import p_words
from rig.arrays import Array
from rig.directions import angles_from_direction


def assemble(
    fit: SensorFit,
    *,
    unit: str = "V",
    noise_source: str,
    floor_std: ArrayLike = 0.0,
    field_points: ArrayLike = (0.0, 0.0, -1.0),
    reads: str | None = None,
    field_unit: str | None = None,
) -> SensorCalibration:
    """A calibration with its covariance in every form, and with its quality.

    Args:
        fit: the optimum.
        unit: the recorded unit.
        noise_source: where ``fit.noise`` comes from.
        floor_std: (3,) standard deviation of a given noise floor itself [recorded unit].
        field_points: (3,) what ``fit_sensor`` was given.
        reads: of an accelerometer, "g-a" or "a-g".
        field_unit: of the field; None: relative.
    """
    parameters = fit.parameters
    reported = report(parameters, fit.covariance, fit.method)
    pairs = angles_between(parameters, fit.covariance, fit.method)
    gain = parameters.gain
    invertible = abs(float(np.linalg.det(parameters.axes))) > 1e-9
    separate = fit.method == "separate"
    fields = [_field(reported, parameters.fields[k], f"field{k + 1}") if separate else None for k in range(3)]
    agreement: dict[str, Any] | None = None
    if separate:
        common = common_field(parameters, fit.covariance)
        phi, psi = angles_from_direction(common.vector)
        direction = FieldDirection(float(phi), float(psi), common.vector, common.covariance)
        agreement = {
            "chi_square": common.chi_square,
            "degrees_of_freedom": common.degrees_of_freedom,
            "p_value": float(chdtrc(common.degrees_of_freedom, common.chi_square)),
        }
    else:
        direction = _field(reported, parameters.fields[0], "field")
    chi_square = chi_square_of(fit, floor_std) if fit.noise_given else None
    quality = Quality(
        chi_square=chi_square,
        condition=fit.information.condition,
        field_agreement=agreement,
        warnings=(*reported.warnings, *_warnings(fit, reported, chi_square, agreement, invertible, field_points)),
    )
    return SensorCalibration(
        method=fit.method,
        unit=unit,
        reference_magnitude=parameters.reference_magnitude,
        matrix=np.asarray(np.linalg.inv(gain)) if invertible else np.full((3, 3), np.nan),
        bias=parameters.offset,
        parameters=reported.names,
        values=reported.values,
        covariance=reported.covariance,
        identifiable={name: reported.untold.get(name, True) for name in reported.names},
        samples=fit.count,
        fit_rms=fit.rms,
        axes=tuple(_axis(reported, parameters.axes[k], k, fields[k]) for k in range(3)),
        angles_between_deg={pair: angle for pair, (angle, _) in pairs.items()},
        angles_between_std_deg={pair: std for pair, (_, std) in pairs.items()},
        field_direction=direction,
        vector_parameters=reported.vector_names,
        vector_values=reported.vector_values,
        vector_covariance=reported.vector_covariance,
        noise=fit.noise,
        noise_source=noise_source,
        noise_degrees_of_freedom=None if fit.noise_given else fit.degrees_of_freedom,
        weighting=None if separate else fit.weighting,
        convention="of (field, axes) and (-field, -axes), which give the same readings, the one whose field has a"
        f" positive component along {_numbers(field_points)} in the base frame",
        quality=quality,
        reads=reads,
        field_unit=field_unit,
    )


def chi_square_of(fit: SensorFit, floor_std: ArrayLike) -> dict[str, Any]:
    """Of the residuals against a given floor, which is itself known to ``floor_std`` (3,) [recorded unit]."""
    per_channel = fit.residual_square / fit.noise**2
    freedom = float(fit.degrees_of_freedom.sum())
    relative = np.broadcast_to(np.asarray(floor_std, dtype=float), 3) / fit.noise
    widening = 1.0 + 2.0 * float(np.square(relative * fit.degrees_of_freedom).sum()) / freedom
    ratios = np.sqrt(per_channel / fit.degrees_of_freedom)
    return against_floor(float(per_channel.sum()), freedom, ratios, widening)


def _field(reported: Reported, vector: Array, name: str) -> FieldDirection:
    phi, psi = angles_from_direction(vector)
    return FieldDirection(float(phi), float(psi), vector, _vector_covariance(reported, name))


def _axis(reported: Reported, vector: Array, k: int, own: FieldDirection | None) -> AxisCalibration:
    number = k + 1
    first = reported.names.index(f"sensitivity{number}")
    sensitivity, offset, beta, gamma = reported.values[first : first + 4].tolist()
    return AxisCalibration(
        sensitivity=sensitivity,
        offset=offset,
        beta_deg=beta,
        gamma_deg=gamma,
        axis=vector,
        covariance=_vector_covariance(reported, f"axis{number}"),
        field=own,
    )


def _vector_covariance(reported: Reported, name: str) -> Array:
    first = reported.vector_names.index(f"{name}_x")
    return reported.vector_covariance[first : first + 3, first : first + 3]


def _numbers(values: ArrayLike) -> str:
    return "(" + ", ".join(f"{value:g}" for value in np.asarray(values, dtype=float)) + ")"


def _warnings(
    fit: SensorFit,
    reported: Reported,
    chi_square: dict[str, Any] | None,
    agreement: dict[str, Any] | None,
    invertible: bool,
    field_points: ArrayLike,
) -> list[str]:
    """What to know before relying on it."""
    found: list[str] = []
    if fit.problem is not None:
        found.append(fit.problem)
    if not invertible:
        found.append("the axes do not span space: readings cannot be turned into a field vector, there is no matrix")
    points = np.asarray(field_points, dtype=float)
    points = points / np.linalg.norm(points)
    for k in range(3) if fit.method == "separate" else (0,):
        name = f"field{k + 1}" if fit.method == "separate" else "field"
        spread = float(np.sqrt(points @ _vector_covariance(reported, name) @ points))
        if abs(float(fit.parameters.fields[k] @ points)) < 3.0 * spread:
            found.append(
                f"{name} is at right angles to {_numbers(field_points)} within its uncertainty, so its sign, and that"
                " of the axes, is a matter of chance: state which way it points"
            )
    if chi_square is not None and chi_square["p_value"] < P_VALUE_LIMIT:
        worst = max(chi_square["residual_over_floor"])
        if worst > 1.0:
            found.append(
                f"residuals are up to {worst:.3g} times the noise floor ({p_words(chi_square['p_value'])}): the model"
                " misses something, and the true errors exceed the standard deviations"
            )
    if agreement is not None and agreement["p_value"] < P_VALUE_LIMIT:
        found.append(
            f"the separate fits do not agree on one field direction ({p_words(agreement['p_value'])}): the model misses"
            " something"
        )
    if fit.information.condition > CONDITION_LIMIT:
        found.append(f"the poses tell the parameters apart badly: condition {fit.information.condition:.1e}")
    return found
