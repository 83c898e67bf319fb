"""How far a calibration is from the truth, parameter by parameter, in its own standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators.known_angle.reported import NORMAL_95
from rig.errors import RigError
from scenarios.colours import BLACK, BLUE, GREY, VERMILLION
from scenarios.comparison import Compared
from scenarios.plots.style import new_figure, style

_SYMBOLS = {
    "sensitivity": "$S",
    "offset": r"$\delta",
    "beta": r"$\beta",
    "gamma": r"$\gamma",
    "phi": r"$\varphi",
    "psi": r"$\psi",
}


def errors_figure(rows: Sequence[Compared], label: str = "(estimate − truth) / σ") -> Figure:
    """A panel for each sensor with a point for each parameter: (estimate - truth) / standard deviation.

    The dashed lines are at 1.96 standard deviations, within which 95 of 100 errors should lie.

    Raises:
        RigError: there are no parameters.
    """
    if not rows:
        raise RigError("nothing to compare: expected parameters with their truth")
    sensors = list(dict.fromkeys(row.sensor for row in rows))
    with style():
        most = max(sum(row.sensor == sensor for row in rows) for sensor in sensors)
        figure = new_figure(4.6 * len(sensors), 1.3 + 0.27 * most)
        panels = figure.subplots(1, len(sensors), sharex=True, squeeze=False)[0]
        for panel, sensor in zip(panels, sensors, strict=True):
            _panel(panel, sensor, [row for row in rows if row.sensor == sensor], label)
        limit = max((abs(row.error_sigmas) for row in rows if row.error_sigmas is not None), default=0.0)
        panels[0].set_xlim(-1.1 * max(limit, 3.0), 1.1 * max(limit, 3.0))
    return figure


def _panel(axis: Axes, sensor: str, rows: Sequence[Compared], label: str) -> None:
    heights = -np.arange(len(rows), dtype=float)
    axis.axvspan(-NORMAL_95, NORMAL_95, color=GREY, alpha=0.12, linewidth=0)
    axis.axvline(0.0, color=GREY, linewidth=0.7)
    for side in (-NORMAL_95, NORMAL_95):
        axis.axvline(side, color=GREY, linewidth=0.9, linestyle="--")
    told = [(row, height) for row, height in zip(rows, heights, strict=True) if row.error_sigmas is not None]
    for row, height in told:
        error = float(row.error_sigmas or 0.0)
        colour, marker = (BLUE, "o") if abs(error) <= NORMAL_95 else (VERMILLION, "D")
        axis.plot([0.0, error], [height, height], color=colour, linewidth=1.0, alpha=0.6)
        axis.plot(error, height, marker, color=colour, markersize=5)
    for row, height in zip(rows, heights, strict=True):
        if row.error_sigmas is None:
            axis.text(
                0.0, height, "cannot be told", ha="center", va="center", color=BLACK, fontsize=7.5, style="italic"
            )
    inside = sum(abs(row.error_sigmas or 0.0) <= NORMAL_95 for row, _ in told)
    axis.set_title(f"{sensor.capitalize()}: {inside} of {len(told)} within ±1.96σ")
    axis.set_yticks(heights, [_symbol(row.parameter) for row in rows])
    axis.set_ylim(heights[-1] - 0.7, 0.7)
    axis.set_xlabel(label)
    axis.grid(axis="y", visible=False)


def _symbol(parameter: str) -> str:
    """The paper's symbol: ``beta2_deg`` is beta with index 2."""
    stem = parameter.removesuffix("_deg")
    letters = stem.rstrip("0123456789")
    index = stem[len(letters) :]
    if letters not in _SYMBOLS:
        return parameter
    return f"{_SYMBOLS[letters]}_{index}$" if index else f"{_SYMBOLS[letters]}$"
