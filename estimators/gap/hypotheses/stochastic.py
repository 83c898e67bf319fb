"""Noise that the floor does not have: white, coloured, wandering, or growing with the slope of the signal.

A noise effect changes the covariance of the readings, not their mean: its evidence is the likelihood of the whitened
residual under a spectrum (Whittle's, with cosines) or under a variance in time, against that of the floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.fft import dct
from scipy.optimize import minimize

from estimators.gap.data.blocks import block_means
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.learned import Learned, Spectrum, going_on, groups, parts
from estimators.gap.hypotheses.score import Explained, evidence
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import Effect
from rig.effects.parameters import Value

#: The lowest frequencies, in cycles a recording, carry what the calibration took: they tell nothing of the noise.
_TAKEN = 1
#: Strengths, as added over white variance at the spectrum's largest, between which the likelihood is searched.
_LOWEST, _HIGHEST = 1e-5, 1e8
#: Squares whose units differ by less than this factor's logarithm are alike; units below this share are none.
_ALIKE, _LEAST = 0.03, 1e-12
#: Strengths are told to so many roots of their squares' deviation beyond the fitted one, at so many points.
_REACH, _POINTS = 4.0, 401
#: The number that stands for all recordings.
EVERY = -1
#: Frequencies at least at which a spectrum's mean is taken.
_DENSE = 4096


@dataclass(frozen=True)
class FittedNoise:
    """What a noise effect explains.

    Attributes:
        effect: with its fitted strengths.
        gain: twice the gain in log likelihood.
        rank: the number of its strengths.
        searched: one over the share of the prior that its shape takes: how many were tried, and more of a rare one.
        std: (rank,) standard deviation of the strengths.
        spread: (rank,) standard deviation of their squares.
        added: (n, 6) variance that it adds to whitened readings, in time or by cosine transform.
        in_time: which of the two.
        gap: (6,) [recorded unit] root mean square of what it adds to the readings.
        gains: (rank,) of the gain, what each strength gains by itself; empty of one strength for all channels.
        widths: standard deviations of the shape's numbers, by name, where they were fitted.
        part: the number of the recording, of several, whose noise it is of; -1: of all, with one strength. more: of the
            other recordings, with strengths of their own.
    """

    effect: Effect
    gain: float
    rank: int
    searched: float
    std: Array
    spread: Array
    added: Array
    in_time: bool
    gap: Array
    part: int = 0
    more: tuple[FittedNoise, ...] = ()
    gains: Array = field(default_factory=lambda: np.zeros(0))
    widths: Mapping[str, float] = field(default_factory=dict)

    @property
    def every(self) -> tuple[FittedNoise, ...]:
        """Itself and those of the other recordings."""
        return (self, *self.more)

    @property
    def evidence(self) -> float:
        """Twice the log Bayes factor, on the scale of a mean effect's."""
        return evidence(self.gain, self.rank) - 2.0 * float(np.log(self.searched))

    @property
    def label(self) -> str:
        """Effect and place in one word."""
        return f"{self.effect.name}@{self.effect.where}"

    def steps(self, data: WhitenedData) -> tuple[Step, ...]:
        """What whitens this noise too, on its data; of all recordings where it is of all."""
        factor = 1.0 / np.sqrt(1.0 + self.added)
        own = [(self.part, slice(None))]
        if self.part == EVERY:
            own = list(enumerate(data.stretches[: len(data.parts)]))
        return tuple(
            Step(column, np.ascontiguousarray(factor[rows, column]), self.in_time, number)
            for number, rows in own
            for column in data.columns
            if np.any(factor[rows, column] != 1.0)
        )


@dataclass(frozen=True, eq=False)
class Left:
    """What is left of one recording, and its spectra: each is made once.

    Attributes:
        data: the recording. explained: what is left of its readings.
    """

    data: WhitenedData
    explained: Explained
    _spectra: dict[tuple[int, bool], Spectrum] = field(default_factory=dict)
    _responses: dict[int, Array] = field(default_factory=dict)

    def spectrum(self, column: int, slower: bool = False) -> Spectrum:
        """A channel's residual by cosine transform; ``slower``: beside a floor that goes on below what was seen."""
        if (column, slower) not in self._spectra:
            self._spectra[column, slower] = _spectrum(self.data, self.explained, column, slower)
        return self._spectra[column, slower]

    def response(self, column: int) -> Array:
        """What the whitening does to a spectrum at the frequencies of the cosine transform."""
        if column not in self._responses:
            frequency = np.arange(self.data.count)[_TAKEN:] / (2.0 * self.data.count)
            self._responses[column] = whitened_response(self.data, column, frequency)
        return self._responses[column]


