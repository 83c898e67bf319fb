"""The residual's spectrum, and the residual in time, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator
from scipy.signal import periodogram

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arrays import Array, Rows
from rig.channels import CHANNELS
from rig.effects import Effect, Kind
from scenarios.colours import BAND, BLACK, BLUE, GREY, VERMILLION
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.plots.inline_svg import inline_svg, page_panels
from scenarios.plots.style import style
from scenarios.shown_units import shown_units

_BANDS: Final = 90
_BLOCKS: Final = 160
#: Up to so many decades there is room for 1, 2 and 5 of each.
_CLOSE: Final = 3.0
_LINES: Final[dict[str, dict[str, Any]]] = {
    "before": {"color": VERMILLION},
    "after": {"color": BLUE},
    "named": {"color": BLUE, "linestyle": ":", "linewidth": 1.4},
    "floor": {"color": BLACK, "linestyle": "--"},
}


def spectrum(residuals: GapResiduals) -> str:
    """Amplitude density of each channel's residual before and after, and of its floor; three panels a row."""
    columns, interval = residuals.data.columns, residuals.data.interval_s
    shown = shown_units(residuals.recording.units)
    with style():
        rows = (len(columns) + 2) // 3
        figure, axes = page_panels((1000.0, 186.0 * rows), rows, 3, (66.0, 12.0, 24.0, 42.0), (76.0, 66.0))
        for axis, column in zip(axes.flat, columns, strict=True):
            unit = shown[CHANNELS[column]]
            frequency, before = density(residuals.before[:, column], interval)
            lines = {"before": before}
            if residuals.after is not None:
                after = np.where(residuals.left_out[:, column], 0.0, residuals.after[:, column])
                lines["after"] = density(after, interval)[1]
            floor = floor_density(residuals.floor[column], frequency, interval)
            named = floor + named_density(residuals.causes, column, frequency, interval)
            if np.any(named != floor):
                lines["named"] = named
            for name, line in (lines | {"floor": floor}).items():
                axis.plot(frequency, unit.factor * np.sqrt(np.where(line > 0.0, line, np.nan)), **_LINES[name])
            axis.margins(x=0.0)
            label_decades(axis)
            axis.set_title(CHANNELS[column], weight="bold")
            axis.set_ylabel(f"{unit.name}/√Hz")
            axis.set_xlabel("frequency [Hz]")
    return inline_svg(figure, "amplitude density of the residuals before and after, and of the floor")


def label_decades(axis: Axes) -> None:
    """Logarithmic scales of what is drawn, with round values that keep apart, and nothing between them."""
    axis.set_xscale("log")
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    if high < 5.0 * low:  # so that two round values are among them
        low, high = (np.sqrt(low * high) * factor for factor in (0.44, 2.3))
        axis.set_ylim(low, high)
    close = np.log10(high / low) <= _CLOSE
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if close else (1.0,), numticks=8))
    for each in (axis.xaxis, axis.yaxis):
        each.set_major_formatter("{x:g}")
        each.set_minor_locator(NullLocator())


def density(values: Array, interval_s: float) -> tuple[Array, Array]:
    """Frequencies (m,) [Hz] and the mean power density [unit^2/Hz] of values (n,) in bands of even ratio."""
    frequency, power = (each[1:] for each in periodogram(values, 1.0 / interval_s, "hann"))
    edges = np.unique(np.round(np.geomspace(1, len(frequency) + 1, _BANDS)).astype(int)) - 1
    starts = edges[:-1]
    counts = np.diff(edges)
    middle = np.exp(np.add.reduceat(np.log(frequency), starts) / counts)
    return middle, np.add.reduceat(power, starts) / counts


def floor_density(floor: ChannelNoise, frequency: Array, interval_s: float) -> Array:
    """One-sided power density (m,) [unit^2/Hz] of a channel's floor at frequencies (m,) [Hz], sampled."""
    return np.asarray(2.0 * interval_s / floor.whitener(interval_s).response(frequency * interval_s))


