"""Tones that were there at rest, and that no effect of the catalogue makes, are noise: they go from the sweep."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array

#: Frequencies that are tried, of the resolution of the sweep, and between two of these; how far about that at rest, in
#: the resolution of a pose.
_FINER, _FINEST, _ABOUT = 4, 65, 0.25
#: Sums a resolution of a pose that frequencies are tried on.
_SUMS: Final = 8
#: A tone of the sweep is as loud as at rest up to so many standard deviations of both.
_AS_LOUD: Final = 3.0


def without_rest_tones(data: WhitenedData) -> WhitenedData:
    """The data, of single samples, without such tones: where the sweep has more of one than the rest had, that stays.

    Each channel's frequency is the likeliest near that at rest, which poses of some seconds hardly tell.
    """
    humming = [column for column in data.columns if data.floor[column].hums]
    if not humming:
        return data
    readings, residual = data.readings.copy(), data.residual.copy()
    for column in humming:
        floor = data.floor[column]
        held_s = floor.duration_s / max(floor.holds, 1)
        for frequency, amplitude in floor.hums:
            tone, size = _near(data.base.t, residual[:, column], frequency, held_s)
            off = floor.variance**0.5 * np.sqrt(2.0 / len(tone) + 2.0 / max(floor.samples, 1))
            share = min(1.0, (amplitude + _AS_LOUD * float(off)) / max(size, 1e-300))
            readings[:, column] -= share * tone
            residual[:, column] -= share * tone
    return replace(data, readings=readings)


def _near(t: Array, residual: Array, frequency: float, held_s: float) -> tuple[Array, float]:
    """The tone (n,) near a frequency [Hz] that takes most of a residual (n,), and its amplitude."""
    turned = residual * np.exp(-2j * np.pi * frequency * t)
    sums = np.floor((t - t[0]) / held_s * _SUMS).astype(np.intp)
    slow = np.bincount(sums, turned.real) + 1j * np.bincount(sums, turned.imag)
    size = _FINER * len(slow)
    off = np.fft.fftfreq(size, held_s / _SUMS)
    coarse = off[np.argmax(np.where(np.abs(off) <= _ABOUT / held_s, np.abs(np.fft.fft(slow, size)), 0.0))]
    fine = coarse + off[1] * np.linspace(-1.0, 1.0, _FINEST)
    middles = np.bincount(sums, t - t[0]) / np.maximum(np.bincount(sums), 1)
    power = np.abs(np.exp(-2j * np.pi * np.outer(fine, middles)) @ slow)
    phase = 2.0 * np.pi * (frequency + fine[int(np.argmax(power))]) * t
    waves = np.stack([np.ones(len(t)), np.cos(phase), np.sin(phase)], axis=1)
    fitted = np.linalg.lstsq(waves, residual, rcond=None)[0]
    return waves[:, 1:] @ fitted[1:], float(np.hypot(*fitted[1:]))
