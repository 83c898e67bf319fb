"""Readings and residuals against time in the viewer, decimated so that no peak is lost."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr

from rig.arrays import Array
from rig.channels import CHANNELS_OF
from scenarios.colours import AXES_ON_DARK, GREY, rgb
from scenarios.decimation import extremes
from scenarios.overlay import Overlay
from scenarios.view.stream import at

READINGS: Final = "readings"
RESIDUALS: Final = "residuals"
BAND: Final = "band"


def log_readings(stream: rr.RecordingStream, sensor: str, t: Array, readings: Array, unit: str, samples: int) -> None:
    """A sensor's readings (n, 3) [unit], at most ``samples`` of each channel."""
    for channel, values, colour in zip(CHANNELS_OF[sensor], readings.T, AXES_ON_DARK, strict=True):
        log_line(stream, f"{READINGS}/{sensor}/{channel}", t, values, f"{channel} [{unit}]", colour, samples)


def log_residuals(stream: rr.RecordingStream, t: Array, overlay: Overlay, samples: int) -> None:
    """The residuals of a sensor, each with the lines of plus and minus three standard deviations."""
    for number, (name, sigma) in enumerate(zip(overlay.names, overlay.sigma, strict=True)):
        values, colour = overlay.residuals[:, number], AXES_ON_DARK[number]
        path = f"{RESIDUALS}/{overlay.sensor}/{name}"
        log_line(stream, path, t, values, f"{name} [{overlay.unit}]", colour, samples)
        ends = np.array([t[0], t[-1]])
        names = ["+3σ", "−3σ"]
        style = rr.SeriesLines(colors=[rgb(GREY)] * 2, names=names, widths=[1.5] * 2)
        stream.log(f"{path}/{BAND}", style, static=True)
        band = np.array([[3.0, -3.0], [3.0, -3.0]]) * sigma
        stream.send_columns(
            f"{path}/{BAND}", indexes=at(ends), columns=rr.Scalars.columns(scalars=band.ravel()).partition([2, 2])
        )


def log_line(
    stream: rr.RecordingStream, path: str, t: Array, values: Array, name: str, colour: str, samples: int
) -> None:
    """One series, at most ``samples`` of it, none of its peaks left out."""
    rows = extremes(values, samples)
    extremes_too = rr.components.AggregationPolicy.MinMax  # where samples are closer than pixels; else their average
    style = rr.SeriesLines(colors=[rgb(colour)], names=[name], widths=[1.0], aggregation_policy=extremes_too)
    stream.log(path, style, static=True)
    stream.send_columns(path, indexes=at(t[rows]), columns=rr.Scalars.columns(scalars=values[rows]))