def fitted_at(effect: type[Effect], where: str, left: Left, shape: Mapping[str, Value]) -> FittedNoise | None:
    """A noise effect's strengths by maximum likelihood, at one shape; None where its channels are not there."""
    data = left.data
    (strength,) = [item for item in effect.parameters() if item.strength]
    probe = effect.from_mapping({"where": where, **shape})
    columns = [column for column in range(len(CHANNELS))[probe.columns] if column in data.columns]
    if not columns:
        return None
    if probe.adds_in_time:
        fits, units, sizes = _in_time(probe, data, left.explained, columns)
    else:
        fits, units, sizes = _by_frequency(probe, left, columns)
    used = columns if strength.size > 1 else columns[:1]
    gain = float(sum(fits[column][1] for column in used))
    added = np.zeros((data.count, len(CHANNELS)))
    gap = np.zeros(len(CHANNELS))
    for column in columns:
        gap[column] = np.sqrt(fits[column][0] * sizes[column])
        added[:, column] = fits[column][0] * units[column]
    roots = np.sqrt([max(fits[column][0], 0.0) for column in used])
    spread = np.array([fits[column][2] for column in used])
    std = deviations(roots, spread)
    gains = np.array([fits[column][1] for column in used]) if strength.size > 1 else np.zeros(0)
    roots = np.clip(roots, strength.lower, strength.upper)
    value: object = float(roots[0]) if strength.size == 1 else tuple(float(root) for root in roots)
    made = effect.from_mapping({"where": where, **shape, strength.name: value})
    return FittedNoise(made, gain, len(used), 1, std, spread, added, probe.adds_in_time, gap, gains=gains)


def deviations(roots: Array, spread: Array) -> Array:
    """(k,) root mean square distance of strengths from fitted ones (k,), whose squares are normal with this standard
    deviation (k,): near nothing a strength is as wide as the root of that."""
    unit = np.sqrt(np.maximum(spread, 1e-300))
    fitted = roots / unit
    near = 0.5 / np.maximum(fitted, 1.0)  # of a large one, narrower than points would be apart
    small = np.minimum(fitted, _REACH)[:, None]
    offset = np.linspace(0.0, small + _REACH, _POINTS, axis=-1)[:, 0] - small
    weight = np.exp(-0.5 * (offset * (offset + 2.0 * small)) ** 2)
    broad = np.sqrt(np.sum(weight * offset**2, axis=1) / weight.sum(axis=1))
    return np.asarray(unit * np.where(fitted > _REACH, near, broad))


#: Of each channel: the likeliest variance, twice the gain, the variance's deviation.
Fits = dict[int, tuple[float, float, float]]


def _in_time(
    probe: Effect, data: WhitenedData, explained: Explained, columns: Sequence[int]
) -> tuple[Fits, dict[int, Array], dict[int, float]]:
    """Noise whose variance follows time: one strength for all channels."""
    rates = {column: _rates(probe, data)[:, column] for column in columns}
    units = _units_in_time(probe, data, columns)
    squares = [data.channel(explained.residual, column) ** 2 for column in columns]
    fit = _likeliest(squares, [units[column] for column in columns], data.floor_samples[columns])
    return dict.fromkeys(columns, fit), units, {column: float(np.mean(rates[column])) for column in columns}


def _rates(probe: Effect, data: WhitenedData) -> Array:
    """(n, 6) [recorded unit^2] variance of each reading for a strength of one."""
    return np.asarray(np.sum(probe.response(data.base, data.pipeline) ** 2, axis=2))


def _units_in_time(probe: Effect, data: WhitenedData, columns: Sequence[int]) -> dict[int, Array]:
    """The variance of whitened readings for a strength of one, where it follows time."""
    rates, units = _rates(probe, data), {}
    for column in columns:
        square = block_means(rates[:, column], data.block) / data.samples
        units[column] = square * (data.weights[:, column] / data.whiteners[column].sigma) ** 2
    return units


def _units_by_frequency(probe: Effect, data: WhitenedData, responses: Mapping[int, Array]) -> dict[int, Array]:
    """The same by cosine transform, where it has a spectrum; what lies below the lowest frequencies is as there."""
    own = _of_groups(probe, data.samples, data.interval_s, data.count)[groups(data.count, _TAKEN)]
    units = {column: own * response for column, response in responses.items()}
    return {column: np.concatenate([unit[:1].repeat(_TAKEN), unit]) for column, unit in units.items()}


