"""The structured discrepancy: an error source along an unknown course, averaged over its prior.

Kennedy and O'Hagan, "Bayesian calibration of computer models" (Journal of the Royal Statistical Society B 63, 2001):
what no effect of the catalogue explains is a Gaussian process. Here it is a source times a sum of functions with normal
coefficients, so that its covariance has low rank: one eigendecomposition for each source and course serves all
amplitudes, and all hypotheses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.projection import orthonormal, project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear
from estimators.gap.hypotheses.candidates import split
from estimators.gap.hypotheses.prior import DISCREPANCY_SNR, DISCREPANCY_STEPS, LENGTHS, OTHER_FORM
from estimators.gap.hypotheses.sources import COSINES, Course, Source, cosines, courses, level_courses, matern, sources

Array = NDArray[np.float64]

#: Blocks of time in each of which a source may be off by something else: what changes faster than the cosines.
BLOCKS: Final = (128, 512)
#: A term that could not gain this much, its prior counted, is not weighed.
_HOPELESS: Final = -9.0
#: Eigenvalues below this share of the largest tell nothing.
_NEGLIGIBLE: Final = 1e-9


@dataclass(frozen=True)
class Term:
    """One source along one course.

    Attributes:
        source, course: in words.
        log_prior: of this term among all, before its amplitudes.
        basis: function that projects whitened (m, k) onto its eigenvectors, scaled: (r, k).
        values: (r,) eigenvalues of W' G W.
        steps, ratio: of the grid of amplitudes.
        unit: variance of the source's error for a variance of one here.
        projected: whether ``values`` are with the calibration projected out.
    """

    source: str
    course: str
    log_prior: float
    values: Array
    _project: object
    steps: int = DISCREPANCY_STEPS
    ratio: float = 2.0
    unit: float = 1.0
    projected: bool = True

    @cached_property
    def variances(self) -> Array:
        """(steps,) variances, one for each signal-to-noise before the data."""
        snr = DISCREPANCY_SNR * self.ratio ** np.arange(self.steps)
        return np.asarray(snr**2 / max(float(self.values.sum()), 1e-300))

    def along(self, columns: Array) -> Array:
        """(r, k) of whitened columns (m, k): products with the eigenvectors."""
        return self._project(columns)  # type: ignore[operator,no-any-return]


@dataclass(frozen=True)
class Means:
    """Whitened samples as sums over neighbours, scaled so that white noise keeps its variance of one.

    Attributes:
        fine: sample by sample. rough: the data of means over so many neighbours, for what courses follow.
    """

    fine: WhitenedData
    rough: WhitenedData

    @property
    def count(self) -> int:
        """Sums a channel."""
        return self.rough.count

    def __call__(self, columns: Array) -> Array:
        """Whitened columns (c n, k) as (c m, k)."""
        if self.rough is self.fine:
            return columns
        by_channel = columns.reshape(len(self.fine.columns), self.fine.count, -1)
        found = np.empty((len(self.fine.columns), self.count, by_channel.shape[-1]))
        for fine, own in zip(self.fine.stretches, self.rough.stretches, strict=True):
            count = own.stop - own.start
            size = (fine.stop - fine.start) // count
            cut = by_channel[:, fine.start : fine.start + count * size]
            shape = (len(found), count, size, cut.shape[-1])
            found[:, own] = cut.reshape(shape).sum(axis=2) / np.sqrt(size)
        return found.reshape(-1, found.shape[-1])

    @cached_property
    def absorbed(self) -> Array:
        """(c m, rank) orthonormal basis of the calibration's tangent."""
        return self.fine.absorbed if self.rough is self.fine else orthonormal(self(self.fine.tangent))

    def linear(self, fine: Linear) -> Linear:
        """A linearised set of effects, the calibration projected out here too."""
        both = self(np.column_stack([fine.left, fine.tangent]))
        both = project(self.absorbed, both)  # the effects' own calibration is a slightly different one
        return replace(fine, left=both[:, 0], tangent=both[:, 1:])


