"""Noise floors of the blind check: white, or partly remembering, the same process at rest and on the sweep."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from rig.arrays import Array
from rig.channels import COLUMNS_OF, SENSORS
from rig.effects import Effect, Kind, Stage
from rig.effects.drift import with_volts
from rig.signals import Signals

_SETTLED = 1e-12  # the Kalman gain has converged
_MOST = 4000  # samples by which it has, or is taken to have


@dataclass(frozen=True)
class Colour:
    """One part of a floor that remembers: an Ornstein-Uhlenbeck process, seen by all channels of a sensor alike.

    Attributes:
        share: of the channel's noise variance, 0 to 1.
        tau_s: correlation time.
    """

    share: float
    tau_s: float


@dataclass(frozen=True)
class Floor:
    """The noise at rest.

    Attributes:
        sigma_V: (6,) standard deviation of each channel, all parts together [V].
        colours: for each sensor its remembering parts; the rest of the variance is white.
        degrees: of freedom of the white part, which has Student's distribution; None: it is normal.
    """

    sigma_V: tuple[float, ...]
    colours: dict[str, tuple[Colour, ...]]
    degrees: float | None = None

    @property
    def white_V(self) -> tuple[float, ...]:
        """(6,) standard deviation of the white part [V]."""
        share = np.ones(6)
        for sensor in SENSORS:
            share[COLUMNS_OF[sensor]] -= sum(colour.share for colour in self.colours.get(sensor, ()))
        return tuple(float(value) for value in np.asarray(self.sigma_V) * np.sqrt(share))

    @property
    def coloured(self) -> bool:
        """Whether any part remembers."""
        return any(self.colours.values())

    @property
    def effects(self) -> tuple[Effect, ...]:
        """What adds the remembering parts, or those of long tails, to a simulated recording."""
        found: list[Effect] = []
        if self.degrees is not None:
            found.append(LongTails("acquisition", self.white_V, self.degrees))
        for sensor, colours in self.colours.items():
            sigma = np.asarray(self.sigma_V)[COLUMNS_OF[sensor]]
            found += [Remembering(sensor, tuple(sigma * np.sqrt(each.share)), each.tau_s) for each in colours]
        return tuple(found)

    def whiten(self, values: Array, interval_s: float) -> Array:
        """Values (n, 6) or (n, 6, m) [V], evenly sampled, in the coordinates in which the floor is white of variance
        one.

        The one-step prediction errors of a Kalman filter on the floor's own state, divided by their deviation: exact
        for this noise from the first sample on (Harvey, Forecasting, Structural Time Series Models, 1989, section 3.4).
        """
        scaled = values / (np.asarray(self.sigma_V)[:, None] if values.ndim == 3 else np.asarray(self.sigma_V))
        white = np.empty_like(scaled)
        for sensor in SENSORS:
            columns = COLUMNS_OF[sensor]
            part = scaled[:, columns]
            flat = part.reshape(len(part), -1)
            white[:, columns] = _innovations(flat, self.colours.get(sensor, ()), interval_s).reshape(part.shape)
        return np.asarray(white)

    def spectrum(self, sensor: str, frequency: Array, interval_s: float) -> Array:
        """(m,) the floor's spectrum over its variance at frequencies (m,) [cycles a sample]; white noise has one."""
        colours = self.colours.get(sensor, ())
        total = np.full_like(frequency, 1.0 - sum(each.share for each in colours))
        for each in colours:
            decay = np.exp(-interval_s / each.tau_s)
            shape = 1.0 - 2.0 * decay * np.cos(2.0 * np.pi * frequency) + decay**2
            total += each.share * (1.0 - decay**2) / shape
        return total


@dataclass(frozen=True)
class Remembering(Effect):
    """An Ornstein-Uhlenbeck process on the readings of a sensor, one realisation a channel: of the floor, no effect."""

    name = "floor"
    stage = Stage.ELECTRONIC
    kind = Kind.NOISE
    places = SENSORS

    sigma: tuple[float, ...]
    tau: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        drive = rng.standard_normal((len(signals), 3))
        decay = np.exp(-np.diff(signals.t) / self.tau)
        state = drive[0]
        noise = np.empty_like(drive)
        noise[0] = state
        for row, keep in enumerate(decay, start=1):
            state = keep * state + np.sqrt(1.0 - keep * keep) * drive[row]
            noise[row] = state
        return with_volts(signals, self.columns, noise * np.asarray(self.sigma))


@dataclass(frozen=True)
class LongTails(Effect):
    """White noise of Student's distribution on the readings, of a standard deviation a channel: of the floor."""

    name = "floor_tails"
    stage = Stage.ELECTRONIC
    kind = Kind.NOISE
    places = ("acquisition",)

    sigma: tuple[float, ...]
    degrees: float

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        drawn = rng.standard_t(self.degrees, signals.volts.shape) * np.sqrt(1.0 - 2.0 / self.degrees)
        return replace(signals, volts=signals.volts + drawn * np.asarray(self.sigma))


def _innovations(values: Array, colours: tuple[Colour, ...], interval_s: float) -> Array:
    if not colours:
        return values
    share = np.array([each.share for each in colours])
    decay = np.exp(-interval_s / np.array([each.tau_s for each in colours]))
    white = 1.0 - share.sum()
    covariance = np.diag(share)
    state = np.zeros((len(colours), values.shape[1]))
    result = np.empty_like(values)
    gain, deviation, settled = np.zeros(len(colours)), 1.0, False
    for row, value in enumerate(values):
        if not settled:
            variance = covariance.sum() + white
            new_gain = covariance.sum(axis=1) / variance
            settled = row > _MOST or (row > 0 and float(np.abs(new_gain - gain).max()) < _SETTLED)
            gain, deviation = new_gain, float(np.sqrt(variance))
            covariance = covariance - np.outer(gain, covariance.sum(axis=0))
            covariance = decay[:, None] * covariance * decay + np.diag(share * (1.0 - decay**2))
        error = value - state.sum(axis=0)
        result[row] = error / deviation
        state = decay[:, None] * (state + gain[:, None] * error)
    return result
