"""The noise of a locked-arm recording as tables."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from estimators.calibration import Calibration
from estimators.noise.study import NoiseStudy
from estimators.p_words import p_words
from rig.channels import CHANNELS_OF
from rig.units import conversion_factor, written_unit
from scenarios.shown_units import shown_unit
from scenarios.terminal.tables import plus_minus, table

#: Noise is called white above this probability, as coloured as it looks by chance.
_WHITE = 1e-3
#: Terms are said not to fit below this; long averages scatter more to one side than the chi-square takes them to.
_FITS = 1e-5


def noise_report(study: NoiseStudy, calibration: Calibration | None = None) -> Group:
    """How much noise, and of what kind.

    Args:
        study: of a locked-arm recording.
        calibration: of the same sensors, to give white noise in field units.
    """
    parts: list[RenderableType] = [_amounts(study), Text(""), _kinds(study), *map(Text, _remarks(study)), Text("")]
    if calibration is not None:
        parts += [_fields(study, calibration), Text("")]
    parts += [Text(f"warning: {warning}", style="bold yellow") for warning in study.warnings]
    return Group(*parts[:-1] if not study.warnings else parts)


def _amounts(study: NoiseStudy) -> Table:
    """RMS of each pose and their mean, dynamic range and bits."""
    floor = study.floor
    poses = [f"pose {number}" for number in range(1, len(floor.pose_samples) + 1)]
    columns = [*poses, "RMS", "dynamic range [dB]", "bits"]
    rows = []
    for i, name in enumerate(floor.channels):
        shown = shown_unit(floor.units[i])
        own = [f"{shown.factor * value:.4g}" for value in floor.pose_rms[:, i]]
        rms = plus_minus(shown.factor * floor.rms[i], shown.factor * floor.rms_std[i])
        dynamic = [
            plus_minus(value, spread) if np.isfinite(value) else "–"
            for value, spread in (
                (floor.dynamic_range_dB[i], floor.dynamic_range_std_dB[i]),
                (floor.bits[i], floor.bits_std[i]),
            )
        ]
        rows.append((name, shown.name, *own, rms, *dynamic))
    return table("channel", "unit", *columns, numbers=columns, rows=rows)


def _kinds(study: NoiseStudy) -> Table:
    """The terms of the Allan deviation, and whether the noise is white."""
    shown = shown_unit(next((noise.unit for noise in study.channels.values()), ""))
    columns = (
        f"N white [{shown.name}/√Hz]",
        f"B bias instability [{shown.name}]",
        f"K random walk [{shown.name}/√s]",
        f"Q quantisation [{shown.name} s]",
        f"R ramp [{shown.name}/s]",
    )
    rows = []
    for name, noise in study.channels.items():
        cells = []
        for term_name in ("white", "bias_instability", "random_walk", "quantisation", "ramp"):
            term = noise.terms[term_name]
            seen = plus_minus(shown.factor * term.value, shown.factor * term.std)
            cells.append(seen if term.seen else f"< {shown.factor * term.upper:.2g}")
        p_value = noise.whiteness.p_value
        white = f"{'yes' if p_value > _WHITE else 'no'}, {p_words(p_value)}"
        rows.append((name, *cells, white, str(noise.autoregression.order)))
    return table("channel", *columns, "white?", "AR", numbers=columns, rows=rows)


def _remarks(study: NoiseStudy) -> Iterable[str]:
    floor = study.floor
    if (told := np.flatnonzero(np.isfinite(floor.dynamic_range_dB))).size:
        channel = int(told[0])
        factor = conversion_factor(floor.units[channel], "V")
        full_scale = factor * floor.rms[channel] * 10.0 ** (floor.dynamic_range_dB[channel] / 20.0)
        yield f"dynamic range and bits: of a range of {full_scale:.4g} V, as in Renk et al.; a recording states none"
    test = next((noise.whiteness for noise in study.channels.values()), None)
    if test is not None:
        yield (
            f"white?: Ljung-Box over {test.lags} lags, chi-square with {test.degrees_of_freedom} degrees of freedom for"
            " white noise. AR: order of the autoregression"
        )
        yield "that whitens. A number after < is what the term does not exceed with 95 % confidence."
    for name, noise in study.channels.items():
        if noise.terms.p_value < _FITS:
            yield f"{name}: these terms do not describe its Allan deviation, {p_words(noise.terms.p_value)}"
        if noise.left_over.p_value < _WHITE and noise.autoregression.order > 0:
            yield f"{name}: its autoregression leaves something coloured, {p_words(noise.left_over.p_value)}"


def _fields(study: NoiseStudy, calibration: Calibration) -> Table:
    """White noise in field units: an accelerometer's is its velocity random walk."""
    rows = []
    for sensor, names in CHANNELS_OF.items():
        if sensor not in calibration.sensors or not calibration[sensor].axes:
            continue
        field = written_unit(calibration[sensor].field_unit or "field")
        unit = f"({field})/√Hz" if "/" in field else f"{field}/√Hz"
        for name, sensitivity in zip(names, calibration[sensor].sensitivity, strict=True):
            if name in study.channels and study.channels[name].unit == calibration[sensor].unit:
                term = study.channels[name].terms["white"]
                rows.append((name, plus_minus(term.value / sensitivity, term.std / sensitivity), unit))
    return table("channel", "N / S", "unit", numbers=("N / S",), rows=rows)