@dataclass(frozen=True)
class Discrepancies:
    """All terms on sums over neighbouring samples.

    Attributes:
        terms: of every source. courses: those that any source may follow.
    """

    terms: list[Term]
    means: Means
    courses: tuple[Course, ...]

    @classmethod
    def of(cls, fine: WhitenedData, rough: WhitenedData) -> Discrepancies:
        """Of every source along every course."""
        data = Means(fine, rough)
        along = list(courses(rough))
        every = [_on_means(data, each) for each in sources(fine)]
        found: list[Term] = []
        for source in every:
            own = [course for course, kinds in along if source.kind in kinds]
            if source.column >= 0 and source.kind == "offset":
                own += level_courses(rough, source.column)
            blocks = [count for count in BLOCKS if count < 0.7 * data.count] + [data.count]
            share = -float(np.log(len(every))) - float(np.log(len(own) + 2))
            found += _smooth(data, source, own, share)
            for count in blocks:
                found.append(blocks_term(data, source, count, share - float(np.log(len(blocks)))))
        general = tuple(course for course, kinds in along if "gain" in kinds)
        return cls([term for term in found if len(term.values)], data, general)

    def forms(self, changes: Mapping[str, Array]) -> list[Term]:
        """Effects that are there in another form than the catalogue's: of a strength that follows something.

        Args:
            changes: by label, (c n,) whitened change of each effect.
        """
        share = -float(np.log(max(len(changes), 1))) - float(np.log(len(self.courses) + 1))
        found: list[Term] = []
        for label, change in changes.items():
            effect, where = split(label)
            series = change.reshape(1, len(self.means.fine.columns), -1)
            source = Source(f"the strength of {effect} at {where}", series, "gain")
            found += _smooth(self.means, _on_means(self.means, source), self.courses, share)
        return [term for term in found if len(term.values)]


def _on_means(data: Means, source: Source) -> Source:
    """A source of every sample, as sums over neighbours."""
    freedoms, channels, _ = source.series.shape
    both = data(source.series.transpose(1, 2, 0).reshape(-1, freedoms))
    return replace(source, series=both.T.reshape(freedoms, channels, data.count))


def _smooth(data: Means, source: Source, along: Sequence[Course], log_prior: float) -> list[Term]:
    """A source along time, with every memory, and along each of some courses."""
    waves = cosines(data.count)
    found = []
    for length in LENGTHS:
        most = min(COSINES, max(8, int(np.ceil(8.0 / length))))
        share = log_prior - float(np.log(len(LENGTHS)))
        found.append(_term(data, source, "time", waves[:, :most], matern(length, most), share))
    return found + [_term(data, source, each.name, each.values, each.weight, log_prior) for each in along]


def _term(data: Means, source: Source, name: str, values: Array, weight: Array, log_prior: float) -> Term:
    """A source along functions of time, the calibration projected out."""
    freedoms, channels, _ = source.series.shape
    touched = [channel for channel in range(channels) if source.series[:, channel].any()]
    count = values.shape[1]
    gram = np.zeros((freedoms * count, freedoms * count))
    for i in range(freedoms):
        for j in range(i, freedoms):
            both = np.einsum("cn,cn->n", source.series[i, touched], source.series[j, touched])
            part = values.T @ (both[:, None] * values)
            gram[i * count : (i + 1) * count, j * count : (j + 1) * count] = part
            gram[j * count : (j + 1) * count, i * count : (i + 1) * count] = part.T

    def products(columns: Array) -> Array:
        by_channel = columns.reshape(channels, data.count, -1)[touched]
        parts = [values.T @ np.einsum("cn,cnk->nk", source.series[i, touched], by_channel) for i in range(freedoms)]
        return np.concatenate(parts)

    shared = products(data.absorbed)
    gram -= shared @ shared.T
    # each freedom as visible as any other
    scale = np.sqrt(np.array([np.sum(source.series[i] ** 2) for i in range(freedoms)]))
    scale = np.where(scale > 1e-12, 1.0 / np.maximum(scale, 1e-12), 0.0)
    weights = np.concatenate([weight * each for each in scale])
    own, vectors = np.linalg.eigh(weights[:, None] * gram * weights)
    kept = own > _NEGLIGIBLE * max(float(own[-1]), 1e-300)
    if not kept.any() or own[-1] <= 0.0:
        return Term(source.name, name, log_prior, np.zeros(0), None)
    vectors = vectors[:, kept]
    return Term(
        source.name, name, log_prior, own[kept], lambda columns: vectors.T @ (weights[:, None] * products(columns))
    )