def named_density(causes: Sequence[Effect], column: int, frequency: Array, interval_s: float) -> Array:
    """The same of the named noise that has a spectrum."""
    total = np.zeros_like(frequency)
    for effect in causes:
        channels = range(len(CHANNELS))[effect.columns]
        if effect.kind is not Kind.NOISE or effect.adds_in_time or column not in channels:
            continue
        (strength,) = [item.name for item in effect.parameters() if item.strength]
        sizes = np.atleast_1d(getattr(effect, strength))
        variance = float(sizes[column - channels[0]] if len(sizes) > 1 else sizes[0]) ** 2
        total += 2.0 * interval_s * variance * effect.added_spectrum(frequency * interval_s, interval_s)
    return total


def over_time(residuals: GapResiduals) -> str:
    """Block means of each channel's residual, before and after, in the band of two standard errors of the floor."""
    columns, t = residuals.data.columns, residuals.recording.t
    shown = shown_units(residuals.recording.units)
    blocks = np.array_split(np.arange(len(t)), _block_count(residuals))
    middle = np.array([t[block].mean() for block in blocks])
    with style():
        size = 1000.0, 74.0 * len(columns) + 48.0
        figure, panels = page_panels(size, len(columns), 1, (106.0, 12.0, 4.0, 44.0), (0.0, 10.0), sharex=True)
        axes = panels[:, 0]
        for axis, column in zip(axes, columns, strict=True):
            unit = shown[CHANNELS[column]]
            band = 2.0 * unit.factor * block_error(residuals.floor[column], len(blocks[0]), residuals.data.interval_s)
            axis.axhspan(-band, band, color=BAND, linewidth=0)
            axis.axhline(0.0, color=GREY, linewidth=0.7)
            lines = {"before": residuals.before[:, column]}
            if residuals.after is not None:
                lines["after"] = np.where(residuals.left_out[:, column], np.nan, residuals.after[:, column])
            means = {name: unit.factor * _block_means(values, blocks) for name, values in lines.items()}
            for name, values in means.items():
                axis.plot(middle, values, **_LINES[name])
            reach = 1.1 * max(2.0 * band, *(float(np.nanmax(np.abs(values))) for values in means.values()))
            axis.set_ylim(-reach, reach)
            tick = float(f"{0.7 * reach:.1g}")
            axis.set_yticks((-tick, 0.0, tick))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.set_ylabel(f"{CHANNELS[column]}\n[{unit.name}]", rotation="horizontal", ha="right", va="center")
            axis.grid(visible=False)
            axis.spines["bottom"].set_visible(axis is axes[-1])
            axis.tick_params("x", length=3.5 if axis is axes[-1] else 0.0)
        axes[-1].set_xlim(t[0], t[-1])
        axes[-1].set_xlabel("time [s]")
    return inline_svg(figure, "residuals in time, as means of blocks, before and after")


def _block_count(residuals: GapResiduals) -> int:
    return min(_BLOCKS, len(residuals.recording.t) // 8)


def block_s(residuals: GapResiduals) -> float:
    """The length of the blocks that ``over_time`` draws the means of [s]."""
    return len(residuals.recording.t) / _block_count(residuals) * residuals.data.interval_s


def _block_means(values: Array, blocks: Sequence[Rows]) -> Array:
    means = [values[block][np.isfinite(values[block])] for block in blocks]
    return np.array([part.mean() if len(part) else np.nan for part in means])


def block_error(floor: ChannelNoise, count: int, interval_s: float) -> float:
    """Standard deviation of the mean of ``count`` successive samples of a channel's floor [recorded unit]."""
    lags = np.arange(count, dtype=float)
    weights = np.where(lags == 0.0, count, 2.0 * (count - lags))
    return float(np.sqrt(np.sum(weights * floor.autocovariance(lags * interval_s)) / count**2))