def known_steps(effect: Effect, data: WhitenedData) -> tuple[Step, ...]:
    """What whitens a noise effect of known strengths too; none where its channels are not there."""
    columns = [column for column in range(len(CHANNELS))[effect.columns] if column in data.columns]
    shared = type(effect).response is not Effect.response  # one error for several channels is no step of each
    if not columns or (shared and not effect.adds_in_time):
        return ()
    if effect.adds_in_time:
        units = _units_in_time(effect, data, columns)
    else:
        frequency = np.arange(data.count)[_TAKEN:] / (2.0 * data.count)
        units = _units_by_frequency(effect, data, {each: whitened_response(data, each, frequency) for each in columns})
    touched = range(len(CHANNELS))[effect.columns]
    strengths = dict(zip(touched, np.broadcast_to(effect.strengths, len(touched)), strict=True))
    return tuple(
        Step(column, 1.0 / np.sqrt(1.0 + strengths[column] ** 2 * units[column]), effect.adds_in_time)
        for column in columns
    )


def _by_frequency(probe: Effect, left: Left, columns: Sequence[int]) -> tuple[Fits, dict[int, Array], dict[int, float]]:
    """Noise with a spectrum: a strength for each channel."""
    data = left.data
    group = groups(data.count, _TAKEN)
    many = np.bincount(group)
    units = _units_by_frequency(probe, data, {column: left.response(column) for column in columns})
    fits = {
        column: left.spectrum(column).added(np.bincount(group, units[column][_TAKEN:]) / many) for column in columns
    }
    return fits, units, dict.fromkeys(columns, variances(probe, data.samples, data.interval_s, data.count)[0])


def _spectrum(data: WhitenedData, explained: Explained, column: int, slower: bool) -> Spectrum:
    """A channel's residual by cosine transform.

    Cosines are close to the eigenvectors of slowly correlated noise and of a random walk, without the jump between its
    ends that a Fourier transform would see.
    """
    gaps = data.gaps[column]
    residual = gaps.filled(data.channel(explained.residual, column))
    count = len(residual)
    frequency = np.arange(count)[_TAKEN:] / (2.0 * count)
    power = dct(residual, norm="ortho")[_TAKEN:] ** 2 / gaps.share(count)
    group = groups(count, _TAKEN)
    many = np.bincount(group)
    noise, learned = data.noises[column], data.floor[column]
    more = going_on(data.floor, column, float(data.t[-1] - data.t[0])) if slower else ()
    if more:
        noise, learned = (replace(each, parts=(*each.seen, *more), spare=False) for each in (noise, learned))
    share = _named([step for step in data.steps if not step.of_floor], data, column, len(frequency))
    response = data.whiteners[column].response(frequency) * share
    middle = np.bincount(group, response) / many
    floor = parts(noise, np.bincount(group, frequency) / many, data.interval_s)
    if noise.lags:  # what whitens it makes it white
        whole = np.bincount(group, share) / many / middle
        floor = replace(floor, white=np.maximum(whole - floor.coloured.sum(axis=0), _LEAST * whole))
    named = np.maximum(1.0 - np.bincount(group, share) / many, 0.0)
    whitened = floor.times(middle, named)
    squares: Array = np.asarray(np.bincount(group, power), dtype=float)
    told = learned.told(data.count * data.samples)
    return Spectrum(Learned(learned, len(more), told), whitened, squares, many.astype(float))


def whitened_response(data: WhitenedData, column: int, frequency: Array) -> Array:
    """What the whitening does to a spectrum at the frequencies of the cosine transform [cycles a sample]."""
    response = data.whiteners[column].response(frequency)
    return np.asarray(response * _named(data.steps, data, column, len(frequency)))


def _named(steps: Sequence[Step], data: WhitenedData, column: int, count: int) -> Array:
    """(count,) the share of the whitened spectrum that noise which is known already leaves to the floor."""
    alive = data.weights[:, column] > 0
    share = np.full(count, np.mean(data.weights[alive, column] ** 2) if alive.any() else 1.0)
    for step in steps:
        if step.column == column:
            share = share * (np.mean(step.factor**2) if step.in_time else step.factor[-count:] ** 2)
    return share


