"""What a calibration leaves over: residuals against time, and their distribution beside them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.arrays import Array
from rig.errors import RigError
from scenarios.colours import AXES_ON_PAPER, BLACK, GREY
from scenarios.decimation import evenly, means_of_blocks
from scenarios.overlay import Overlay
from scenarios.plots.style import new_figure, style

_POINTS = 20_000
_BLOCKS = 60
_BINS = 61


def residuals_figure(t: Array, overlays: Mapping[str, Overlay]) -> Figure:
    """A row for each series of residuals: points over time with the band of three standard deviations, and a histogram.

    The black line is the mean of each of 60 equal blocks, which shows what single points hide in their noise; the curve
    over the histogram is the normal distribution of that standard deviation.

    Args:
        t: (n,) [s] of the recording.
        overlays: sensor -> its calibration laid over the recording.

    Raises:
        RigError: there are none.
    """
    if not overlays:
        raise RigError("nothing to plot residuals of: expected a calibration of a recorded sensor")
    rows = [(overlay, number) for overlay in overlays.values() for number in range(len(overlay.names))]
    with style():
        figure = new_figure(10.0, 0.6 + 1.45 * len(rows))
        axes = figure.subplots(len(rows), 2, width_ratios=(4.2, 1.0), sharex="col", sharey="row", squeeze=False)
        for (left, right), (overlay, number) in zip(axes, rows, strict=True):
            colour = AXES_ON_PAPER[number % 3]
            values, sigma = overlay.residuals[:, number], float(overlay.sigma[number])
            _over_time(left, t, values, sigma, colour)
            left.set_ylabel(f"{overlay.names[number]} [{overlay.unit}]")
            _distribution(right, values, sigma, colour)
        axes[0, 0].set_title("Residuals: reading less the model's; shaded: ±3σ; black: block means")
        axes[0, 1].set_title("Distribution and N(0, σ)")
        axes[-1, 0].set_xlabel("time [s]")
        axes[-1, 1].set_xlabel("density [1/σ]")
        figure.align_ylabels(axes[:, 0])
    return figure


def _over_time(axis: Axes, t: Array, values: Array, sigma: float, colour: str) -> None:
    axis.axhspan(-3.0 * sigma, 3.0 * sigma, color=GREY, alpha=0.16, linewidth=0)
    axis.axhline(0.0, color=GREY, linewidth=0.6)
    shown = evenly(len(t), _POINTS)
    axis.plot(t[shown], values[shown], ".", color=colour, markersize=1.8, alpha=0.6, markeredgewidth=0, rasterized=True)
    axis.plot(means_of_blocks(t, _BLOCKS), means_of_blocks(values, _BLOCKS), color=BLACK, linewidth=1.0)
    limit = 1.08 * max(float(np.abs(values).max()), 3.4 * sigma)
    axis.set_ylim(-limit, limit)
    if t[-1] > t[0]:
        axis.set_xlim(float(t[0]), float(t[-1]))


def _distribution(axis: Axes, values: Array, sigma: float, colour: str) -> None:
    limit = max(float(np.abs(values).max()), 3.4 * sigma)
    edges = np.linspace(-limit, limit, _BINS + 1)
    counts, _ = np.histogram(values, edges)
    density = counts / len(values) / np.diff(edges) * sigma
    axis.stairs(density, edges, orientation="horizontal", fill=True, color=colour, alpha=0.45)
    at = np.linspace(-limit, limit, 400)
    axis.plot(np.exp(-0.5 * (at / sigma) ** 2) / np.sqrt(2.0 * np.pi), at, color=BLACK, linewidth=1.0)
    beyond = 100.0 * float(np.mean(np.abs(values) > 3.0 * sigma))
    rms = float(np.sqrt(np.mean(np.square(values))))
    note = f"RMS {rms:.3g}\nσ {sigma:.3g}\n{beyond:.2f} % > 3σ"
    axis.text(0.98, 0.97, note, transform=axis.transAxes, ha="right", va="top", fontsize=7.5)
    axis.set_xlim(0.0, 1.5 * max(0.4, float(density.max())))
    axis.tick_params(labelleft=False)
