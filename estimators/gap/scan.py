"""Scanning a candidate's shapes: the one whose columns explain most, and what having searched costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench
from estimators.gap.candidates import Candidate, Shape
from estimators.gap.score import Explained, Score, solve

Array = NDArray[np.float64]

#: A tone is searched above this many times the fastest joint's rate: below, the arm's own motion fills the spectrum.
_HARMONICS = 3.0
#: An onset leaves at least this share of the samples on either side.
_EDGE = 0.01
#: So many peaks of a spectrum are scored exactly.
_PEAKS = 4
#: A tone slower than this many cycles a recording is a drift.
_DRIFT = 4.0


@dataclass(frozen=True)
class Offer:
    """What a candidate explains at its best shape.

    Attributes:
        candidate: the effect and its place.
        shape: the best of the searched shapes.
        score: at that shape.
        searched: how many distinguishable shapes were tried.
    """

    candidate: Candidate
    shape: Shape
    score: Score
    searched: int = 1

    @property
    def evidence(self) -> float:
        """Twice the log Bayes factor, each searched shape equally likely beforehand."""
        return self.score.evidence - 2.0 * float(np.log(self.searched))

    @property
    def log_p(self) -> float:
        """Logarithm of the p-value, corrected for the search (Bonferroni)."""
        return self.score.log_p + float(np.log(self.searched))


@dataclass(frozen=True)
class Scanner:
    """Scans candidates on one bench; the columns are kept for the next scan."""

    bench: Bench
    _kept: dict[str, list[tuple[Array, int]]] = field(default_factory=dict)

    def scan(self, candidates: Iterable[Candidate], explained: Explained) -> list[Offer]:
        """The best offer of each candidate, the most evident first."""
        offers = [self.best(candidate, explained) for candidate in candidates]
        return sorted(offers, key=lambda offer: -offer.evidence)

    def best(self, candidate: Candidate, explained: Explained) -> Offer:
        """One candidate's best offer."""
        if candidate.effect.tone:
            return self._tone(candidate, explained)
        shapes = candidate.effect.searched(self.bench.base)
        if set(shapes[0]) == {"at_s"}:
            return self._onset(candidate, explained)
        if candidate.label not in self._kept:
            self._kept[candidate.label] = [self._columns(candidate, shape) for shape in shapes]
        scores = [explained.score(columns, first) for columns, first in self._kept[candidate.label]]
        best = int(np.argmax([score.statistic for score in scores]))
        return Offer(candidate, shapes[best], scores[best], len(shapes))

    def _columns(self, candidate: Candidate, shape: Shape) -> tuple[Array, int]:
        """The columns of the channels that the candidate touches, and the first row of these."""
        columns = candidate.columns(self.bench, shape)
        if candidate.effect.acts_at_zero:  # its own change has no strength: it is there or it is not
            columns = np.column_stack([candidate.offset(self.bench), columns])
        by_channel = columns.reshape(len(self.bench.columns), len(self.bench.base), -1)
        touched = np.flatnonzero(np.any(by_channel[:, ::7] != 0.0, axis=(1, 2)))
        if not len(touched):
            return columns[:0], 0
        rows = slice(touched[0] * len(self.bench.base), (touched[-1] + 1) * len(self.bench.base))
        return np.ascontiguousarray(columns[rows]), rows.start

    def _onset(self, candidate: Candidate, explained: Explained) -> Offer:
        """Effects that begin at an instant: sums from the end give the score of every instant in one pass."""
        bench = self.bench
        columns = candidate.columns(bench, {"at_s": float(bench.base.t[0])})
        count, channels = len(bench.base), len(bench.columns)
        by_time = columns.reshape(channels, count, -1)
        own = np.einsum("cni,cnj->nij", by_time, by_time)
        shared = np.einsum("cnp,cni->npi", explained.basis.reshape(channels, count, -1), by_time)
        moment = np.einsum("cn,cni->ni", explained.residual.reshape(channels, count), by_time)
        own, shared, moment = (np.cumsum(values[::-1], axis=0)[::-1] for values in (own, shared, moment))
        edge = max(2, int(_EDGE * count))
        grams = own - np.einsum("npi,npj->nij", shared, shared)
        statistics = _statistics(grams[edge:-edge], moment[edge:-edge], own[0])
        best = edge + int(np.argmax(statistics))
        score = solve(grams[best], moment[best], np.sqrt(np.diag(own[best])))
        # James, James and Siegmund, Biometrika 74 (1987), (3): the tail of the largest of a scan over all instants,
        # b phi(b) ln((1 - e) / e)^2, over that of one instant, 2 phi(b) / b
        tries = max(1, int(np.ceil(score.statistic * np.log((1.0 - _EDGE) / _EDGE))))
        at_s = 0.5 * float(bench.base.t[best] + bench.base.t[best - 1])
        return Offer(candidate, {"at_s": at_s}, score, tries)

    def _tone(self, candidate: Candidate, explained: Explained) -> Offer:
        """A sine in time of unknown frequency: one Fourier transform of the residual under each envelope."""
        bench = self.bench
        count = len(bench.base)
        if candidate.label not in self._kept:
            self._kept[candidate.label] = [(self._envelopes(candidate), 0)]
        ((raw, _),) = self._kept[candidate.label]
        sigma = np.array([whitener.sigma for whitener in bench.whiteners])
        envelopes = (raw / sigma[:, None] * bench.weights[:, :, None])[:, bench.columns]
        envelopes = envelopes[:, :, np.einsum("ncj,ncj->j", envelopes, envelopes) > 0]
        residual = explained.residual.reshape(len(bench.columns), count)
        spectra = np.fft.rfft(np.einsum("cn,ncj->jn", residual, envelopes), n=2 * count, axis=1)
        gram = np.einsum("nci,ncj->ij", envelopes, envelopes)
        power = 2.0 * np.real(np.einsum("jf,jk,kf->f", spectra.conj(), np.linalg.pinv(gram), spectra))
        frequency: Array = np.arange(count + 1) / (2.0 * count * bench.interval_s)
        allowed = self._allowed(candidate, frequency)
        if not allowed.any():
            return Offer(candidate, {"freq_Hz": 0.0}, Score(0.0, 0, np.zeros(0), 0.0))
        peaks = sorted(np.flatnonzero(allowed), key=lambda index: -power[index])[:_PEAKS]
        best = max(
            (self._refined(raw, explained, frequency[peak]) for peak in peaks), key=lambda pair: pair[0].statistic
        )
        return Offer(candidate, {"freq_Hz": best[1]}, best[0], int(allowed.sum()) // 2)

    def _allowed(self, candidate: Candidate, frequency: Array) -> NDArray[np.bool_]:
        """Where a tone may appear in the sampled signal: its bands folded by the sampling."""
        bench = self.bench
        resolution = 1.0 / (len(bench.base) * bench.interval_s)
        if not candidate.effect.bands:
            return (frequency > _HARMONICS * _fastest_turn(bench)) & (frequency < 0.5 / bench.interval_s - resolution)
        allowed = np.zeros(len(frequency), dtype=bool)
        for low, high in candidate.effect.bands:
            fine = np.arange(low, high, 0.25 * resolution) * bench.interval_s
            folded = np.abs(fine - np.round(fine)) / bench.interval_s
            allowed[np.unique(np.clip(np.round(folded / frequency[1]).astype(int), 0, len(frequency) - 1))] = True
        return allowed & (frequency > _DRIFT * resolution)

    def _envelopes(self, candidate: Candidate) -> Array:
        """(n, 6, m) what the tone multiplies [recorded unit], for each strength and spanning direction."""
        parts = []
        for span in candidate.effect.spanning():
            if np.any(np.asarray(span["phase_rad"]) == 0.0):
                continue
            for column, step in enumerate(candidate.steps):
                row = np.zeros(candidate.size)
                row[column] = step
                parts.append(self.bench.change([candidate.make(row, {**span, "freq_Hz": 0.0})]) / step)
        return np.asarray(np.nan_to_num(np.stack(parts, axis=2)))

    def _refined(self, raw: Array, explained: Explained, frequency: float) -> tuple[Score, float]:
        """The best score within half a step of the transform, and its frequency."""
        bench = self.bench
        step = 0.5 / (len(bench.base) * bench.interval_s)
        around = [float(frequency + step * share) for share in (-0.5, 0.0, 0.5)]
        scores = []
        for each in around:
            turns = 2.0 * np.pi * each * bench.base.t[:, None, None]
            scores.append(
                explained.score(bench.whiten(np.concatenate([raw * np.sin(turns), raw * np.cos(turns)], axis=2)))
            )
        best = int(np.argmax([score.statistic for score in scores]))
        return scores[best], around[best]


def _statistics(grams: Array, moments: Array, scale: Array) -> Array:
    """LM of many small problems at once; a little ridge keeps the degenerate ones from exploding."""
    ridge = 1e-6 * np.trace(scale) / len(scale) * np.eye(len(scale))
    solved = np.linalg.solve(grams + ridge, moments[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", moments, solved))


def _fastest_turn(bench: Bench) -> float:
    """[Hz] the rate of the fastest joint; one tenth of the band where joints are not known."""
    if bench.base.q_encoder is None:
        return 0.05 / bench.interval_s
    speed = np.abs(np.gradient(bench.base.q_encoder, bench.base.t, axis=0))
    return float(np.median(speed, axis=0).max() / (2.0 * np.pi))
