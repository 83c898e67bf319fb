"""All about the noise of a locked-arm recording: how much, how coloured, how it grows with averaging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from estimators.noise.allan import FEWEST_SAMPLES, AllanDeviation, allan_deviation
from estimators.noise.allan_terms import TERMS, NoiseTerms, fit_terms
from estimators.noise.procedure import NoiseFloor, held_poses, noise_floor
from estimators.noise.spectrum import (
    Autoregression,
    PowerSpectrum,
    Whiteness,
    autoregression,
    power_spectrum,
    whiteness,
)
from rig.arrays import Array
from rig.documents import plain
from rig.errors import RigError
from rig.recording import Recording

#: Fewest samples of a pose whose colour can be told.
FEWEST: Final = 100
#: Steps of time that differ by more than this share are not even.
_UNEVEN: Final = 0.01
#: A reading at rest stays within so many times the median step from sample to sample; drifts do, motions do not.
_MOVING: Final = 20.0


@dataclass(frozen=True, eq=False)
class ChannelNoise:
    """The noise of one channel.

    Attributes:
        unit: of a reading.
        allan: its Allan deviation. terms: what it is made of.
        spectrum: its power spectral density.
        whiteness: of the readings. autoregression: the model that whitens them.
        left_over: the whiteness of what that model leaves.
    """

    unit: str
    allan: AllanDeviation
    terms: NoiseTerms
    spectrum: PowerSpectrum
    whiteness: Whiteness
    autoregression: Autoregression
    left_over: Whiteness

    @classmethod
    def of(cls, records: list[Array], rate_Hz: float, unit: str) -> ChannelNoise:
        """From records (n,) of one channel, each held still [unit]."""
        allan = allan_deviation(records, rate_Hz)
        model = autoregression(records)
        whitened = [model.whiten(record - record.mean()) for record in records]
        return cls(
            unit,
            allan,
            fit_terms(allan),
            power_spectrum(records, rate_Hz),
            whiteness(records),
            model,
            whiteness(whitened, fitted=model.order),
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object; the unit of each term beside it."""
        low, high = self.allan.interval(self.terms.degrees_of_freedom)
        terms = self.terms.to_json()
        return {
            "allan": {
                "tau_s": plain(self.allan.tau_s),
                "deviation": plain(self.allan.deviation),
                "low_95": plain(low),
                "high_95": plain(high),
                "model": plain(self.terms.deviation),
            },
            "terms": {name: {**terms[name], "unit": term_unit(name, self.unit)} for name in TERMS},
            "terms_p_value": plain(self.terms.p_value),
            "spectrum": {
                "unit": f"{self.unit}^2/Hz",
                "frequency_Hz": plain(self.spectrum.frequency_Hz),
                "density": plain(self.spectrum.density),
                "degrees_of_freedom": self.spectrum.degrees_of_freedom,
            },
            "whiteness": self.whiteness.to_json(),
            "autoregression": {**self.autoregression.to_json(), "left_over": self.left_over.to_json()},
        }


def term_unit(name: str, unit: str) -> str:
    """The unit of a term of the Allan deviation of readings in ``unit``."""
    suffix = TERMS[name]
    return f"{unit} {suffix}" if suffix.isalpha() else unit + suffix


@dataclass(frozen=True, eq=False)
class NoiseStudy:
    """The noise of every channel of a locked-arm recording.

    Attributes:
        floor: RMS of each pose and their mean, dynamic range, bits.
        rate_Hz: of the samples.
        channels: name -> what its noise is like; without those that read a constant.
        warnings: what to know before relying on it.
    """

    floor: NoiseFloor
    rate_Hz: float
    channels: Mapping[str, ChannelNoise]
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The object of ``NoiseFloor.to_json`` with more about each channel."""
        content: dict[str, Any] = dict(self.floor.to_json())
        channels = dict(content["channels"])
        for name, noise in self.channels.items():
            channels[name] = {**channels[name], **noise.to_json()}
        return {**content, "rate_Hz": self.rate_Hz, "channels": channels, "warnings": list(self.warnings)}


def _refuse_motion(readings: Array, where: str) -> None:
    """Refuse a recording without a pose whose readings (n, c) wander far beyond what they do from sample to sample.

    Raises:
        RigError: it moves.
    """
    fast = np.median(np.abs(np.diff(readings, axis=0)), axis=0)
    moving = readings.std(axis=0) > _MOVING * np.where(fast > 0.0, fast, np.inf)
    if moving.any():
        raise RigError(
            f"{where}: channel {int(np.argmax(moving)) + 1} varies by {readings[:, np.argmax(moving)].std():.3g}, over"
            f" {_MOVING:g} times what it does from sample to sample: it moves, expected a recording held still"
        )


def study_noise(locked: Recording, poses: ArrayLike | None = None) -> NoiseStudy:
    """Study a locked-arm recording.

    Args:
        locked, poses: as of ``noise_floor``.

    Raises:
        RigError: as of ``noise_floor``, or no pose is held for ``FEWEST`` samples.
    """
    labels = held_poses(locked) if poses is None else np.asarray(poses)
    floor = noise_floor(locked, labels)
    where = locked.origin or locked.name
    rows = [np.flatnonzero(labels == number) for number in np.unique(labels[labels >= 0])]
    rows = [held for held in rows if len(held) >= max(FEWEST, FEWEST_SAMPLES)]
    if not rows:
        raise RigError(
            f"{where}: no pose is held for {FEWEST} samples, expected longer ones to tell the noise's colour"
        )
    steps = np.concatenate([np.diff(locked.t[held]) for held in rows])
    interval = float(np.median(steps))
    warnings = []
    uneven = float(np.mean(np.abs(steps - interval) > _UNEVEN * interval))
    if uneven > 0.0:
        warnings.append(
            f"{100.0 * uneven:.2g} % of the samples are not evenly spaced: spectra take them to be {interval:g} s apart"
        )
    readings = locked.every_reading
    if poses is None and locked.pose == "none":
        _refuse_motion(readings, where)
    channels: dict[str, ChannelNoise] = {}
    for column, (name, unit) in enumerate(zip(floor.channels, floor.units, strict=True)):
        records = [readings[held, column] for held in rows]
        if max(np.ptp(record) for record in records) == 0.0:
            warnings.append(f"{name} reads a constant in every pose: its noise is below what is recorded")
            continue
        channels[name] = ChannelNoise.of(records, 1.0 / interval, unit)
    return NoiseStudy(floor, 1.0 / interval, channels, tuple(warnings))
