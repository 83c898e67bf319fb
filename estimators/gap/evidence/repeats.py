"""An error source that repeats by itself, in time, in a joint's angle or in a channel's own level: a sine, or any
waveform of some harmonics.

A vibration, an unbalance, a filter that rings; a coil that is pulsed; a gear's tooth, a motor's pole; a converter's bit
that sticks: whatever has a period of its own, and no name. What the catalogue has as a tone may be one line of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize_scalar
from typing_extensions import override

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.fitted_courses import FittedCourses
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import COSINES, LOCKED, ORDERS, Course
from estimators.gap.hypotheses.tones import of_waves
from rig.arrays import Array, Rows
from rig.channels import CHANNELS
from rig.effects.converter import lattice_step

#: So many sources along clocks are weighed, those of the best sines.
_MOST: Final = 5
#: Harmonics of a waveform, and what each of its sines and cosines costs in log evidence before it is weighed.
_HARMONICS: Final = (1, 4, 16)
_COST: Final = 1.5
#: Amid two frequencies of the transform a sine explains so much more than at either.
_BETWEEN: Final = 1.25
#: A period of a joint's angle is passed in one sample at least; of a waveform, so often in the recording.
_CYCLES: Final = 3.0
#: A joint is time where it is off from turning steadily by less than this share of its shortest period.
_STEADY: Final = 0.1
#: Of a channel's level: a period of so many standard deviations of its noise is seen through this, and of so many steps
#: it is no rounding.
_THROUGH, _ROUNDED = 3.0, 2.0
#: Frequencies a cell, over two cells to either side, about the best of which it is polished, to this share of their
#: distance: of a sine of signal-to-noise 1,000 that loses less than one in square.
_NEAR, _AS_NEAR = 2, 1e-3
#: Makes a Gram matrix positive where waves are alike.
_NEXT_TO_NOTHING: Final = 1e-10


@dataclass(frozen=True, eq=False)
class Clock:
    """What an error can repeat in.

    Attributes:
        name: of a joint, else empty. unit: of its period, and of how many of x that is.
        x: (n,) from zero. step: of the grid that it is put on.
        low, high: of the frequency of a sine, in steps of ``cell``; what is slower has courses of its own.
    """

    name: str
    unit: tuple[str, float]
    x: Array
    step: float
    low: int
    high: int

    @cached_property
    def bins(self) -> int:
        """Of the grid, and as many again."""
        return int(next_fast_len(2 * (int(np.ceil(float(self.x.max()) / self.step)) + 1), real=True))

    @property
    def cell(self) -> float:
        """Cycles of x between neighbouring frequencies: half of what the recording tells apart."""
        return 1.0 / (self.bins * self.step)

    @cached_property
    def _places(self) -> tuple[Rows, Array]:
        place = self.x / self.step
        below = np.floor(place + 1e-9)
        return below.astype(int), np.maximum(place - below, 0.0)

    def spectra(self, own: Array) -> NDArray[np.complex128]:
        """(f, m) transforms of series (f, n), from frequency zero to ``high``."""
        below, share = self._places
        grid = np.empty((len(own), self.bins))
        for index, values in enumerate(own):
            grid[index] = np.bincount(below, values * (1.0 - share), self.bins)
            grid[index] += np.bincount(below + 1, values * share, self.bins)
        return np.asarray(rfft(grid, axis=1)[:, : self.high])

    def course(self, frequency: float, harmonics: int) -> Course:
        """Sines and cosines of a fundamental [cycles of x] and its harmonics."""
        turns = 2.0 * np.pi * np.outer(self.x, frequency * np.arange(1, harmonics + 1))
        weight = np.tile(1.0 / np.sqrt(np.arange(1.0, harmonics + 1.0)), 2)
        unit, size = self.unit
        period = f"{1.0 / (frequency * size):.4g} {unit}{self.name}"
        if harmonics > 1:
            name = f"every {period}"
        else:
            name = f"a sine of {frequency:.4g} Hz" if self.unit[0] == "s" else f"a sine of {period}"
        return Course(name, np.hstack([np.cos(turns), np.sin(turns)]), weight)


def clocks(data: WhitenedData) -> list[Clock]:
    """Time, and the angle of each joint that moves; but of one that turns steadily, as time tells the same."""
    found = []
    count, t = data.count, data.t - data.t[0]
    if count > COSINES + 2:
        whole = Clock("", ("s", 1.0), t, data.interval_s, 0, 0)
        slowest = _CYCLES / (count * data.interval_s)
        found.append(replace(whole, low=int(slowest / whole.cell), high=(whole.bins + 1) // 2))
    q = data.base.q_encoder
    if q is None:
        return found
    every = np.unwrap(q, axis=0)
    slides = () if data.base.arm is None else data.base.arm.slides
    for joint in np.flatnonzero(np.std(every, axis=0) > LOCKED):
        angle = np.zeros(count)
        angle[: len(every)] = every[:, joint] - every[:, joint].min()
        between = float(np.quantile(np.abs(np.diff(angle)), 0.9))
        reach = float(angle.max())
        fastest = min(1.0 / max(between, 1e-12), count / reach)
        steady = np.polynomial.Polynomial.fit(t[: len(every)], every[:, joint], 1)(t[: len(every)])
        if np.std(every[:, joint] - steady) * fastest < _STEADY:
            continue
        slowest = max(ORDERS / (2.0 * np.pi), _CYCLES / reach)
        unit = ("m", 1.0) if len(slides) and slides[joint] else ("deg", np.pi / 180.0)
        own = Clock(f" of joint{joint + 1}", unit, angle, 1.0 / (4.0 * fastest), 0, 0)
        low, high = (int(limit / own.cell) for limit in (slowest, fastest))
        if high > low + 1:
            found.append(replace(own, low=low, high=high))
    return found


def levels(data: WhitenedData) -> dict[int, Clock]:
    """Of each channel, by its number, its own level, in which an error of its converter repeats."""
    found = {}
    for column in data.columns:
        level = data.means(column, np.nan_to_num(data.modelled[:, column]))
        level = level - level.min()
        reach = float(level.max())
        sigma, step = float(np.sqrt(data.floor[column].variance)), lattice_step(data.readings[:, column])
        fastest = min(1.0 / max(_THROUGH * sigma, _ROUNDED * step), data.count / max(reach, 1e-300))
        unit = (f"% of the span of {CHANNELS[column]}", reach / 100.0)
        own = Clock("", unit, level, 1.0 / (4.0 * fastest), 0, 0)
        low, high = (int(limit / own.cell) for limit in (_CYCLES / max(reach, 1e-300), fastest))
        if high > low + 1:
            found[column] = replace(own, low=low, high=high)
    return found


@dataclass(frozen=True)
class Repeats(FittedCourses):
    """What any source would leave that repeats."""

    @cached_property
    def _clocks(self) -> list[list[Clock]]:
        """Of each source."""
        shared, own = clocks(self.data), levels(self.data)
        return [
            [*shared, own[source.column]] if source.of_one_offset and source.column in own else shared
            for source in self.every
        ]

    @cached_property
    def _inverses(self) -> list[Array]:
        return [np.linalg.pinv(np.einsum("icn,jcn->ij", own.series, own.series)) for own in self.every]

    @override
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """Those that explain most as a sine, each as what repeats and is likeliest."""
        residual = left.reshape(len(self.data.columns), self.data.count)
        found: list[tuple[float, int, int, Clock, Array]] = []
        for index, source in enumerate(self.every):
            own = np.einsum("fcn,cn->fn", source.series, residual)
            for clock in self._clocks[index]:
                squares = of_waves(clock.spectra(own)[:, clock.low :], self._inverses[index])
                # each of its freedoms has a sine and a cosine
                gained = 0.5 * float(squares.max()) - 2.0 * _COST * len(own) - np.log(clock.high - clock.low)
                found.append((gained, len(found), index, clock, own))
        terms = []
        for _, _, index, clock, own in sorted(found, key=lambda each: each[:2], reverse=True)[:_MOST]:
            share = self.shares[index] - float(np.log(len(self._clocks[index]) * len(_HARMONICS)))
            for gained, harmonics, frequency, tried in _ways(clock, own, self._inverses[index]):
                if _BETWEEN * gained - len(own) * harmonics + share - np.log(tried) < least:
                    continue  # each sine and cosine costs a half at least
                square, frequency = _polished(clock, self.every[index].series, own, harmonics, frequency)
                # a sine so strong is told to sqrt(12) / (2 pi snr) of a cell (Rife and Boorstyn, 1974): a share of each
                told = np.sqrt(2.0 * np.pi) * np.sqrt(12.0 / max(square, 1.0)) / (2.0 * np.pi)
                course, cost = clock.course(frequency, harmonics), float(np.log(tried / min(told, 1.0)))
                terms += terms_along(self.data.absorbed, self.every[index], course, share - cost)
        return terms


def _ways(clock: Clock, own: Array, inverse: Array) -> list[tuple[float, int, float, float]]:
    """For each number of harmonics the likeliest waveform: what it gains in log likelihood, how many of them there are,
    its fundamental [cycles], and how many fundamentals were tried: as many as the fastest harmonic tells apart.

    Args:
        own: (f, n) products of a source with the residual. inverse: (f, f) of the source's Gram matrix.
    """
    squares = of_waves(clock.spectra(own), inverse)
    squares[: int(2.0 * _CYCLES)] = 0.0
    peaks = np.where(squares == maximum_filter1d(squares, 7), squares, 0.0)  # what leaks from one is no line
    peaks = maximum_filter1d(peaks, 3)
    found, before = [], 0
    for most in _HARMONICS:
        slowest = clock.low if most == 1 else int(2.0 * _CYCLES)
        fundamental = np.arange(most * slowest, most * clock.high - most + 1) / most
        comb, many = np.zeros(len(fundamental)), np.minimum(clock.high // fundamental, most).astype(int)
        for order in range(1, most + 1):
            there = many >= order  # the first of them
            comb[there] += peaks[np.minimum(np.round(order * fundamental[there]).astype(int), len(peaks) - 1)]
        costs = 2.0 * _COST * len(own) * many + np.log(0.5 * len(fundamental))
        best = int(np.argmax(0.5 * comb - costs))
        if (harmonics := int(many[best])) > before:
            place = float(fundamental[best]) * clock.cell
            found.append((0.5 * float(comb[best]), harmonics, place, 0.5 * len(fundamental)))
        before = max(before, harmonics)
    return found


def _polished(clock: Clock, series: Array, own: Array, harmonics: int, frequency: float) -> tuple[float, float]:
    """The most that a fundamental near one of the grid's explains, and that fundamental [cycles].

    Products of two waves are waves of the sum and the difference of their orders: one transform of the source's Gram
    matrix at each order makes that of all harmonics.

    Args:
        series: (f, c, n) of the source. own: (f, n) products of it with the residual.
    """
    first, second = np.triu_indices(len(own))
    pairs = np.zeros((len(own), len(own)), dtype=np.intp)
    pairs[first, second] = pairs[second, first] = np.arange(len(first))
    rows = np.vstack([np.einsum("pcn,pcn->pn", series[first], series[second]), own])
    order = np.arange(1, harmonics + 1)
    apart, both = order - order[:, None], order + order[:, None]
    powers = np.ones((2 * harmonics + 1, clock.x.size), dtype=complex)

    def lost(near: float) -> float:
        np.exp(2j * np.pi * near * clock.x, out=powers[1])
        for number in range(2, len(powers)):
            np.multiply(powers[number - 1], powers[1], out=powers[number])
        sums = rows @ powers.real.T + 1j * (rows @ powers.imag.T)
        waves, seen = sums[: len(first)], sums[len(first) :, order]
        less, more = waves[:, np.abs(apart)], waves[:, both]
        crossed = more.imag + np.sign(apart) * less.imag
        rows_of = [[less.real + more.real, crossed], [crossed.transpose(0, 2, 1), less.real - more.real]]
        size = len(own) * 2 * harmonics
        gram = 0.5 * np.block(rows_of)[pairs].transpose(0, 2, 1, 3).reshape(size, size)
        gram[np.diag_indices(size)] += max(_NEXT_TO_NOTHING * np.trace(gram) / size, 1e-300)
        moment = np.hstack([seen.real, seen.imag]).ravel()
        return -float(moment @ np.linalg.solve(gram, moment))

    step = clock.cell / harmonics / _NEAR
    grid = frequency + step * np.arange(-2 * _NEAR, 2 * _NEAR + 1)
    nearest = float(min(grid, key=lost))
    within = {"xatol": _AS_NEAR * step}
    best = minimize_scalar(lost, bounds=(nearest - step, nearest + step), method="bounded", options=within)
    return -float(best.fun), float(best.x)