def _of_means(probe: Effect, samples: int, interval_s: float, frequency: Array) -> Array:
    """The effect's spectrum in means of several samples: folded, after the averaging's own response.

    Args:
        interval_s: between means. frequency: [cycles a mean].
    """
    if samples == 1:
        return probe.added_spectrum(frequency, interval_s)
    folds = (frequency[:, None] + np.arange(samples)) / samples
    folds = np.minimum(folds, 1.0 - folds)  # (m, samples) cycles a sample, up to the half
    response = (np.sin(np.pi * frequency)[:, None] / (samples * np.sin(np.pi * folds))) ** 2
    spectrum = probe.added_spectrum(folds.ravel(), interval_s / samples).reshape(folds.shape)
    return np.asarray(np.mean(spectrum * response, axis=1))


@lru_cache(maxsize=64)
def _of_groups(probe: Effect, samples: int, interval_s: float, count: int) -> Array:
    """The same at the mean frequency of each group of cosines."""
    group = groups(count, _TAKEN)
    frequency = np.bincount(group, np.arange(_TAKEN, count) / (2.0 * count)) / np.bincount(group)
    found = _of_means(probe, samples, interval_s, frequency)
    found.setflags(write=False)  # every caller has the same
    return found


@lru_cache(maxsize=64)
def variances(probe: Effect, samples: int, interval_s: float, count: int) -> tuple[float, float]:
    """The variance of a single reading's error at strength one, and that of a mean's; of so many means."""
    recorded = max(count, _DENSE)
    frequency = np.arange(1, recorded) / (2.0 * recorded)
    single, means = (
        float(np.mean(_of_means(probe, many, interval_s * many / samples, frequency))) for many in (1, samples)
    )
    return single, means


def _likeliest(powers: Sequence[Array], units: Sequence[Array], floor_samples: Array) -> tuple[float, float, float]:
    """The variance x that makes squares most likely under level + x unit: x, twice the gain, its deviation.

    Each channel has a level of its own, which is not known better than the samples it was learned from tell: it is
    fitted along, with their likelihood. Squares of nearly the same unit are added up first: the likelihood needs no
    more than their sum.
    """
    largest = max((float(unit.max()) for unit in units if unit.size), default=0.0)
    if largest <= 0.0:
        return 0.0, 0.0, np.inf
    channels = [
        (*_alike(power, unit / largest), samples)
        for power, unit, samples in zip(powers, units, floor_samples, strict=True)
    ]

    def loss(point: Array) -> tuple[float, Array]:
        ratio = np.exp(point[-1])
        value, along = 0.0, np.zeros(len(point))
        for index, (counts, sums, relative, samples) in enumerate(channels):
            level = np.exp(point[index])
            total = level + ratio * relative
            slope = (counts - sums / total) / total
            value += float(counts @ np.log(total) + np.sum(sums / total) + samples * (point[index] + 1.0 / level))
            along[index] = level * slope.sum() + samples * (1.0 - 1.0 / level)
            along[-1] += ratio * float(slope @ relative)
        return value, along

    alone = np.array([(sums.sum() + samples) / (counts.sum() + samples) for counts, sums, _, samples in channels])
    many = np.array([counts.sum() + samples for counts, _, _, samples in channels])
    nothing = float(many @ (np.log(alone) + 1.0))
    starts = [np.array([*np.zeros(len(channels)), exponent]) for exponent in (-3.0, 2.0, 7.0)]
    start = min(starts, key=lambda point: loss(point)[0])
    bounds = [*[(-2.0, 5.0)] * len(channels), (np.log(_LOWEST), np.log(_HIGHEST))]
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
    gain = nothing - float(found.fun)
    ratio = float(np.exp(found.x[-1]))
    information = np.zeros((len(found.x), len(found.x)))
    for index, (counts, _, relative, samples) in enumerate(channels):
        level = float(np.exp(found.x[index]))
        weights = np.stack([np.ones(len(relative)), relative]) / (level + ratio * relative)
        own = [index, len(channels)]
        information[np.ix_(own, own)] += 0.5 * (weights * counts) @ weights.T
        information[index, index] += 0.5 * samples / level**2
    spread = float(np.sqrt(np.linalg.inv(information)[-1, -1]))
    if gain <= 0.0:
        return 0.0, 0.0, spread / largest
    return ratio / largest, gain, spread / largest


def _alike(power: Array, unit: Array) -> tuple[Array, Array, Array]:
    """How many squares have about the same unit, their sum, and that unit."""
    group = (np.log(np.maximum(unit, _LEAST)) / _ALIKE).astype(int)
    group -= group.min()
    many = np.bincount(group)
    filled = many > 0
    counts = many[filled].astype(float)
    sums, units = (np.asarray(np.bincount(group, values), dtype=float)[filled] for values in (power, unit))
    return counts, sums, units / counts
