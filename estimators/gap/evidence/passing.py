"""An error source that is off once, or a few times, and then as before: a knock that rings out, a machine that runs up,
a lift or a lorry that passes by.

When, for how long and at what frequency is told by matching pursuit (Mallat and Zhang, IEEE Transactions on Signal
Processing 41, 1993): channels are looked at through Gaussian windows of all widths, and what stands out there is tried
as an error of every source, as a pulse or a wave that swells and fades, or that begins at once and dies away. What such
a choice costs is Laplace's approximation over the instant, the width and the frequency.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import lgamma, log
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.optimize import minimize
from scipy.signal import oaconvolve
from typing_extensions import override

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.fitted_courses import FittedCourses, worth
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import Course
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array
from rig.channels import CHANNELS, COLUMNS_OF

#: Standard deviations of windows, from so many samples to such a share of the recording, each twice the one before.
_SHORTEST, _LONGEST = 2.0, 0.1
#: A window is seen to so many of its widths: a Gaussian to either side, what dies away to one.
_SEEN, _DIES = 3.0, 5.0
#: So many sources are weighed, those that promise most, and each is off so many times at most.
_SOURCES, _TIMES = 3, 6
#: An atom that is put where it is best explains up to so much more than on the grid.
_BETWEEN: Final = 1.4
#: It is, where its square and its place, in widths, change by less than this, or after so many tries.
_SETTLED, _TRIES = 0.03, 80


@dataclass(frozen=True)
class Atom:
    """A pulse or a wave under a window.

    Attributes:
        at: [samples] its middle, or where it begins. width: [samples] standard deviation, or time constant.
        frequency: [1/samples]; 0 of a pulse. dies: whether it begins at once and dies away.
    """

    at: float
    width: float
    frequency: float = 0.0
    dies: bool = False

    def seen(self, count: int) -> slice:
        """The samples where it is, of so many."""
        first, last = (0.0, _DIES) if self.dies else (-_SEEN, _SEEN)
        first, last = self.at + first * self.width, self.at + last * self.width
        return slice(max(int(np.ceil(first)), 0), min(int(np.floor(last)) + 1, count))

    def functions(self, where: slice) -> Array:
        """(m, 1 or 2) there: the window, or a cosine and a sine under it."""
        apart = np.arange(where.start, where.stop) - self.at
        window = np.exp(-apart / self.width) if self.dies else np.exp(-0.5 * (apart / self.width) ** 2)
        if not self.frequency:
            return window[:, None]
        turns = 2.0 * np.pi * self.frequency * apart
        return np.column_stack([window * np.cos(turns), window * np.sin(turns)])

    def everywhere(self, count: int) -> Array:
        """(n, 1 or 2) at every sample."""
        where = self.seen(count)
        inside = self.functions(where)
        found = np.zeros((count, inside.shape[1]))
        found[where] = inside
        return found

    def cost(self, square: float, count: int) -> float:
        """What it costs in log evidence to choose it among all, where it explains such a square of whitened residuals,
        what noise explains less."""
        octaves = log(2.0) * max(len(widths(count)), 1)
        square = max(square, 1.0)
        if self.frequency:
            taken = log(count * octaves / 2.0) + 1.5 * log(square) - log(5.0)
        else:
            taken = log(count * octaves / self.width) + log(square) - log(4.0 * np.pi)
        return max(taken + log(4.0), 0.0)  # pulse or wave, to either side or to one

    def cost_again(self, square: float, count: int) -> float:
        """The same, where only its instant is to be chosen: one before had its width and frequency."""
        return max(log(count / self.width) + 0.5 * log(max(square, 1.0)) - log(2.0 * np.sqrt(np.pi)), 0.0)


def widths(count: int) -> Array:
    """Standard deviations [samples] of the windows of a recording of so many samples."""
    octaves = int(np.floor(np.log2(max(_LONGEST * count / _SHORTEST, 0.5)))) + 1
    return np.asarray(_SHORTEST * 2.0 ** np.arange(octaves))


@dataclass(frozen=True)
class Passings(FittedCourses):
    """What sources would leave that comes and passes."""

    @cached_property
    def _told(self) -> list[Array]:
        """(n,) of each source, what each sample tells of one freedom beside the mean: of several about the same
        wherever the arm points."""
        found = []
        for source in self.every:
            alone = source.root[:, 0] if source.root.shape[1] == 1 else None
            own = None if alone is None else np.sum(np.einsum("fcn,f->cn", source.series, alone) ** 2, axis=0)
            found.append(np.ones(self.data.count) if own is None else own)
        return found

    @override
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """Those that explain most, each as what passes does."""
        count = self.data.count
        residual = left.reshape(len(self.data.columns), count)
        promised: dict[int, tuple[float, Atom]] = {}
        for atom in standing_out(self.data, residual):
            where = atom.seen(count)
            for index, share in enumerate(self.shares):
                square, freedoms = self._roughly(index, atom, residual, where)
                square *= _BETWEEN
                if square > freedoms:
                    gain = share + worth(square, freedoms) - atom.cost(square - freedoms, count)
                    if gain > promised.get(index, (-np.inf, atom))[0]:
                        promised[index] = gain, atom
        terms: list[Term] = []
        ranked = sorted(promised.items(), key=lambda item: (-item[1][0], item[0]))
        for index, (gain, atom) in ranked[:_SOURCES]:
            if gain > least:
                terms += self._followed(index, atom, residual)
        return terms

    def _roughly(self, index: int, atom: Atom, residual: Array, where: slice) -> tuple[float, int]:
        """About the square that a source under an atom explains, and with how many numbers."""
        root, told = self.every[index].root, self._told[index]
        functions = atom.functions(where)
        moments = np.einsum("fcn,cn->fn", self.every[index].series[:, :, where], residual[:, where]) @ functions
        information = np.maximum(told[where] @ functions**2, 1e-300)
        return float(np.sum((root.T @ moments) ** 2 / information)), root.shape[1] * functions.shape[1]

    def _followed(self, index: int, first: Atom, residual: Array) -> Iterator[Term]:
        """A source as it is off each time that is worth it."""
        source, count = self.every[index], self.data.count
        atoms: list[Atom] = []
        price, rest = 0.0, residual.copy()
        starts = [first]
        while len(atoms) < _TIMES:
            tried = [(_placed(self.data, source, each, rest), log(2.0) if atoms else 0.0) for each in starts]
            ways = [(each, each.atom.cost(each.excess, count) + also) for each, also in tried]
            if atoms:
                again = _placed(self.data, source, self._again(index, atoms[-1], rest), rest, moved=1)
                ways.append((again, again.atom.cost_again(again.excess, count) + log(2.0)))
            best, cost = max(ways, key=lambda each: each[0].gain - each[1])
            if best.gain < cost:
                break
            atoms.append(best.atom)
            price += cost
            rest[:, best.where] -= best.made
            further = [
                (self._roughly(index, each, rest, each.seen(count))[0], number, each)
                for number, each in enumerate(standing_out(self.data, rest))
            ]
            starts = [max(further)[2]] if further else []
        if not atoms:
            return
        columns = np.hstack([each.everywhere(count) for each in atoms])
        course = Course(name(atoms, self.data), columns, np.ones(columns.shape[1]))
        prior = self.shares[index] - price + lgamma(len(atoms) + 1.0)
        yield from terms_along(self.data.absorbed, source, course, prior)

    def _again(self, index: int, atom: Atom, residual: Array) -> Atom:
        """The same atom where it explains most of a residual, to a sample."""
        root, told = self.every[index].root, self._told[index]
        moments = root.T @ np.einsum("fcn,cn->fn", self.every[index].series, residual)
        there = replace(atom, at=float(np.ceil(_DIES * atom.width)))
        functions = there.functions(slice(0, 2 * int(there.at) + 1))[::-1]
        if there.dies:
            functions[int(there.at) + 1 :] = 0.0
        squares = np.sum([oaconvolve(moments, each[None], "same", axes=1) ** 2 for each in functions.T], axis=(0, 1))
        information = np.maximum(oaconvolve(told, np.mean(functions**2, axis=1), "same"), 1e-300)
        return replace(atom, at=float(np.argmax(squares / information)))


def standing_out(data: WhitenedData, residual: Array) -> list[Atom]:
    """The atom that stands out most in each channel, in each sensor and in all of them, as pulse and as wave.

    Args:
        residual: (c, n) whitened.
    """
    count = residual.shape[1]
    groups = [[each] for each in range(len(residual))]
    for where in COLUMNS_OF.values():
        groups.append([index for index, column in enumerate(data.columns) if column in range(len(CHANNELS))[where]])
    groups.append(list(range(len(residual))))
    best: dict[tuple[int, bool], tuple[float, Atom]] = {}
    for width in widths(count):
        frames, at = _frames(residual, float(width))
        for number, members in enumerate(groups):
            if not members:
                continue
            power = frames[members].sum(axis=0)
            for wave, part in ((False, power[:, :1]), (True, power[:, 1:])):
                place = np.unravel_index(int(np.argmax(part)), part.shape)
                excess = float(part[place])
                if excess > best.get((number, wave), (0.0, None))[0]:
                    frequency = (int(place[1]) + 1) / (2 * (power.shape[1] - 1)) if wave else 0.0
                    best[number, wave] = excess, Atom(float(at[place[0]]), float(width), frequency)
    return list(dict.fromkeys(atom for _, atom in best.values()))


def _frames(residual: Array, width: float) -> tuple[Array, NDArray[np.intp]]:
    """(c, m, k) squares that atoms of one width explain of each channel, at so many frequencies, and (m,) where."""
    count = residual.shape[1]
    half, hop = int(np.ceil(_SEEN * width)), max(int(width), 1)
    at = np.arange(0, count, hop)
    padded = np.zeros((len(residual), int(at[-1]) + 2 * half + 1), dtype=np.float32)
    padded[:, half : half + count] = residual
    window = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    window = (window / np.sqrt(np.sum(window**2))).astype(np.float32)
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=1)[:, ::hop]
    length = next_fast_len(2 * half + 1, real=True)
    length += length % 2
    waves = rfft(views * window, length, axis=2)
    power = waves.real**2 + waves.imag**2
    power[:, :, 1:-1] *= 2.0
    return power, at


@dataclass(frozen=True)
class _Placed:
    """An atom as an error of a source: the square that it explains, with how many numbers, where, and (c, m) what it
    makes there."""

    atom: Atom
    square: float
    freedoms: int
    where: slice
    made: Array

    @property
    def excess(self) -> float:
        """Of the square, what noise does not explain."""
        return self.square - self.freedoms

    @property
    def gain(self) -> float:
        """About its log evidence, at the likeliest amplitude."""
        return worth(self.square, self.freedoms)


def _placed(data: WhitenedData, source: Source, start: Atom, residual: Array, moved: int = 3) -> _Placed:
    """The atom near one that explains most as an error of a source.

    Args:
        moved: 3 to move its instant, width and frequency, and to let it die away; 1 for its instant alone.
    """
    count = residual.shape[1]
    longest = 2.0 * _LONGEST * count

    def atom(at: Array, dies: bool) -> Atom:
        instant, wider, faster = np.pad(at, (0, 3 - len(at)))
        frequency = start.frequency + float(faster) / start.width if start.frequency else 0.0
        return Atom(start.at + start.width * float(instant), start.width * float(np.exp(wider)), frequency, dies)

    def missed(at: Array, dies: bool) -> float:
        tried = atom(at, dies)
        within = -2.0 < tried.at < count + 1 and 0.5 * _SHORTEST <= tried.width <= longest
        # slower than a turn within it a wave is a pulse
        if not within or not (start.frequency and 0.15 / tried.width) <= tried.frequency <= 0.5:
            return 0.0
        return -_explained(data, source, tried, residual)[0]

    steps = np.array([0.4, 0.3, 0.05][: min(moved, 3 if start.frequency else 2)])
    best: tuple[float, Atom] = (np.inf, start)
    for dies in (start.dies,) if moved == 1 else (False, True):
        origin = np.zeros(len(steps))
        origin[0] = -1.0 if dies and not start.dies else 0.0
        simplex = np.vstack([origin, origin + np.diag(steps)])
        options = {"initial_simplex": simplex, "fatol": _SETTLED, "xatol": _SETTLED, "maxfev": _TRIES}
        found = minimize(missed, origin, (dies,), "Nelder-Mead", options=options)
        best = min(best, (float(found.fun), atom(found.x, dies)), key=lambda each: each[0])
    square, where, made = _explained(data, source, best[1], residual)
    return _Placed(best[1], square, len(source.series) * (2 if best[1].frequency else 1), where, made)


def _explained(data: WhitenedData, source: Source, atom: Atom, residual: Array) -> tuple[float, slice, Array]:
    """The square that an atom of a source explains of a residual (c, n), where, and (c, m) what it makes there."""
    if (where := atom.seen(data.count)).stop <= where.start:
        return 0.0, where, np.zeros((len(residual), 0))
    where, made = _made(data, source, atom)
    columns = made.reshape(len(made), -1)
    columns = columns / np.sqrt(np.maximum(np.sum(columns**2, axis=1), 1e-300))[:, None]
    values, vectors = np.linalg.eigh(columns @ columns.T)
    kept = values > 1e-6 * values[-1]
    turned = (vectors[:, kept] / np.sqrt(values[kept])).T @ columns
    sizes = turned @ residual[:, where].ravel()
    return float(sizes @ sizes), where, (sizes @ turned).reshape(made.shape[1:])


def _made(data: WhitenedData, source: Source, atom: Atom) -> tuple[slice, Array]:
    """Where an atom is, and (m, c, w) what each freedom of a source makes there along each of its functions, whitened.

    Where the floor has a memory, by its filters alone, as far after the atom as that is long; neither gaps nor what
    channels share is seen to, which the term does that is made of it."""
    where = atom.seen(data.count)
    functions = atom.functions(where).T[None, :, None]
    if source.felt is None:
        return where, (source.series[:, None, :, where] * functions).reshape(-1, len(data.columns), functions.shape[-1])
    after = min(2 * where.stop - where.start, data.count) - where.stop
    felt = (source.felt[0][:, None, :, where] * functions).reshape(-1, len(data.columns), functions.shape[-1])
    felt = np.pad(felt, ((0, 0), (0, 0), (0, max(after, 0))))
    for index, column in enumerate(data.columns):
        if felt[:, index].any():
            felt[:, index] = data.whiteners[column].from_rest(felt[:, index])
    return slice(where.start, where.start + felt.shape[2]), felt


def name(atoms: list[Atom], data: WhitenedData) -> str:
    """The course in words: when, for how long and at what frequency."""
    clock = data.t - data.t[0]
    first = min(atoms, key=lambda each: each.at)
    at = float(clock[int(np.clip(round(first.at), 0, len(clock) - 1))])
    lasts = first.width * (log(2.0) if first.dies else 2.0 * np.sqrt(2.0 * log(2.0)))
    often = "once" if len(atoms) == 1 else f"{len(atoms)} times, first"
    turns = first.frequency * lasts >= 1.0
    wave = f", at {first.frequency / data.interval_s:.3g} Hz" if turns else ""
    return f"time, {often} {'from' if first.dies else 'about'} {at:.4g} s for {lasts * data.interval_s:.2g} s{wave}"
