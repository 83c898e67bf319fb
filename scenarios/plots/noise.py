"""The noise of a locked arm: Allan deviation and spectrum of every channel."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators.noise.study import ChannelNoise, NoiseStudy
from rig.channels import CHANNELS_OF
from scenarios.colours import AXES_ON_PAPER, GREY
from scenarios.plots.style import new_figure, style


def noise_figure(study: NoiseStudy, name: str) -> Figure:
    """A column for each sensor: Allan deviation with 95 % intervals and the terms found, and the spectrum.

    Args:
        study: of a locked-arm recording.
        name: of that recording.
    """
    sensors = {sensor: names for sensor, names in CHANNELS_OF.items() if set(names) & set(study.channels)}
    with style():
        figure = new_figure(4.9 * max(len(sensors), 1), 6.2, f"{name}: noise of the locked arm")
        panels = figure.subplots(2, max(len(sensors), 1), squeeze=False)
        for (sensor, names), (top, bottom) in zip(sensors.items(), panels.T, strict=True):
            for index, channel in enumerate(names):
                if channel in study.channels:
                    _allan(top, study.channels[channel], AXES_ON_PAPER[index], f"axis {index + 1}")
                    _spectrum(bottom, study.channels[channel], AXES_ON_PAPER[index])
            unit = next(study.channels[channel].unit for channel in names if channel in study.channels)
            top.set_title(sensor.capitalize())
            top.set_xlabel("averaging time τ [s]")
            top.set_ylabel(f"Allan deviation [{unit}]")
            top.plot([], [], "--", color=GREY, linewidth=0.8, label="terms found")
            top.legend(loc="lower left", ncols=2)
            bottom.set_xlabel("frequency [Hz]")
            bottom.set_ylabel(f"amplitude density, one-sided\n[{unit}/√Hz]")
            bottom.plot([], [], "--", color=GREY, linewidth=1.1, label="autoregression")
            bottom.legend(loc="upper right")
            for panel in (top, bottom):
                panel.set_xscale("log")
                panel.set_yscale("log")
            low, high = bottom.get_ylim()
            bottom.set_ylim(0.5 * low, 2.0 * high)
    return figure


def _allan(panel: Axes, noise: ChannelNoise, colour: str, label: str) -> None:
    tau, deviation = noise.allan.tau_s, noise.allan.deviation
    low, high = noise.allan.interval(noise.terms.degrees_of_freedom)
    panel.errorbar(
        tau,
        deviation,
        yerr=[deviation - low, high - deviation],
        fmt="o",
        color=colour,
        markersize=3,
        elinewidth=0.8,
        label=label,
    )
    panel.plot(tau, noise.terms.deviation, "--", color=colour, linewidth=0.8)


def _spectrum(panel: Axes, noise: ChannelNoise, colour: str) -> None:
    spectrum = noise.spectrum
    shown = slice(2, -1)  # without what removing the mean takes away, and the highest, which counts half
    panel.plot(spectrum.frequency_Hz[shown], spectrum.amplitude[shown], color=colour, linewidth=0.5, alpha=0.7)
    model = noise.autoregression.density(spectrum.frequency_Hz[shown], 1.0 / noise.allan.interval_s)
    panel.plot(spectrum.frequency_Hz[shown], np.sqrt(model), "--", color=colour, linewidth=1.1)
