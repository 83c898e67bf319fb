"""How far a calibration is from the truth, parameter by parameter, in its own standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators.known_angle.reported import NORMAL_95
from rig.errors import RigError
from scenarios.colours import BLACK, GREY
from scenarios.comparison import Compared
from scenarios.plots.style import in_words, judged_point, new_figure, parameter_rows, style
from scenarios.terminal.calibration import symbol


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
    axis.axvspan(-NORMAL_95, NORMAL_95, color=GREY, alpha=0.12, linewidth=0)
    axis.axvline(0.0, color=GREY, linewidth=0.7)
    for side in (-NORMAL_95, NORMAL_95):
        axis.axvline(side, color=GREY, linewidth=0.9, linestyle="--")
    heights = parameter_rows(axis, [_symbol(row.parameter) for row in rows])
    inside = told = 0
    for row, height in zip(rows, heights, strict=True):
        if row.error_sigmas is None:
            in_words(axis, 0.0, height, color=BLACK, fontsize=7.5)
            continue
        good = abs(row.error_sigmas) <= NORMAL_95
        judged_point(axis, height, row.error_sigmas, (0.0, row.error_sigmas), good)
        inside, told = inside + good, told + 1
    axis.set_title(f"{sensor.capitalize()}: {inside} of {told} within ±1.96σ")
    axis.set_xlabel(label)


def _symbol(parameter: str) -> str:
    """The paper's symbol, where it has one: ``beta2_deg`` is β with index 2."""
    name = symbol(parameter)
    if name == parameter.removesuffix("_deg"):
        return parameter
    letters = name.rstrip("123")
    return f"${letters}_{name[len(letters) :]}$" if letters != name else f"${name}$"
