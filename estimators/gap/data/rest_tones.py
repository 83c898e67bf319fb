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

    Each channel's frequency is the likeliest near that at rest, which poses of some seconds hardly tell. Where the tone
    wanders, as that of a motor does, it has an amplitude and a phase in each of some stretches, no shorter than a pose.
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
    held_s = max(held_s, 4.0 / frequency)  # in less than some cycles a wave is anything slow
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
    tone = _wandering(t - t[0], residual - residual.mean(), np.stack([np.cos(phase), np.sin(phase)]), held_s)
    return tone, float(np.sqrt(2.0 * np.mean(tone**2)))


def _wandering(t: Array, residual: Array, waves: Array, held_s: float) -> Array:
    """(n,) what waves (2, n) make of a residual (n,) in each of as many stretches as pay for a size of each wave."""
    best, least = np.zeros(len(t)), np.inf
    lasted, many = float(t[-1]), 1
    while many == 1 or lasted / many >= held_s:
        stretch = np.minimum((t / max(lasted, 1e-300) * many).astype(np.intp), many - 1)
        gram = np.stack([np.bincount(stretch, one * other, many) for one in waves for other in waves], axis=1)
        moment = np.stack([np.bincount(stretch, one * residual, many) for one in waves], axis=1)
        sizes = np.einsum("sij,sj->si", np.linalg.pinv(gram.reshape(-1, 2, 2), hermitian=True), moment)
        tone = np.sum(sizes[stretch].T * waves, axis=0)
        left = float(np.sum((residual - tone) ** 2))
        cost = len(t) * float(np.log(max(left, 1e-300))) + 2.0 * many * float(np.log(len(t)))
        if cost < least:
            best, least = tone, cost
        many *= 2
    return best
