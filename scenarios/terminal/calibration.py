"""A calibration as tables: values with their standard deviation, what cannot be told and why, and how well it fits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from estimators.calibration import Calibration, SensorCalibration
from estimators.p_words import p_words
from rig.channels import ACCELEROMETER
from rig.number_text import with_std
from scenarios.comparison import Compared
from scenarios.shown_units import shown_unit
from scenarios.terminal.tables import plus_minus, table

_SYMBOLS = {"sensitivity": "S", "offset": "δ", "beta": "β", "gamma": "γ", "phi": "φ", "psi": "ψ"}


def calibration_report(calibration: Calibration) -> Group:
    """All sensors of a calibration."""
    parts: list[RenderableType] = []
    for name, sensor in calibration.sensors.items():
        parts += [*_sensor(name, sensor), Text("")]
        if told := calibration.extra.get("recordings", {}).get(name):
            parts += [_recordings(told, sensor.unit), Text("")]
    if alignment := calibration.extra.get("alignment"):
        own = calibration.sensors.get(ACCELEROMETER)
        return Group(*parts, *_alignment(alignment, "a - g" if own is not None and own.reads == "a-g" else "g - a"))
    if searched := calibration.extra.get("fminunc"):
        return Group(*parts, _searched(searched))
    return Group(*parts[:-1])


def _recordings(told: Iterable[Mapping[str, Any]], unit: str) -> Table:
    """What each of several recordings adds, and whether it agrees with the others."""
    shown = shown_unit(unit)
    columns = ("samples", f"noise [{shown.name}]", "share of what is told [%]", "agrees, p")
    rows = []
    for each in told:
        noise = ", ".join(f"{shown.factor * value:.4g}" for value in each["noise"])
        agreement = each["agreement"]
        p = f"{agreement['p_value']:.2g}" if agreement["degrees_of_freedom"] else "no other tells"
        rows.append((each["recording"], f"{each['samples']:,}", noise, f"{100.0 * each['share']:.1f}", p))
    return table("recording", *columns, numbers=columns, rows=rows)


def _searched(ends: Mapping[str, Any]) -> Table:
    """Where the search of Renk et al. ended, beside the calibration."""
    columns = ("iterations", "evaluations", "sum of squares / calibration's", "farthest parameter", "off by [σ]")
    rows = [
        (
            sensor,
            f"{end['iterations']:,}",
            f"{end['evaluations']:,}",
            f"{end['cost_ratio']:.6f}",
            symbol(end["parameter"]),
            f"{end['sigmas']:.2g}",
        )
        for sensor, end in ends.items()
    ]
    return table("as Renk et al. (quasi-Newton)", *columns, numbers=(*columns[:3], columns[4]), rows=rows)


def _sensor(name: str, sensor: SensorCalibration) -> Iterable[RenderableType]:
    source = {None: "", "given": ", noise as given"}.get(sensor.noise_source, f", noise from the {sensor.noise_source}")
    weights = ", channels weighted equally" if sensor.weighting == "equal" else ""
    heading = Text(f"{name}  ", style="bold")
    yield heading.append(f"{sensor.method}, {sensor.samples:,} samples{source}{weights}", style="not bold")
    yield _axes(sensor) if sensor.axes else _matrix(sensor)
    if sensor.reads == "a-g":
        yield Text("reads           a - g: up at rest, as the field below; the axes as they lie on the chip")
    for line in _lines(sensor):
        yield Text(line)
    untold = [(parameter, told) for parameter, told in sensor.identifiable.items() if told is not True]
    for parameter, why in untold:
        yield Text(f"cannot be told: {symbol(parameter)}: {why}", style="yellow")
    verdict = sensor.quality.verdict
    for warning in sensor.quality.warnings:
        if verdict is None or warning not in verdict["reasons"]:
            yield Text(f"warning: {warning}", style="bold yellow")
    if verdict is not None:
        yield Text(f"verdict         {verdict['text']}", style="green" if verdict["good"] else "bold red")


def _axes(sensor: SensorCalibration) -> Table:
    """One row an axis."""
    stems = ("sensitivity{}", "offset{}", "beta{}_deg", "gamma{}_deg")
    columns = [f"{symbol(stem.format(''))} [{sensor.unit_of(stem.format(1))}]" for stem in stems]
    rows = [(str(axis), *(_tight(sensor, stem.format(axis)) for stem in stems)) for axis in (1, 2, 3)]
    return table("axis", *columns, numbers=columns, rows=rows)


def _tight(sensor: SensorCalibration, parameter: str) -> str:
    return plus_minus(sensor.value(parameter), sensor.std(parameter), "±")


def _matrix(sensor: SensorCalibration) -> Table:
    """One row an axis, and what to multiply with, of a calibration that does not know the attitude."""
    units = [sensor.unit_of(name) for name in ("sensitivity1", "offset1")]
    columns = [f"S [{units[0]}]", f"δ [{units[1]}]", "field = matrix (V - δ)", " ", "  "]
    rows = []
    for axis, row in enumerate(sensor.matrix, 1):
        own = (_tight(sensor, f"sensitivity{axis}"), _tight(sensor, f"offset{axis}"))
        rows.append((str(axis), *own, *(f"{value:.6g}" for value in row)))
    return table("axis", *columns, numbers=columns, rows=rows)


def _alignment(found: Mapping[str, Any], reads: str) -> Iterable[Text]:
    """Both sensors in one frame, as of ``estimators.ellipsoid.Alignment``, and what that leaves open."""
    heading = Text("both in one frame", style="bold")
    if "refused" in found:
        yield heading.append(f"  refused: {found['refused']}", style="not bold yellow")
        return
    angle = plus_minus(found["angle_deg"], found["angle_std_deg"], "±")
    words = f"  {angle} deg between {reads} and the magnetic field, by {found['samples']:,} samples"
    yield heading.append(words, style="not bold")
    for words in found["cannot_tell"]:
        yield Text(f"cannot be told: {words}", style="yellow")


def _lines(sensor: SensorCalibration) -> Iterable[str]:
    direction = sensor.field_direction
    if direction is not None:
        if "phi_deg" in sensor.parameters:
            yield f"field           φ {_tight(sensor, 'phi_deg')} deg, ψ {_tight(sensor, 'psi_deg')} deg"
        else:
            for axis in (1, 2, 3):
                phi, psi = _tight(sensor, f"phi{axis}_deg"), _tight(sensor, f"psi{axis}_deg")
                yield f"field of axis {axis} φ {phi} deg, ψ {psi} deg"
            yield f"field of all    φ {direction.phi_deg:.4f} deg, ψ {direction.psi_deg:.4f} deg"
        spread = np.sqrt(np.maximum(np.diagonal(direction.covariance), 0.0))
        vector = ", ".join(map(plus_minus, direction.vector.tolist(), spread.tolist()))
        yield f"  in the base   ({vector})"
    skew = [pair for pair in ("1-2", "1-3", "2-3") if f"angle{pair}_deg" in sensor.parameters]
    if skew:
        angles = [f"{pair} {_tight(sensor, f'angle{pair}_deg')}" for pair in skew]
        yield f"angles of axes  {', '.join(angles)} deg"
    if not sensor.axes and sensor.convention is not None:
        yield f"frame           {sensor.convention}"
    if sensor.angles_between_deg:
        angles = [
            f"{pair} {plus_minus(angle, sensor.angles_between_std_deg.get(pair), '±')}"
            for pair, angle in sensor.angles_between_deg.items()
        ]
        yield f"angles of axes  {', '.join(angles)} deg"
    shown = shown_unit(sensor.unit)
    errors = ", ".join(f"{shown.factor * value:#.4g}" for value in sensor.fit_rms)
    total = shown.factor * sensor.fit_rms_root_sum_square
    yield f"fit error       {errors} {shown.name} RMS; root sum of squares {total:#.4g} {shown.name}"
    if chi_square := sensor.quality.chi_square:
        ratios = ", ".join(f"{ratio:.3f}" for ratio in chi_square["residual_over_floor"])
        yield (
            f"chi-square      {chi_square['value']:.0f} for {chi_square['degrees_of_freedom']:.0f} degrees of freedom, "
            f"{p_words(chi_square['p_value'])}"
        )
        yield f"over the floor  {ratios} times"
    if agreement := sensor.quality.field_agreement:
        yield (
            f"one field?      chi-square {agreement['chi_square']:.1f} for {agreement['degrees_of_freedom']:.0f} "
            f"degrees of freedom, {p_words(agreement['p_value'])}"
        )


def symbol(parameter: str) -> str:
    """A parameter as the paper writes it: S1, δ1, β1, γ1, φ, ψ."""
    name = parameter.removesuffix("_deg")
    stem = name.rstrip("123")
    return f"{_SYMBOLS.get(stem, stem)}{name[len(stem) :]}"


def comparison_table(rows: Sequence[Compared], names: tuple[str, str] = ("truth", "estimate")) -> Table:
    """Truth, estimate, standard deviation and error of every parameter; ``names`` are of the first two."""
    error = "error / σ" if names[0] == "truth" else f"({names[1]} − {names[0]}) / σ"
    numbers = (*names, "σ", error)
    result = table("parameter", "unit", *numbers, numbers=numbers)
    previous = ""
    for row in rows:
        if row.sensor != previous:
            if previous:
                result.add_section()
            result.add_row(Text(row.sensor, style="bold"))
        estimate, sigma = with_std(row.estimate, row.sigma)
        error = "–" if row.error_sigmas is None else f"{row.error_sigmas:+.2f}"
        result.add_row(*map(Text, (symbol(row.parameter), row.unit, f"{row.truth:.7g}", estimate, sigma, error)))
        previous = row.sensor
    return result
