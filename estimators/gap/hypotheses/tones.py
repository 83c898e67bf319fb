"""Sines in time of unknown frequency: one Fourier transform of the residual under each envelope."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import sigmas
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.score import Explained, Score, evidence
from rig.arrays import Array

#: So many peaks of a spectrum are scored exactly.
_PEAKS: Final = 3
#: A tone slower than this many cycles a recording is a drift.
_DRIFT: Final = 1.5
#: A tone that may have any frequency is not looked for so near, in cycles a recording, to so many harmonics of a
#: joint's rate; one of a band is, as the sampling may fold this there: hum of 60 Hz, read four times a second.
_WIDTH, _ORDERS = 1.5, 3
#: Where joints are not known, their motion may fill the spectrum up to this share of the sampling rate.
_UNKNOWN: Final = 0.15
#: Sums that a wave is polished on.
_SUMS: Final = 64


def envelopes(candidate: Candidate, data: WhitenedData) -> Array:
    """(n, 6, m) what a tone multiplies [recorded unit], for each strength and spanning direction."""
    parts: list[Array] = []
    for span in candidate.effect.spanning():
        if not np.any(np.asarray(span["phase_rad"]) == 0.0):
            parts += candidate.derivatives(data, {**span, "freq_Hz": 0.0})
    return np.asarray(np.nan_to_num(np.stack(parts, axis=2)))


def best_tone(
    candidate: Candidate,
    data: WhitenedData,
    explained: Explained,
    raw: Array,
    worthwhile: float,
    lowest_Hz: float = 0.0,
) -> tuple[Score, float, int]:
    """The best frequency: its score, the frequency [Hz], and how many were tried.

    Args:
        raw: the candidate's envelopes.
        worthwhile: evidence below which the transform's own, rougher score will do.
        lowest_Hz: no tone below this.
    """
    count = data.count
    sigma = sigmas(data.whiteners)
    shown = (raw / sigma[:, None] * data.weights[:, :, None])[:, data.columns]
    shown = shown[:, :, np.einsum("ncj,ncj->j", shown, shown) > 0]
    residual = explained.residual.reshape(len(data.columns), count)
    seen = np.einsum("cn,ncj->jn", residual, shown)
    inverse = np.linalg.pinv(np.einsum("nci,ncj->ij", shown, shown))
    if not shown.shape[2]:  # of several recordings, none has the sensor
        return Score(0.0, 0, np.zeros(0), 0.0), 0.0, 1
    power = of_waves(np.fft.rfft(seen, n=2 * count, axis=1), inverse)
    frequency: Array = np.arange(count + 1) / (2.0 * count * data.interval_s)
    allowed = _allowed(candidate, data, frequency) & (frequency >= lowest_Hz)
    if not allowed.any():
        return Score(0.0, 0, np.zeros(0), 0.0), 0.0, 1
    tried = int(allowed.sum()) // 2
    some = np.flatnonzero(allowed)
    peaks = some[np.argsort(-power[some], kind="stable")[:_PEAKS]]
    best = [polished(seen, inverse, data.t, float(frequency[peak])) for peak in peaks]
    highest, at_Hz = max(best)
    rank = 2 * shown.shape[2]
    if evidence(highest, rank) - 2.0 * np.log(tried) < worthwhile:
        return Score(highest, rank, np.zeros(0), 1.0), at_Hz, tried
    turns = 2.0 * np.pi * at_Hz * data.base.t[:, None]
    waves = (part * wave(turns) for wave in (np.sin, np.cos) for part in np.moveaxis(raw, 2, 0))
    return explained.score(data.whiten_changes(waves)), at_Hz, tried


def of_waves(spectra: NDArray[np.complex128], inverse: Array) -> Array:
    """What waves explain of a residual: from its transforms (j, f) under each envelope, and the inverse Gram matrix."""
    return np.asarray(2.0 * np.real(np.einsum("jf,jk,kf->f", spectra.conj(), inverse, spectra)))


def polished(seen: Array, inverse: Array, t: Array, frequency: float) -> tuple[float, float]:
    """The most that a frequency near one of the transform's explains, and that frequency [Hz].

    Turned back by the transform's frequency the wave is slow: sums over a few blocks keep it.
    """
    whole = seen.shape[1] // _SUMS * _SUMS
    slow = (seen * np.exp(-2j * np.pi * frequency * t))[:, :whole].reshape(len(seen), _SUMS, -1).sum(axis=2)
    middles = t[:whole].reshape(_SUMS, -1).mean(axis=1)
    around = np.linspace(-0.5, 0.5, 41) / (t[-1] - t[0])
    power = of_waves(slow @ np.exp(-2j * np.pi * np.outer(middles, around)), inverse)
    best = int(np.argmax(power))
    return float(power[best]), frequency + float(around[best])


def _allowed(candidate: Candidate, data: WhitenedData, frequency: Array) -> NDArray[np.bool_]:
    """Where a tone may appear in the sampled signal: its bands folded by the sampling."""
    resolution = 1.0 / (data.count * data.interval_s)
    arm = np.zeros(len(frequency), dtype=bool)
    if not candidate.effect.bands:
        if data.base.q_encoder is not None:  # a turning joint makes sines of its own
            rates = _turns(data)
            own = np.concatenate([rates[rates > resolution] * order for order in range(1, _ORDERS + 1)])
            arm = np.abs(frequency[:, None] - own).min(axis=1, initial=np.inf) < _WIDTH * resolution
        else:
            arm = frequency <= _UNKNOWN / data.interval_s
    allowed = np.zeros(len(frequency), dtype=bool)
    for low, high in candidate.effect.bands or ((0.0, 0.5 / data.interval_s - resolution),):
        high = min(high, low + 1.0 / data.interval_s)  # folded, the rest of the band is the same once more
        fine = np.arange(low, high, 0.25 * resolution) * data.interval_s
        folded = np.abs(fine - np.round(fine)) / data.interval_s
        allowed[np.unique(np.clip(np.round(folded / frequency[1]).astype(int), 0, len(frequency) - 1))] = True
    return np.asarray(allowed & (frequency > _DRIFT * resolution) & ~arm)


def _turns(data: WhitenedData) -> Array:
    """(N,) [Hz] the rate of each joint."""
    speed = np.abs(np.gradient(data.base.encoder_angles, data.base.t, axis=0))
    return np.asarray(np.median(speed, axis=0) / (2.0 * np.pi))
