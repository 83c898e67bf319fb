"""The residual's spectrum, and the residual in time, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.arrays import Array, Rows
from rig.channels import CHANNELS
from rig.effects import Effect, Kind
from scenarios.gap_report.residuals import GapResiduals
from scenarios.gap_report.svg import Drawing, Scale
from scenarios.shown_units import shown_units

_WIDTH: Final = 1000.0
_BANDS: Final = 90
_BLOCKS: Final = 160
#: Of a panel's decades: up to so many there is room for 1, 2 and 5 of each, and from so many on not for each.
_CLOSE: Final = 3.0
_FAR: Final = 10.0


def spectrum(residuals: GapResiduals) -> str:
    """Amplitude density of each channel's residual before and after, and of its floor; three panels a row."""
    columns = residuals.data.columns
    rows = (len(columns) + 2) // 3
    drawing = Drawing(
        _WIDTH, 178.0 * rows + 10, "amplitude density of the residuals before and after, and of the floor"
    )
    interval = residuals.data.interval_s
    shown = shown_units(residuals.recording.units)
    for number, column in enumerate(columns):
        left, top = 56 + 326.0 * (number % 3), 22 + 178.0 * (number // 3)
        unit = shown[CHANNELS[column]]
        frequency, before = density(residuals.before[:, column], interval)
        lines = [(before, "line-before")]
        if residuals.after is not None:
            after = np.where(residuals.left_out[:, column], 0.0, residuals.after[:, column])
            lines.append((density(after, interval)[1], "line-after"))
        floor = floor_density(residuals.floor[column], frequency, interval)
        named = floor + named_density(residuals.causes, column, frequency, interval)
        if np.any(named != floor):
            lines.append((named, "line-named"))
        lines.append((floor, "line-floor"))
        values = unit.factor * np.sqrt(np.concatenate([line for line, _ in lines]))
        low, high = float(values[values > 0].min()), float(values.max())
        x = Scale(float(frequency[0]), float(frequency[-1]), left, left + 258, log=True)
        y = Scale(0.8 * low, 1.25 * max(high, 1.5 * low), top + 120, top, log=True)
        _frame(drawing, x, y)
        drawing.text(left, top - 8, CHANNELS[column], "panel")
        for line, css in lines:
            drawing.path(x(frequency), y(unit.factor * np.sqrt(np.maximum(line, 1e-300))), css)
        drawing.text(left + 258, top - 8, f"{unit.name}/√Hz", "tick", "end")
        drawing.text(left + 258, top + 149, "Hz", "tick", "end")
    return str(drawing)


def _frame(drawing: Drawing, x: Scale, y: Scale) -> None:
    decades = np.log10(y.high / y.low)
    factors = (1.0, 2.0, 5.0) if decades <= _CLOSE else (1.0,)
    values = [tick * factor for tick in (*y.ticks(), *(t / 10.0 for t in y.ticks()[:1])) for factor in factors]
    values = values[:: 1 + int(decades // _FAR)]
    inside = sorted({value for value in values if y.low <= value <= y.high})
    for value in inside:
        drawing.line(x.start, y.at(value), x.end, y.at(value), "grid")
    drawing.y_axis(y, x.start, inside)
    drawing.x_axis(x, y.start)


def density(values: Array, interval_s: float) -> tuple[Array, Array]:
    """Frequencies (m,) [Hz] and the mean power density [unit^2/Hz] of values (n,) in bands of even ratio."""
    window = 1.0 - np.cos(2.0 * np.pi * np.arange(len(values)) / len(values))  # Hann's
    spectrum = np.fft.rfft((values - values.mean()) * window)[1:]
    power = 2.0 * interval_s * np.abs(spectrum) ** 2 / np.sum(window**2)
    power[-1] *= 1.0 if len(values) % 2 else 0.5  # half the rate has no other side
    frequency = np.arange(1, len(power) + 1) / (len(values) * interval_s)
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
    columns = residuals.data.columns
    row = 74.0
    drawing = Drawing(_WIDTH, row * len(columns) + 28, "residuals in time, as means of blocks, before and after")
    t = residuals.recording.t
    shown = shown_units(residuals.recording.units)
    blocks = np.array_split(np.arange(len(t)), _block_count(residuals))
    middle = np.array([t[block].mean() for block in blocks])
    x = Scale(float(t[0]), float(t[-1]), 92, _WIDTH - 46)
    for number, column in enumerate(columns):
        unit = shown[CHANNELS[column]]
        top = row * number
        lines = [(residuals.before[:, column], "line-before")]
        if residuals.after is not None:
            lines.append((np.where(residuals.left_out[:, column], np.nan, residuals.after[:, column]), "line-after"))
        means = [(unit.factor * _block_means(values, blocks), css) for values, css in lines]
        band = 2.0 * unit.factor * block_error(residuals.floor[column], len(blocks[0]), residuals.data.interval_s)
        reach = 1.1 * max(2.0 * band, *(float(np.nanmax(np.abs(values))) for values, _ in means))
        y = Scale(-reach, reach, top + row - 8, top + 4)
        drawing.rect(x.start, y.at(band), x.end - x.start, y.at(-band) - y.at(band), "band")
        drawing.line(x.start, y.at(0.0), x.end, y.at(0.0), "axis")
        for values, css in means:
            drawing.path(x(middle), y(values), css)
        tick = float(f"{0.7 * reach:.1g}")
        drawing.y_axis(y, x.start, (-tick, 0.0, tick))
        drawing.text(x.start - 48, y.at(0.0) + 4, CHANNELS[column], "name", "end")
        drawing.text(_WIDTH - 40, y.at(0.0) + 4, unit.name, "tick")
    drawing.x_axis(x, row * len(columns))
    drawing.text(_WIDTH - 40, row * len(columns) + 15, "s", "tick")
    return str(drawing)


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
