"""The terms of a discrepancy: an error source along a family of functions of time, or in pieces of time.

The errors of all sources are products with the same functions: what terms share of these is made once for all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from estimators.gap.data.projection import Basis, project
from estimators.gap.evidence.means import Means
from estimators.gap.hypotheses.courses import COSINES, Course, cosines, matern
from estimators.gap.hypotheses.prior import DISCREPANCY_SNR, DISCREPANCY_STEPS, LENGTHS
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array

#: Eigenvalues below this share of the largest tell nothing.
_NEGLIGIBLE: Final = 1e-9
#: And what the calibration leaves less of than this share of its square is rounding.
_ABSORBED: Final = 1e-9
#: So many products of freedoms with columns are held at once.
_AT_ONCE: Final = 1 << 18


@dataclass(frozen=True, eq=False)
class Errors:
    """What sources do to whitened readings, and functions of time that their terms share.

    Attributes:
        series: (n, f, t) of every freedom of every source: its change of each channel that any of them touches.
        touched: (c,) which channels these are.
        values: (n, k) functions of time.
        means: the sums over neighbouring samples that these are of; None: of every sample.
        absorbed: what the calibration takes of every sample.
    """

    series: Array
    touched: NDArray[np.bool_]
    values: Array
    means: Means | None = None
    absorbed: Basis | None = None

    @classmethod
    def of(
        cls,
        every: Sequence[Source],
        values: Array | None = None,
        means: Means | None = None,
        absorbed: Basis | None = None,
    ) -> Errors:
        """Of sources one after another."""
        touched = np.any([each.series.any(axis=(0, 2)) for each in every], axis=0)
        series = np.concatenate([each.series[:, touched] for each in every]).transpose(2, 0, 1).copy()
        return cls(series, touched, np.empty((len(series), 0)) if values is None else values, means, absorbed)

    def of_channels(self, freedoms: slice) -> Array:
        """(f, c, n) what some freedoms do to each channel."""
        found = np.zeros((len(self.touched), *self.series[:, freedoms].shape[:2]))
        found[self.touched] = self.series[:, freedoms].transpose(2, 0, 1)
        return found.transpose(2, 0, 1)

    def summed(self, columns: Array) -> Array:
        """Whitened columns of every sample as these errors are; those that are so already as they are."""
        size = len(self.series) * len(self.touched)
        return columns if self.means is None or len(columns) == size else self.means(columns)

    def left(self, columns: Array) -> Array:
        """The same, without what the calibration takes: that of other causes is a slightly different one."""
        if self.absorbed is not None and len(columns) == self.absorbed.length:
            columns = project(self.absorbed, columns)
        return self.summed(columns)

    def moments(self, columns: Array, freedoms: slice = slice(None), rows: slice = slice(None)) -> Array:
        """(n, f, m) products of some freedoms with whitened columns (c n, m), sample by sample or sum by sum.

        Args:
            rows: some of the samples, or sums.
        """
        every = columns.T.reshape(-1, len(self.touched), len(self.series))
        by_channel = np.ascontiguousarray(every[:, self.touched, rows].transpose(2, 1, 0))
        return np.asarray(np.matmul(self.series[rows, freedoms], by_channel))

    def products(self, columns: Array, freedoms: slice, functions: slice = slice(None)) -> Array:
        """(k, f, m) of some freedoms along some functions of time with whitened columns (c n, m)."""
        along, count = self.values[:, functions], len(self.series[0, freedoms])
        found = np.zeros((along.shape[1], count * columns.shape[1]))
        for rows in few_at_once(len(along), found.shape[1]):
            found += along[rows].T @ self.moments(columns, freedoms, rows).reshape(-1, found.shape[1])
        return found.reshape(-1, count, columns.shape[1])

    def along(self, moments: Array, functions: slice = slice(None)) -> Array:
        """(k, f, m) of these along some functions of time."""
        own = self.values[:, functions]
        return np.asarray((own.T @ moments.reshape(len(moments), -1)).reshape(-1, *moments.shape[1:]))


@dataclass(frozen=True, eq=False)
class Term:
    """One source along one course.

    Attributes:
        source, course: in words.
        log_prior: of this term among all, before its amplitudes.
        values: (r,) eigenvalues of W' G W.
        errors, freedoms: the source. functions: of the course; None: the errors of each of some pieces of time.
        vectors: (f k, r) eigenvectors, scaled, of smooth terms. Of pieces: (b, f, f).
        edges: (b,) where the pieces begin. kept: (b f,) which of their values count.
        steps, ratio: of the grid of amplitudes. shift: a factor of its variances.
        unit: variance of the source's error for a variance of one here.
        weight: (k,) prior standard deviations of the functions, up to a common factor; None of pieces.
        of_samples: the source sample by sample, of a term that can be made more exactly. of_means: the term that such
            a one was. alone: the source, where ``errors`` are of it along the course.
    """

    source: str
    course: str
    log_prior: float
    values: Array
    errors: Errors
    freedoms: slice
    functions: slice | None
    vectors: Array
    edges: NDArray[np.intp] | None = None
    kept: NDArray[np.bool_] | None = None
    steps: int = DISCREPANCY_STEPS
    ratio: float = 2.0
    shift: float = 1.0
    unit: float = 1.0
    weight: Array | None = None
    of_samples: Source | None = None
    of_means: Term | None = None
    alone: Source | None = None

    @property
    def projected(self) -> bool:
        """Whether ``values`` are with the calibration projected out."""
        return self.functions is not None

    @cached_property
    def variances(self) -> Array:
        """(steps,) variances, one for each signal-to-noise before the data."""
        snr = DISCREPANCY_SNR * self.ratio ** np.arange(self.steps)
        return np.asarray(self.shift * snr**2 / max(float(self.values.sum()), 1e-300))

    @cached_property
    def shrunk(self) -> tuple[Array, Array]:
        """At each variance the share of it (steps, r) that the data leave, and log det(I + variance W' G W)."""
        ratio = np.outer(self.variances, self.values)
        return self.variances[:, None] / (1.0 + ratio), np.log1p(ratio).sum(axis=1)

    def along(self, columns: Array) -> Array:
        """(r, k) of whitened columns (m, k), without what the calibration takes: products with the eigenvectors."""
        return self.along_with_calibration(self.errors.left(columns))

    def along_with_calibration(self, columns: Array) -> Array:
        """The same of columns as they are."""
        sums = self.errors.summed(columns)
        if self.edges is not None:
            return self.turned(np.add.reduceat(self.errors.moments(sums, self.freedoms), self.edges, axis=0))
        assert self.functions is not None
        return self.turned(self.errors.products(sums, self.freedoms, self.functions))

    def mean(self, residual: Array, likeliest: int) -> Array:
        """(c n,) what it is most likely to be in a residual (c n,), of every sample or of sums as the errors are.

        Args:
            likeliest: the number of its amplitude.
        """
        return self.made(self.shrunk[0][likeliest][:, None] * self.along(residual[:, None]))[:, 0]

    def made(self, sizes: Array) -> Array:
        """(c n, k) what sizes (r, k) along the eigenvectors make of samples, or of sums as the errors are."""
        series, many = self.errors.series[:, self.freedoms], sizes.shape[1]
        if self.functions is not None:
            own = (self.vectors @ sizes).reshape(series.shape[1], -1, many)
        else:
            assert self.edges is not None
            assert self.kept is not None
            flat = np.zeros((len(self.kept), many))
            flat[self.kept] = sizes
            pieces = np.matmul(self.vectors, flat.reshape(len(self.edges), -1, many))
            number = np.repeat(np.arange(len(self.edges)), np.diff([*self.edges, len(series)]))
        found = np.zeros((many, len(self.errors.touched), len(series)))
        for rows in few_at_once(len(series), series.shape[1] * many):
            if self.functions is not None:
                each = np.matmul(self.errors.values[rows, self.functions], own).transpose(1, 0, 2)  # (n, f, k)
            else:
                each = pieces[number[rows]]
            found[:, self.errors.touched, rows] = np.matmul(series[rows].transpose(0, 2, 1), each).transpose(2, 1, 0)
        return found.reshape(many, -1).T

    def every_sample(self, sums: Array) -> Array:
        """(c n, k) of what is of samples, or of sums as the errors are."""
        means = self.errors.means
        return sums if means is None else np.stack([means.spread(each) for each in sums.T]).T

    def of_every_sample(self, residual: Array, likeliest: int) -> Array:
        """``mean``, of every sample."""
        return self.every_sample(self.mean(residual, likeliest)[:, None])[:, 0]

    def turned(self, sums: Array) -> Array:
        """(r, m) of sums (k, f, m) of the source's freedoms along the functions, or (b, f, m) in the pieces."""
        if self.functions is not None:
            return np.asarray(self.vectors.T @ sums.transpose(1, 0, 2).reshape(-1, sums.shape[2]))
        return np.asarray(np.matmul(self.vectors.transpose(0, 2, 1), sums).reshape(-1, sums.shape[2])[self.kept])


def few_at_once(count: int, size: int) -> Iterator[slice]:
    """So many samples, so few at a time that products of this size each fit into the memory."""
    step = max(_AT_ONCE // max(size, 1), 1)
    return (slice(start, start + step) for start in range(0, count, step))


def freedoms_of(every: Sequence[Source]) -> list[slice]:
    """Where each source's are among all, one after another."""
    ends = np.cumsum([len(each.series) for each in every]).tolist()
    return [slice(end - len(each.series), end) for end, each in zip(ends, every, strict=True)]


@dataclass(frozen=True, eq=False)
class Functions:
    """Functions of time that errors may follow: cosines, then those of some courses.

    Attributes:
        values: (n, k). of_course: which of them are a course's, by its identity. courses: these.
    """

    values: Array
    of_course: Mapping[int, slice]
    courses: tuple[Course, ...]

    @classmethod
    def of(cls, count: int, along: Iterable[Course], slow: bool = True) -> Functions:
        """Of courses at so many times, each once, with cosines where something may be slow."""
        distinct = {id(course): course for course in along}
        values = [cosines(count) if slow else np.empty((count, 0)), *(each.values for each in distinct.values())]
        ends = np.cumsum([each.shape[1] for each in values]).tolist()
        places = dict(zip(distinct, map(slice, ends[:-1], ends[1:]), strict=True))
        return cls(np.hstack(values), places, tuple(distinct.values()))


def smooth_terms(
    absorbed: Basis,
    every: Sequence[Source],
    along: Sequence[Sequence[Course]],
    shares: Sequence[float],
    functions: Functions,
    means: Means | None = None,
    lengths: Sequence[float] = LENGTHS,
) -> tuple[Errors, list[Term]]:
    """Sources along time, with every memory, and each along each of its courses.

    Args:
        absorbed: the calibration's tangent, of every sample.
        along: courses of each source. shares: of each the log prior of one course.
        functions: those of all courses.
        means: the sums over neighbouring samples that sources and courses are of; None: of every sample.
        lengths: memories, as shares of the recording.
    """
    errors = Errors.of(every, functions.values, means, absorbed)
    shared = errors.products(errors.summed(absorbed.dense()), slice(None))  # (k, f, p) what the calibration takes
    found: list[Term] = []
    for source, freedoms, own, share in zip(every, freedoms_of(every), along, shares, strict=True):
        gram = _gram_of_cosines(errors, freedoms) if lengths else np.empty(0)
        ways = []
        for length in lengths:  # the first of the same cosines
            most = min(COSINES, max(8, int(np.ceil(8.0 / length))))
            prior = share - float(np.log(len(lengths)))
            ways.append(("time", slice(0, most), gram[:, :most, :, :most], matern(length, most), prior))
        for each in own:
            of = functions.of_course[id(each)]
            ways.append((each.name, of, _gram(errors, freedoms, of), each.weight, share))
        for name, of, block, weight, prior in ways:
            found.append(_term(errors, source, freedoms, name, of, block, shared[of, freedoms], weight, prior))
    return errors, [each for each in found if len(each.values)]


def terms_along(
    absorbed: Basis, source: Source, course: Course, log_prior: float, means: Means | None = None
) -> list[Term]:
    """One source along one course, arguments as of ``smooth_terms``: a term, or none where the calibration takes it.

    Where the floor has a memory, what is whitened is the source along the course: a jump in a slow drift is a spike.
    """
    if (followed := source.along(course.values, course.weight)) is not None:
        source, course = followed, Course(course.name, np.ones((source.series.shape[2], 1)), np.ones(1))
    functions = Functions.of(source.series.shape[2], [course], slow=False)
    return smooth_terms(absorbed, [source], [[course]], [log_prior], functions, means, lengths=())[1]


def _gram(errors: Errors, freedoms: slice, functions: slice) -> Array:
    """(f, k, f, k) products of a source's freedoms along functions of time, of unit noise."""
    series, values = errors.series[:, freedoms], errors.values[:, functions]
    if values.shape[1] == 1:
        every = (series * values[:, :, None]).transpose(1, 0, 2).reshape(series.shape[1], -1)
        return np.asarray(every @ every.T)[:, None, :, None]
    both = np.matmul(series, series.transpose(0, 2, 1))
    count = series.shape[1]
    found = np.empty((count, values.shape[1], count, values.shape[1]))
    for i in range(count):
        for j in range(i, count):
            found[i, :, j] = found[j, :, i] = values.T @ (both[:, i, j, None] * values)
    return found


def _gram_of_cosines(errors: Errors, freedoms: slice) -> Array:
    """(f, k, f, k) the same along the slowest cosines: a product of two is half the sum of those of the sum and of the
    difference of their orders, so that one cosine transform tells all that samples tell apart."""
    series = errors.series[:, freedoms]
    if len(series) < 2 * COSINES:
        return _gram(errors, freedoms, slice(0, COSINES))
    first, second = np.triu_indices(series.shape[1])
    waves = 0.5 * np.asarray(dct(np.einsum("npt,npt->pn", series[:, first], series[:, second])))
    order = np.arange(COSINES)
    size = np.where(order > 0, np.sqrt(2.0), 1.0)
    pairs = 0.5 * np.outer(size, size) * (waves[:, order + order[:, None]] + waves[:, np.abs(order - order[:, None])])
    found = np.empty((series.shape[1], COSINES, series.shape[1], COSINES))
    found[first, :, second] = found[second, :, first] = pairs
    return found


def _term(
    errors: Errors,
    source: Source,
    freedoms: slice,
    name: str,
    functions: slice,
    gram: Array,
    shared: Array,
    weight: Array,
    log_prior: float,
) -> Term:
    """A source along functions of time, the calibration projected out.

    Args:
        gram: as ``_gram`` makes it. shared: (k, f, p) products with the calibration's tangent.
    """
    size = len(gram) * len(weight)
    taken = shared.transpose(1, 0, 2).reshape(size, -1)
    left = gram.reshape(size, size) - taken @ taken.T
    if source.alone is None:  # each freedom as visible as any other
        scale = np.sqrt(np.sum(source.series**2, axis=(1, 2)))
        scale = np.where(scale > 1e-12, 1.0 / np.maximum(scale, 1e-12), 0.0)
    else:  # as it has been made
        scale = np.ones(len(source.series))
    weights = np.outer(scale, weight).ravel()
    own, vectors = np.linalg.eigh(weights[:, None] * left * weights)
    whole = float(np.max(weights**2 * np.diag(gram.reshape(size, size)), initial=0.0))
    kept = own > max(_NEGLIGIBLE * float(own[-1]), _ABSORBED * whole, 1e-300)
    scaled = weights[:, None] * vectors[:, kept]
    values = own[kept]
    return Term(
        source.name, name, log_prior, values, errors, freedoms, functions, scaled, weight=weight, alone=source.alone
    )


def blocks_term(errors: Errors, source: Source, freedoms: slice, count: int, log_prior: float) -> Term:
    """A source that is off by something else in each of so many blocks; what the calibration takes of it is little."""
    series = errors.series[:, freedoms]
    edges = np.linspace(0, len(series), count, endpoint=False).astype(int)
    size = np.sqrt(np.maximum(np.sum(series**2, axis=(0, 2)), 1e-300))
    if source.kind == "noise":  # one strength for all errors
        size[:] = np.sqrt(np.mean(size**2))
    grams = np.add.reduceat(np.matmul(series, series.transpose(0, 2, 1)), edges, axis=0) / np.outer(size, size)
    own, vectors = np.linalg.eigh(grams)  # (b, f), (b, f, f)
    flat = own.ravel()
    kept = flat > _NEGLIGIBLE * max(float(flat.max()), 1e-300)
    single = count == len(series) and (errors.means is None or errors.means.of_single)
    name = "time, from sample to sample" if single else f"time, in {count} pieces"
    scaled, unit = vectors / size[:, None], 1.0 / float(size[0]) ** 2
    return Term(source.name, name, log_prior, flat[kept], errors, freedoms, None, scaled, edges, kept, unit=unit)


def every_along(terms: Sequence[Term], columns: Array) -> Iterator[Array]:
    """``along`` of each term; what terms of the same errors share is made once."""
    in_pieces = {id(term.errors) for term in terms if term.edges is not None}
    moments: dict[int, Array] = {}
    known: dict[int, Array] = {}
    pieces: dict[tuple[int, int], Array] = {}
    for term in terms:
        errors, own = term.errors, id(term.errors)
        if own not in known:
            left = errors.left(columns)
            if own in in_pieces:
                moments[own] = errors.moments(left)
            known[own] = errors.along(moments[own]) if own in moments else errors.products(left, slice(None))
        if term.edges is None:
            yield term.turned(known[own][term.functions, term.freedoms])
            continue
        key = own, len(term.edges)
        if key not in pieces:
            pieces[key] = np.add.reduceat(moments[own], term.edges, axis=0)
        yield term.turned(pieces[key][:, term.freedoms])
