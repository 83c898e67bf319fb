"""A calibration as a table to be read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from estimators.p_words import p_words
from rig.number_text import with_std

if TYPE_CHECKING:
    from estimators.calibration.contract import Calibration, SensorCalibration


def summary(calibration: Calibration) -> str:
    """Every parameter with its standard deviation, or why it cannot be told."""
    blocks = [_sensor(name, sensor) for name, sensor in calibration.sensors.items()]
    title = f"Calibration of {calibration.recording}" if calibration.recording else "Calibration"
    return "\n\n".join([title, *blocks])


def _sensor(name: str, sensor: SensorCalibration) -> str:
    lines = [f"{name}: {sensor.method}, {sensor.samples} samples"]
    if sensor.noise_source is not None:
        lines[0] += f", noise from {sensor.noise_source}"
    rows = [("parameter", "estimate", "std", "unit")]
    reasons: list[tuple[str, str]] = []
    for parameter in sensor.parameters:
        told = sensor.identifiable.get(parameter, True)
        value, std = with_std(sensor.value(parameter), sensor.std(parameter), "-")
        rows.append((parameter.removesuffix("_deg"), value, std, sensor.unit_of(parameter)))
        if told is not True:
            reasons.append((parameter.removesuffix("_deg"), str(told)))
    if sensor.field_direction is not None:
        vector, covariance = sensor.field_direction.vector, sensor.field_direction.covariance
        for axis in range(3):
            value, std = with_std(float(vector[axis]), math.sqrt(max(covariance[axis, axis], 0.0)), "-")
            rows.append((f"field {'xyz'[axis]}", value, std, ""))
    for pair, angle in sensor.angles_between_deg.items():
        value, std = with_std(angle, sensor.angles_between_std_deg.get(pair), "-")
        rows.append((f"angle {pair}", value, std, "deg"))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    for row in rows:
        lines.append(f"  {row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]}".rstrip())
    rms = ", ".join(f"{value:.4g}" for value in sensor.fit_rms)
    lines.append(
        f"  fit error {rms} {sensor.unit} (RMS per channel); root sum square {sensor.fit_rms_root_sum_square:.4g}"
    )
    if (chi_square := sensor.quality.chi_square) is not None:
        lines.append(
            f"  chi-square {chi_square['value']:.1f} for {chi_square['degrees_of_freedom']:.0f} degrees of freedom,"
            f" {p_words(chi_square['p_value'])}"
        )
    lines += [f"  not told: {parameter}: {reason}" for parameter, reason in reasons]
    verdict = sensor.quality.verdict
    told_before = () if verdict is None else verdict["reasons"]
    lines += [f"  warning: {warning}" for warning in sensor.quality.warnings if warning not in told_before]
    if verdict is not None:
        lines.append(f"  {verdict['text']}")
    return "\n".join(lines)