def blocks_term(data: Means | WhitenedData, source: Source, count: int, log_prior: float) -> Term:
    """A source that is off by something else in each of so many blocks; what the calibration takes of it is little."""
    edges = np.linspace(0, data.count, count, endpoint=False).astype(int)
    size = np.sqrt(np.maximum(np.sum(source.series**2, axis=(1, 2)), 1e-300))
    if source.kind == "noise":  # one strength for all errors
        size[:] = np.sqrt(np.mean(size**2))
    series = source.series / size[:, None, None]
    channels = series.shape[1]
    grams = np.add.reduceat(np.einsum("icn,jcn->nij", series, series), edges, axis=0)
    own, vectors = np.linalg.eigh(grams)  # (b, f), (b, f, f)
    flat = own.ravel()
    kept = flat > _NEGLIGIBLE * max(float(flat.max()), 1e-300)

    def products(columns: Array) -> Array:
        by_channel = columns.reshape(channels, data.count, -1)
        parts = np.add.reduceat(np.einsum("icn,cnk->nik", series, by_channel), edges, axis=0)  # (b, f, k)
        turned = np.einsum("bij,bik->bjk", vectors, parts)
        return np.asarray(turned.reshape(-1, columns.shape[1])[kept])

    name = f"time, in {count} pieces" if count < data.count else "time, from sample to sample"
    return Term(source.name, name, log_prior, flat[kept], products, unit=1.0 / float(size[0]) ** 2, projected=False)


@dataclass(frozen=True)
class Weighed:
    """A term beside a set of effects.

    Attributes:
        term: the source and course.
        gains: (8,) log evidence at each amplitude beyond that without the term.
    """

    term: Term
    gains: Array

    @property
    def log_mass(self) -> float:
        """With the term's prior, amplitudes averaged."""
        return self.term.log_prior + float(np.logaddexp.reduce(self.gains) - np.log(len(self.gains)))


def weighed(linear: Linear, discrepancies: Discrepancies, changes: Mapping[str, Array] | None = None) -> list[Weighed]:
    """Every term beside a set of effects, the likeliest first; ``linear`` as ``Means.linear`` gives it.

    Args:
        changes: of the set's effects, as ``Discrepancies.forms`` takes them.
    """
    found = weighed_terms(linear, discrepancies.terms)
    if not changes:
        return found
    forms = weighed_terms(linear, discrepancies.forms(changes))
    every = [(each, 1.0 - OTHER_FORM) for each in found] + [(each, OTHER_FORM) for each in forms]
    shared = [replace(one, term=replace(one.term, log_prior=one.term.log_prior + log(part))) for one, part in every]
    return sorted(shared, key=lambda each: -each.log_mass)


def weighed_terms(linear: Linear, terms: Sequence[Term]) -> list[Weighed]:
    """Terms beside a set of effects, the likeliest first; all on the same grid of amplitudes."""
    precision = linear.precision(linear.averaged[1])
    columns = np.column_stack([linear.left, linear.tangent])
    square, gram, moment = float(linear.left @ linear.left), linear.gram, linear.tangent.T @ linear.left
    alone = float(linear.log_evidence(square, gram, moment, precision))
    kept, taken, dets = [], [], []
    for term in terms:
        along = term.along(columns)
        # without the effects' freedom no term can gain more than half the square it explains
        if 0.5 * float(np.sum(along[:, 0] ** 2 / term.values)) + term.log_prior < _HOPELESS:
            continue
        ratio = np.outer(term.variances, term.values)
        shrink = term.variances[:, None] / (1.0 + ratio)
        kept.append(term)
        taken.append((shrink[:, :, None] * along).transpose(0, 2, 1) @ along)
        dets.append(np.log1p(ratio).sum(axis=1))
    if not kept:
        return []
    every = np.stack(taken)  # (terms, amplitudes, 1 + p, 1 + p)
    logs = linear.log_evidence(
        square - every[..., 0, 0], gram - every[..., 1:, 1:], moment - every[..., 1:, 0], precision
    )
    gains = logs - alone - 0.5 * np.stack(dets)
    return sorted([Weighed(*each) for each in zip(kept, gains, strict=True)], key=lambda each: -each.log_mass)


def total(log_masses: Sequence[float]) -> float:
    """log of the sum of exponentials."""
    return float(np.logaddexp.reduce(list(log_masses))) if len(log_masses) else -np.inf
