"""From a selection on block means at their mean poses to one with the rig evaluated at every sample."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench
from estimators.gap.rebase import around
from estimators.gap.refine import started
from estimators.gap.score import Explained
from estimators.gap.select import MeanCause, Selection, with_mean
from estimators.gap.tones import envelopes

Array = NDArray[np.float64]

#: Frequencies that are tried within a band: its width over this.
_WITHIN: Final = 64


def at_every_sample(state: Selection, bench: Bench) -> Selection:
    """A selection that was made on a pointwise bench, refitted on the bench it stands for.

    Means over blocks leave the frequency of a tone known modulo the rate of the means: among these, the one is taken
    that the single samples show.
    """
    full = replace(bench, steps=state.bench.steps)
    if full.block == 1:
        return state
    if state.bench.pipeline is not bench.pipeline:
        full = around(full, state.bench.pipeline)
    calibrated = Explained(full.absorbed, full.whitened)
    causes = [
        _unfolded(cause, full, calibrated) if cause.fit.candidate.effect.tone else cause for cause in state.causes
    ]
    return with_mean(replace(state, bench=full), causes)


def _unfolded(cause: MeanCause, bench: Bench, explained: Explained) -> MeanCause:
    means = 1.0 / bench.interval_s  # [Hz]
    rate = bench.block * means
    folded = float(vars(cause.fit.effect)["freq_Hz"])
    every = np.unique(np.abs(means * np.arange(-bench.block, bench.block + 1) + folded))
    tried = every[every < 0.5 * rate]
    if bands := cause.fit.candidate.effect.bands:
        fine = np.concatenate([np.linspace(low, high, _WITHIN) for low, high in bands])
        sampled = np.abs(fine - rate * np.round(fine / rate))
        tried = np.array([each for each in tried if np.abs(sampled - each).min() < 4.0 * means / bench.count])
    if not len(tried):
        return cause
    shown = envelopes(cause.fit.candidate, bench)[:, bench.columns]
    residual = bench.residual[:, bench.columns]
    seen = np.einsum("nc,ncj->jn", residual, shown)
    inverse = np.linalg.pinv(np.einsum("nci,ncj->ij", shown, shown))
    waves = seen @ np.exp(-2j * np.pi * np.outer(bench.base.t, tried))
    powers = np.real(np.einsum("jf,jk,kf->f", waves.conj(), inverse, waves))
    offer = replace(cause.offer, shape={**cause.offer.shape, "freq_Hz": float(tried[int(np.argmax(powers))])})
    return replace(cause, offer=offer, fit=started(offer, bench, explained))
